//! All statistics of a pair of streams together: those of each stream, ratios, and what edges tell of displacement and age.

use ds_diagnosis::meta::Pairing;
use nalgebra::DVector;

use crate::pairing::edges;
use crate::pairing::looks::{MOVED, Stream, beyond, own};
use crate::scene::Scene;

/// Returns the statistics of a scene and what its edges tell.
#[must_use]
pub fn statistics(scene: &Scene<'_>, pairing: Pairing) -> (DVector<f64>, Option<edges::Moved>) {
    let paired = pairing != Pairing::Unpaired;
    let moved = paired.then(|| edges::measured(scene.case));
    // what is late is no other statistic's business
    let simulated = Stream::of(scene, false);
    let simulated = match &moved {
        Some(moved) => simulated.aged(&moved.late.ages),
        None => simulated,
    };
    let mut x = beyond(scene, &simulated, &own(scene, &simulated), &Stream::of(scene, true), paired);
    if let Some(moved) = &moved {
        for (x, v) in x[MOVED..].iter_mut().zip(&moved.values) {
            *x = *v;
        }
    }
    (DVector::from_column_slice(&x), moved)
}
