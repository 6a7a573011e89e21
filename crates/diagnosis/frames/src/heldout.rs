//! What an effect gains on frames that took no part in its fit: the loss of the held-out frames without and with it.
//!
//! Only the offset of each held-out frame is measured there, within the nuisance; what is measured frame by frame
//! (flicker, objects) is measured anew, a map of dirt stays.

use std::collections::BTreeMap;

use ds_effect::FrameChain;
use ds_effect::frame::Act;

use crate::blocks::blocks;
use crate::flicker::Field;
use crate::geometry::moves;
use crate::loss;
use crate::objects;
use crate::scene::{Model, Placed, Scene};
use crate::search::{Search, fate};
use crate::settings;

/// Returns the gain on held-out frames of the best effects of every round.
#[must_use]
pub fn gains(found: &Search, scene: &Scene<'_>) -> BTreeMap<&'static str, f64> {
    let mut out = BTreeMap::new();
    let held = Scene::of(scene.case, scene.case.held.iter().collect());
    if held.frames.is_empty() || found.ages.best.iter().any(|a| *a > 0) {
        return out;
    }
    let mut before = measured(&held, &found.null);
    for (k, round) in found.rounds.iter().enumerate() {
        let many = if k < found.chosen.len() { 3 } else { 1 };
        let mut chosen = before;
        for trial in round.trials.iter().take(many).filter(|t| round.gain(t) > 0.0) {
            let after = measured(&held, &trial.model);
            out.entry(trial.id).or_insert(before - after);
            if found.chosen.get(k) == Some(&trial.id) {
                chosen = after;
            }
        }
        before = chosen;
    }
    out
}

fn measured(held: &Scene<'_>, fitted: &Model) -> f64 {
    let mean = [0, 1].map(|d| fitted.shifts.iter().map(|s| s[d]).sum::<f64>() / fitted.shifts.len().max(1) as f64);
    let mut model =
        Model { effects: fitted.effects.clone(), dirt: fitted.dirt.clone(), ..Model::nominal(held.frames.len()) };
    model.effects.retain(|(e, _)| !matches!(e.act, Act::Age(_)));
    model.shifts = vec![mean; held.frames.len()];
    let chain = FrameChain::new(&model.effects.iter().filter(|(e, _)| moves(e)).cloned().collect::<Vec<_>>());
    for k in 0..held.frames.len() {
        let step = step(&held.placed_full(&model, &chain, k), &held.grey[k].1);
        let most = settings::MOST_SHIFT_PX;
        model.shifts[k] = [0, 1].map(|d| (mean[d] + step[d]).clamp(-most, most));
    }
    let placed: Placed = held.placed(&model);
    if fitted.flicker.is_some() {
        let rendered = held.small_of(&model, &placed.small);
        model.flicker = Some(rendered.iter().zip(&held.small).map(|(p, (_, q))| Field::measured(p, q, 0.1)).collect());
    }
    if let Some(fate) = model.effects.iter().find_map(|(e, _)| fate(e.id)) {
        for event in objects::events(held, &held.small_of(&model, &placed.small)) {
            if event.fate == fate {
                model.lost[event.frame].push(event.edges);
            }
        }
    }
    loss::measure(held, &model, &placed).total
}

fn step(rendered: &ds_effect::picture::Picture, real: &ds_effect::picture::Picture) -> [f64; 2] {
    let (mut m, mut v) = ([1.0, 0.0, 1.0], [0.0; 2]);
    for b in blocks(rendered, real, settings::BLOCK_PX) {
        m.iter_mut().zip(&b.info).for_each(|(sum, info)| *sum += info);
        v.iter_mut().zip(&b.pull).for_each(|(sum, pull)| *sum += pull);
    }
    let det = (m[0] * m[2] - m[1] * m[1]).max(1e-9);
    [(m[2] * v[0] - m[1] * v[1]) / det, (m[0] * v[1] - m[1] * v[0]) / det]
}
