//! What drives are grouped by, and the drives of several runs as one list.
//!
//! An empty value means that a results file does not say; it is a value like any other when grouping.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use serde::{Serialize, Serializer};

use crate::results::{Episode, Results};

/// A property that tells groups of drives apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Dimension {
    /// The run's id, numbered where ids repeat.
    Run,
    /// Who drove.
    Policy,
    /// The scenario set.
    Set,
    /// The scenario family.
    Category,
    /// The scenario.
    Scenario,
    /// The look of the reference camera.
    Appearance,
    /// The observation source.
    Observation,
    /// Who ranked the proposals.
    Scorer,
    /// Definition of the score, with its version; added by itself where drives differ in it.
    Profile,
}

impl Dimension {
    /// Returns the lower-case name used in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Run => "run",
            Self::Policy => "policy",
            Self::Set => "set",
            Self::Category => "category",
            Self::Scenario => "scenario",
            Self::Appearance => "appearance",
            Self::Observation => "observation",
            Self::Scorer => "scorer",
            Self::Profile => "profile",
        }
    }

    /// Returns what the drive is in this respect; empty if its file does not say.
    #[must_use]
    pub fn of(self, drive: &Drive) -> String {
        let episode = drive.episode;
        match self {
            Self::Run => drive.run.clone(),
            Self::Policy => episode.policy.clone(),
            Self::Set => episode.set.clone(),
            Self::Category => episode.category.clone(),
            Self::Scenario => episode.scenario.clone(),
            Self::Appearance => episode.appearance.clone(),
            Self::Observation => episode.observation.clone(),
            Self::Scorer => episode.scorer.clone(),
            Self::Profile => episode.profile(),
        }
    }

    /// Returns all values of the drives, in order.
    #[must_use]
    pub fn values(self, drives: &[Drive]) -> BTreeSet<String> {
        drives.iter().map(|drive| self.of(drive)).collect()
    }
}

impl fmt::Display for Dimension {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl Serialize for Dimension {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

/// An episode with the run that it belongs to.
#[derive(Debug, Clone)]
pub struct Drive<'a> {
    /// Name of the run, unique among the runs given.
    pub run: String,
    /// Index of the run and of the episode in it.
    pub place: (usize, usize),
    /// The episode.
    pub episode: &'a Episode,
}

impl Drive<'_> {
    /// Returns the unit of averaging: a scenario within its set.
    #[must_use]
    pub fn unit(&self) -> (String, String) {
        (self.episode.set.clone(), self.episode.scenario.clone())
    }
}

/// Returns the names of the runs: their ids, numbered where two are the same.
#[must_use]
pub fn run_names(runs: &[Results]) -> Vec<String> {
    let mut seen: BTreeMap<&str, u32> = BTreeMap::new();
    let mut name = |id| {
        let count = seen.entry(id).or_default();
        *count += 1;
        if *count == 1 { id.to_owned() } else { format!("{id} #{count}") }
    };
    runs.iter().map(|results| name(results.run.id.as_str())).collect()
}

/// Returns all episodes of all runs, sorted so that sums do not depend on the order in the files.
#[must_use]
pub fn drives(runs: &[Results]) -> Vec<Drive<'_>> {
    let mut all: Vec<Drive> = Vec::new();
    for (run_index, (results, run)) in runs.iter().zip(run_names(runs)).enumerate() {
        all.extend(results.episodes.iter().enumerate().map(|(index, episode)| Drive {
            run: run.clone(),
            place: (run_index, index),
            episode,
        }));
    }
    let order = |drive: &Drive| {
        let e = drive.episode;
        let texts = [&e.set, &e.scenario, &e.policy, &e.observation, &e.appearance, &e.scorer];
        (texts.map(String::clone), e.seed, drive.place)
    };
    all.sort_by_cached_key(order);
    all
}
