//! Diagnoses the gap between a reference log and a nominal simulator: where it lies, which unmodelled effect of the
//! library in `ds_effect` causes it, how far it shrinks once that effect is added.
//!
//! [`diagnose()`] takes a case of the practice schema, read by [`case::Case`], and returns a [`ds_diagnosis::Diagnosis`]; [`evaluate()`] applies one
//! to drives it never saw. Method and limits: `docs/gap-diagnosis.md`.

pub mod baseline;
pub mod bootstrap;
mod carried;
pub mod case;
pub mod cells;
mod check;
pub mod choice;
pub mod constancy;
pub mod diagnose;
mod doubts;
pub mod drive;
pub mod ego;
pub mod evaluate;
pub mod fit;
pub mod fleet;
pub mod floor;
pub mod following;
pub mod foreign;
pub mod healthy;
pub mod how_far;
pub mod isolability;
pub mod leave_out;
pub mod manoeuvre;
pub mod modulation;
pub mod motion;
pub mod noise;
pub mod remainder;
pub mod scatter;
pub mod search;
pub mod settings;
pub mod shapley;
pub mod signature;
pub mod size;
pub mod smooth;
pub mod space;
pub mod standing;
pub mod synthetic;
pub mod traces;
pub mod watch;
pub mod windows;

pub use diagnose::{Options, diagnose, diagnose_leaving};
pub use evaluate::evaluate;
pub use isolability::isolability;
