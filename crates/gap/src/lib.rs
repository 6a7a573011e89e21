//! Diagnoses the gap between a reference log and a nominal simulator.

pub mod bootstrap;
pub mod case;
mod check;
pub mod drive;
pub mod ego;
mod error;
pub mod fit;
pub mod floor;
pub mod following;
pub mod meta;
pub mod report;
pub mod scatter;
pub mod search;
pub mod settings;
pub mod signature;
pub mod smooth;
pub mod space;
pub mod table;
pub mod windows;

pub use error::GapError;
