//! Diagnoses the gap between a reference log and a nominal simulator.

pub mod bootstrap;
pub mod case;
pub mod cells;
mod check;
pub mod choice;
pub mod diagnose;
pub mod drive;
pub mod ego;
mod error;
pub mod fit;
pub mod floor;
pub mod following;
pub mod how_far;
pub mod manoeuvre;
pub mod meta;
pub mod remainder;
pub mod report;
pub mod scatter;
pub mod search;
pub mod settings;
pub mod signature;
pub mod smooth;
pub mod space;
pub mod synthetic;
pub mod table;
pub mod windows;

pub use diagnose::{Options, diagnose};
pub use error::GapError;
pub use report::{Diagnosis, Verdict};
