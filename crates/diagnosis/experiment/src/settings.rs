//! When the loop ends, and how experiments are designed and diagnosed.

use crate::envelope::Envelope;

/// Probability of one hypothesis among all from which nothing more is driven.
pub const ENOUGH: f64 = 0.95;
/// Information below which a run is not worth driving, nat.
pub const LEAST_NATS: f64 = 0.05;
/// Most runs.
pub const MOST_RUNS: usize = 5;

/// How experiments are designed and diagnosed.
#[derive(Debug, Clone, Default)]
pub struct Settings {
    /// Seed of the search, of the draws and of the noise of runs.
    pub seed: u64,
    /// Limits of a run.
    pub envelope: Envelope,
    /// Fast pass and single fits only.
    pub quick: bool,
    /// Manoeuvres of the library that are not begun from.
    pub without: Vec<String>,
}
