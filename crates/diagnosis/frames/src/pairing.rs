//! Streams that do not agree pixel by pixel: `same-layout` (generated frames of the same states, other texture) and
//! `unpaired` (other states), judged by statistics against what the generator itself leaves on effect-free pairs.

pub mod edges;
pub mod layers;
pub mod looks;
pub mod nuisance;
pub mod paths;
pub mod statistics;
pub mod verdict;
pub mod weigh;

use ds_diagnosis::meta::Pairing;
use ds_effect::FrameChain;
use ds_effect::picture::Picture;

use crate::align;
use crate::scene::{Model, Scene};
use crate::settings;

/// Estimates the pairing of a scene whose case does not say: by how well
/// medium detail agrees once it is in place.
#[must_use]
pub fn estimated(scene: &Scene<'_>, field: &align::Field, ages: &[usize]) -> Pairing {
    let shifts = align::geometry(scene, field, &Vec::new()).shifts;
    let carried = align::carried(scene, field);
    let model = Model { shifts, ages: ages.to_vec(), effects: carried, ..Model::nominal(scene.frames.len()) };
    let chain = FrameChain::new(&model.effects);
    let mut agree: Vec<f64> = Vec::new();
    let still = FrameChain::new(&Vec::new());
    for k in scene.full.iter().filter(|k| ages[**k] <= **k) {
        // what carries the alignment may go astray, so that frames as they are count as well
        let carried = agreement(&scene.placed_full(&model, &chain, *k), &scene.grey[*k].1);
        let plain = agreement(&scene.placed_full(&model, &still, *k), &scene.grey[*k].1);
        agree.extend(if mean(&plain) > mean(&carried) { plain } else { carried });
    }
    let typical = if agree.is_empty() { 1.0 } else { ds_stats::quantile(&mut agree, 0.25) };
    if typical > settings::ALIGNED_AGREEMENT {
        Pairing::Aligned
    } else if typical > settings::LAYOUT_AGREEMENT {
        Pairing::SameLayout
    } else {
        Pairing::Unpaired
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Side of the blocks that are compared, and how far each may be moved to agree, px.
const BLOCK: usize = 32;
const REACH: isize = 2;

/// Returns how well each block with detail of about 3 to 9 px agrees in both pictures: the best correlation nearby.
fn agreement(p: &Picture, q: &Picture) -> Vec<f64> {
    let detail = |a: &Picture| {
        let fine = a.boxed(1);
        let smooth = fine.boxed(4);
        fine.data.iter().zip(&smooth.data).map(|(v, s)| v - s).collect::<Vec<f32>>()
    };
    let (a, b) = (detail(p), detail(q));
    let w = p.width;
    let edge = REACH as usize;
    let mut out = Vec::new();
    for top in (edge..(p.height - edge).saturating_sub(BLOCK)).step_by(BLOCK) {
        for left in (edge..(w - edge).saturating_sub(BLOCK)).step_by(BLOCK) {
            let mut best = 0.0f32;
            for dy in -REACH..=REACH {
                for dx in -REACH..=REACH {
                    let (mut ab, mut aa, mut bb) = (0.0f32, 0.0f32, 0.0f32);
                    for y in top..top + BLOCK {
                        let (i, j) = (y * w + left, (y.wrapping_add_signed(dy)) * w + left.wrapping_add_signed(dx));
                        for (a, b) in a[i..i + BLOCK].iter().zip(&b[j..j + BLOCK]) {
                            ab += a * b;
                            aa += a * a;
                            bb += b * b;
                        }
                    }
                    if aa > (9 * BLOCK * BLOCK) as f32 {
                        best = best.max(ab / (aa * bb).sqrt().max(1e-6));
                    }
                }
            }
            if best > 0.0 {
                out.push(f64::from(best));
            }
        }
    }
    out
}
