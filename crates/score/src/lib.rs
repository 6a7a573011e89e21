//! Executed states to scores, tick by tick: collision, drivable area, progress, route completion.
//!
//! All scores lie in 0..=1, 1 being best; `None` means that a metric does not apply to the drive. World frame, SI units.
//! Pure: same scene and states, same bits. The exact driving score and its sub-metrics are not computed here yet.

mod area;
mod collision;
mod drivable_area;
mod odometer;
mod progress;
mod route_completion;
mod tracker;

pub use tracker::{EpisodeScore, ScoreTracker, TickScore};

/// Why [`EpisodeScore::driving_score`] is `None`.
pub const DRIVING_SCORE_REASON: &str = "the exact driving score is not computed by this version";
