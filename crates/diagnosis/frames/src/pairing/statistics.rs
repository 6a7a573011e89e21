//! All statistics of a pair of streams together: those of each stream, ratios, and what edges tell of displacement and age.

use ds_diagnosis::meta::Pairing;
use nalgebra::DVector;

use crate::pairing::edges;
use crate::pairing::layers::{LAYERS, layered};
use crate::pairing::looks::{ALL, MOVED, Stream, beyond, own};
use crate::scene::Scene;

/// Which statistics there are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scope {
    /// Of each stream alone.
    Own,
    /// Of pairs as well.
    Paired,
    /// By the layers of the layout as well.
    Layered,
}

impl Scope {
    /// Returns the scope of a pairing.
    #[must_use]
    pub fn of(pairing: Pairing) -> Self {
        if pairing == Pairing::Unpaired { Self::Own } else { Self::Paired }
    }

    /// Returns the number of statistics; those that are not known are 0.
    #[must_use]
    pub const fn count(self) -> usize {
        match self {
            Self::Own | Self::Paired => ALL,
            Self::Layered => ALL + LAYERS,
        }
    }
}

/// Returns the statistics of a scene and what its edges tell.
#[must_use]
pub fn statistics(scene: &Scene<'_>, scope: Scope) -> (DVector<f64>, Option<edges::Moved>) {
    let paired = scope != Scope::Own;
    let moved = paired.then(|| edges::measured(scene.case));
    // what is late is no other statistic's business
    let simulated = Stream::of(scene, false);
    let simulated = match &moved {
        Some(moved) => simulated.aged(&moved.late.ages),
        None => simulated,
    };
    let real = Stream::of(scene, true);
    let mut x = beyond(scene, &simulated, &own(scene, &simulated), &real, paired).to_vec();
    if let Some(moved) = &moved {
        for (x, v) in x[MOVED..].iter_mut().zip(&moved.values) {
            *x = *v;
        }
    }
    if scope == Scope::Layered {
        x.extend(layered(scene, &simulated, &real));
    }
    (DVector::from_vec(x), moved)
}
