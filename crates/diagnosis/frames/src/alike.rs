//! Which effects these data cannot tell apart: cosines of what two effects, each at its fit, do to the frames, after the
//! part that any change of brightness could do is taken out.

use ds_effect::FrameChain;

use crate::geometry::moves;
use crate::scene::{Model, Scene};
use crate::search::{Round, Search, Trial};
use crate::settings;

/// Frames compared.
const FRAMES: usize = 2;
/// Effects compared with the best one.
const OTHERS: usize = 5;

/// Returns the effects of a round whose signature is nearly that of its best one, or whose gain is nearly as large.
#[must_use]
pub fn group(scene: &Scene<'_>, found: &Search, round: &Round, trial: &Trial) -> Vec<String> {
    let gain = round.gain(trial);
    let own = signature(scene, found, &trial.model);
    let mut group = vec![trial.id.to_owned()];
    for other in round.trials.iter().filter(|t| t.id != trial.id && round.gain(t) > 0.0).take(OTHERS) {
        let near = gain - round.gain(other) < settings::GROUP_GAIN;
        // what explains far less is told apart by that, however much it looks alike
        let rival = round.gain(other) > 0.8 * gain;
        if group.len() < 4
            && (near || (rival && cosine(&own, &signature(scene, found, &other.model)) > settings::GROUP_COSINE))
        {
            group.push(other.id.to_owned());
        }
    }
    group
}

fn signature(scene: &Scene<'_>, found: &Search, model: &Model) -> Vec<f64> {
    let pictures = |model: &Model| {
        let chain = FrameChain::new(&model.effects.iter().filter(|(e, _)| moves(e)).cloned().collect::<Vec<_>>());
        let placed: Vec<_> = scene.full.iter().map(|k| scene.placed_full(model, &chain, *k)).collect();
        scene.full_of(model, &placed)
    };
    let (with, without) = (pictures(model), pictures(&found.null));
    let mut out = Vec::new();
    for (p, q) in with.iter().zip(&without).take(FRAMES) {
        let change: Vec<f64> = p.data.iter().zip(&q.data).map(|(a, b)| f64::from(a - b)).collect();
        let light: f64 = q.data.iter().map(|v| f64::from(v * v)).sum();
        let share = change.iter().zip(&q.data).map(|(c, v)| c * f64::from(*v)).sum::<f64>() / light.max(1e-9);
        out.extend(change.iter().zip(&q.data).map(|(c, v)| c - share * f64::from(*v)));
    }
    out
}

fn cosine(a: &[f64], b: &[f64]) -> f64 {
    let sum = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
    (sum(a, b) / (sum(a, a) * sum(b, b)).sqrt().max(1e-9)).abs()
}
