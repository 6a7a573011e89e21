//! What is averaged: driving score, route completion, mean per-tick score and every sub-metric that occurs.
//!
//! All are 0 to 1. A metric without a value in a completed drive does not apply there.

use std::collections::{BTreeMap, BTreeSet};

use crate::dimension::Drive;
use crate::results::{Episode, Outcome};
use crate::term;

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
    ///
    /// A failed drive counts 0 in the totals whatever the scenario, and in a sub-metric if that applies to the scenario.
    #[must_use]
    pub fn headline(&self, drive: &Drive, applicable: &Applicable) -> Option<f64> {
        match drive.episode.outcome() {
            Outcome::Completed => self.of(drive.episode),
            Outcome::Failed => applicable.to(self, drive).then_some(0.0),
            Outcome::Aborted => None,
        }
    }

    /// Returns the value that enters the mean over finished drives only.
    #[must_use]
    pub fn finished(&self, episode: &Episode) -> Option<f64> {
        (episode.outcome() == Outcome::Completed).then(|| self.of(episode)).flatten()
    }
}

/// Which sub-metrics apply to which scenario, as far as completed drives tell.
///
/// A sub-metric applies to a scenario if any completed drive of it has a value. Where no drive of a scenario completed,
/// it is taken to apply if it does in every scenario with a completed drive.
#[derive(Debug, Clone, Default)]
pub struct Applicable {
    by_scenario: BTreeMap<(String, String), BTreeSet<String>>,
}

impl Applicable {
    /// Learns from the completed ones of these drives, whoever drove.
    #[must_use]
    pub fn of(drives: &[Drive]) -> Self {
        let mut by_scenario: BTreeMap<_, BTreeSet<String>> = BTreeMap::new();
        for drive in drives.iter().filter(|drive| drive.episode.outcome() == Outcome::Completed) {
            let known = drive.episode.sub_scores.iter().filter(|(_, value)| value.is_some());
            by_scenario.entry(drive.unit()).or_default().extend(known.map(|(term, _)| term.clone()));
        }
        Self { by_scenario }
    }

    fn to(&self, metric: &Metric, drive: &Drive) -> bool {
        let Metric::SubScore(term) = metric else { return true };
        match self.by_scenario.get(&drive.unit()) {
            Some(terms) => terms.contains(term),
            None => self.by_scenario.values().all(|terms| terms.contains(term)),
        }
    }
}

/// Returns the metrics of these drives: the three totals, then the sub-metrics in order of the score's definition.
#[must_use]
pub fn metrics_of(drives: &[Drive]) -> Vec<Metric> {
    let terms: BTreeSet<&String> = drives.iter().flat_map(|drive| drive.episode.sub_scores.keys()).collect();
    let mut terms: Vec<&String> = terms.into_iter().collect();
    terms.sort_by_key(|term| term::rank(term));
    let totals = [Metric::DrivingScore, Metric::RouteCompletion, Metric::MeanScore];
    totals.into_iter().chain(terms.into_iter().cloned().map(Metric::SubScore)).collect()
}
