//! Streams that do not agree pixel by pixel: `same-layout` (generated frames of the same states, other texture) and
//! `unpaired` (other states), judged by statistics against what the generator itself leaves on effect-free pairs.

pub mod edges;
pub mod looks;
pub mod nuisance;
pub mod paths;
pub mod verdict;
pub mod weigh;

use ds_effect::FrameChain;

use crate::align;
use crate::scene::{Model, Scene};
use crate::settings;

/// How the frames of two streams belong together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Pairing {
    /// The same pixels but for the effect.
    Aligned,
    /// The same states, other texture.
    SameLayout,
    /// Other states of the same kind of road.
    Unpaired,
}

impl Pairing {
    /// Its name in `meta.json`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Aligned => "aligned",
            Self::SameLayout => "same-layout",
            Self::Unpaired => "unpaired",
        }
    }

    /// Estimates the pairing of a scene whose case does not say: by how well medium detail agrees once it is in place.
    #[must_use]
    pub fn estimated(scene: &Scene<'_>, field: &align::Field, ages: &[usize]) -> Self {
        let shifts = align::geometry(scene, field, &Vec::new()).shifts;
        let carried = align::carried(scene, field);
        let model = Model { shifts, ages: ages.to_vec(), effects: carried, ..Model::nominal(scene.frames.len()) };
        let chain = FrameChain::new(&model.effects);
        let agree: Vec<f64> = scene
            .full
            .iter()
            .map(|k| {
                let placed = scene.placed_full(&model, &chain, *k).shrunk(settings::SMALL);
                agreement(&placed, &scene.small[*k].1)
            })
            .collect();
        let mut sorted = agree;
        let typical = ds_gap::bootstrap::quantile(&mut sorted, 0.5);
        if typical > settings::ALIGNED_AGREEMENT {
            Self::Aligned
        } else if typical > settings::LAYOUT_AGREEMENT {
            Self::SameLayout
        } else {
            Self::Unpaired
        }
    }
}

/// Returns the correlation of the detail between 4 and 16 px of two small pictures.
fn agreement(p: &ds_effect::picture::Picture, q: &ds_effect::picture::Picture) -> f64 {
    let detail = |a: &ds_effect::picture::Picture| {
        let grey = a.grey();
        let smooth = grey.boxed(2);
        grey.data.iter().zip(&smooth.data).map(|(v, s)| f64::from(v - s)).collect::<Vec<f64>>()
    };
    let (a, b) = (detail(p), detail(q));
    let sum = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
    sum(&a, &b) / (sum(&a, &a) * sum(&b, &b)).sqrt().max(1e-9)
}
