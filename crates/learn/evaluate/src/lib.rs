//! How good the frames of video models are, on scenarios that no training has seen.
//!
//! An *arm* is a weights file and the way frames are made of it; a *column* is a set of scenarios seen by a camera world.
//! Each arm rolls out each scenario of a column from the world's own first frame; small networks look at chosen frames
//! ([`watch`]), and what they say is stored per rollout ([`store`]), so that an interrupted evaluation goes on and a
//! repeated one only sums up. Every figure carries an interval from resampled scenarios ([`estimate`]).

pub mod arm;
pub mod column;
pub mod config;
pub mod course;
pub mod drive;
mod error;
pub mod estimate;
pub mod evaluation;
pub mod eyes;
mod film;
pub mod outcome;
mod page;
pub mod pairs;
pub mod record;
pub mod report;
pub mod store;
pub mod study;
pub mod summary;
pub mod watch;

pub use config::EvalConfig;
pub use error::EvaluationError;

/// Hears how an evaluation goes on, from whichever thread.
pub trait Progress: Send {
    /// So many rollouts are ahead.
    fn ahead(&mut self, rollouts: u64);
    /// A rollout is done; it was stored from an earlier run if `stored`.
    fn done(&mut self, what: &str, stored: bool);
    /// Something worth a line happened.
    fn note(&mut self, text: &str);
}

/// Says nothing.
pub struct Silent;

impl Progress for Silent {
    fn ahead(&mut self, _rollouts: u64) {}
    fn done(&mut self, _what: &str, _stored: bool) {}
    fn note(&mut self, _text: &str) {}
}
