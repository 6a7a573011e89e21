//! Diagnoses the gap between two paired frame streams, simulated and real: where it lies, which effect on frames of
//! `ds_effect` causes it, how far it shrinks once that effect is added.
//!
//! [`diagnose()`] takes a case folder of the practice schema and returns a [`ds_diagnosis::Diagnosis`]; [`evaluate()`] applies one
//! to frames it never saw. Pairing is `aligned`: the same pixels but for the effect. Method and limits:
//! `docs/gap-frames.md`.

pub mod align;
pub mod alike;
pub mod blocks;
pub mod case;
pub mod clips;
pub mod diagnose;
pub mod dirt;
mod error;
pub mod evaluate;
pub mod flicker;
pub mod fringe;
pub mod geometry;
pub mod grain;
pub mod heldout;
pub mod how_far;
pub mod interval;
pub mod lag;
pub mod loss;
pub mod next;
pub mod objects;
pub mod pairing;
pub mod places;
pub mod remainder;
pub mod scene;
pub mod search;
pub mod settings;
pub mod sharp;
pub mod shown;
pub mod streams;
pub mod tone;
pub mod transport;
pub mod warp;

pub use case::FrameCase;
pub use clips::ClipCase;
pub use diagnose::{Options, diagnose};
pub use error::FramesError;
pub use evaluate::evaluate;
pub use pairing::nuisance::Nuisance;
pub use shown::Shown;
pub use streams::Streams;
