//! What is averaged: driving score, route completion, mean per-tick score and every sub-metric that occurs.
//!
//! All are 0 to 1. A metric without a value in a completed drive does not apply there.

use std::collections::BTreeSet;

use crate::dimension::Drive;
use crate::results::{Episode, Outcome};

/// One score of an episode.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub enum Metric {
    /// Route completion times mean score.
    DrivingScore,
    /// Share of the expert's path.
    RouteCompletion,
    /// Mean of the per-tick score.
    MeanScore,
    /// A sub-metric by its lower-case name.
    SubScore(String),
}

impl Metric {
    /// Returns the name used in files: `driving_score`, `sub_scores.nc`.
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            Self::DrivingScore => "driving_score".to_owned(),
            Self::RouteCompletion => "route_completion".to_owned(),
            Self::MeanScore => "mean_score".to_owned(),
            Self::SubScore(term) => format!("sub_scores.{term}"),
        }
    }

    /// Returns the value of an episode as its file gives it, whatever its status.
    #[must_use]
    pub fn of(&self, episode: &Episode) -> Option<f64> {
        match self {
            Self::DrivingScore => episode.driving_score,
            Self::RouteCompletion => episode.route_completion,
            Self::MeanScore => episode.mean_score,
            Self::SubScore(term) => episode.sub_scores.get(term).copied().flatten(),
        }
    }

    /// Returns the value that enters the headline: 0 for a failed drive, nothing for an aborted one.
    #[must_use]
    pub fn headline(&self, episode: &Episode) -> Option<f64> {
        match episode.outcome() {
            Outcome::Completed => self.of(episode),
            Outcome::Failed => Some(0.0),
            Outcome::Aborted => None,
        }
    }

    /// Returns the value that enters the mean over finished drives only.
    #[must_use]
    pub fn finished(&self, episode: &Episode) -> Option<f64> {
        (episode.outcome() == Outcome::Completed).then(|| self.of(episode)).flatten()
    }
}

/// Returns the metrics of these drives: the three totals, then the sub-metrics by name.
#[must_use]
pub fn metrics_of(drives: &[Drive]) -> Vec<Metric> {
    let terms: BTreeSet<&String> = drives.iter().flat_map(|drive| drive.episode.sub_scores.keys()).collect();
    let totals = [Metric::DrivingScore, Metric::RouteCompletion, Metric::MeanScore];
    totals.into_iter().chain(terms.into_iter().cloned().map(Metric::SubScore)).collect()
}
