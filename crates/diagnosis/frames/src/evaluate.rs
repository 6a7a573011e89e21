//! Applies a frozen diagnosis to frames it never saw, without any refit, and measures how far the gap shrinks there.

use std::ops::RangeInclusive;

use ds_diagnosis::schema::{Diagnosis, Shrink};

use crate::case::FrameCase;
use crate::dirt::Map;
use crate::error::FramesError;
use crate::how_far::{Correction, FLOORS, generated, how_far};

/// Returns the shrink on some frames of a case (all of them if no range is given), as data `unseen`.
///
/// # Errors
/// If there is no distance between its frames.
pub fn evaluate(
    diagnosis: &Diagnosis,
    case: &FrameCase,
    frames: Option<RangeInclusive<u64>>,
) -> Result<Vec<Shrink>, FramesError> {
    let (correction, floors) = corrections(diagnosis);
    let wanted = |n: u64| frames.as_ref().is_none_or(|f| f.contains(&n));
    if let Some(floors) = floors {
        return generated(case, &correction, &wanted, floors, "unseen");
    }
    how_far(case, &correction, &wanted, "unseen")
}

/// Returns what a diagnosis does to frames, and its floors where its streams do not agree pixel by pixel.
#[must_use]
pub fn corrections(diagnosis: &Diagnosis) -> (Correction, Option<[f64; 2]>) {
    let model = &diagnosis.corrected_model;
    let mut dirt = None;
    let mut effects = Vec::new();
    for e in &model.effects {
        let Some(effect) = ds_effect::find_frame(&e.id) else { continue };
        let count = effect.parameters.len().min(e.values.len());
        if e.id == "lens_dirt" {
            dirt = Some(Map::from_list(&e.values[count..]));
        }
        effects.push((effect, e.values[..count].to_vec()));
    }
    let nuisance = |name: &str, usual: f64| model.nuisance.get(name).copied().unwrap_or(usual);
    let correction = Correction {
        effects,
        shift: [nuisance("shift_x_px", 0.0), nuisance("shift_y_px", 0.0)],
        noise: nuisance("noise_levels2", 2.0),
        dirt,
    };
    let floors = FLOORS.map(|name| model.nuisance.get(name).copied());
    (correction, floors[0].zip(floors[1]).map(|(rmse, distance)| [rmse, distance]))
}
