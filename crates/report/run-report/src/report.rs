//! Several runs → one report: the headline, the other tables, comparisons, bias, and where the pictures lie.
//!
//! A report is values only; `write` turns it into JSON, CSV, Arrow, Markdown and the page.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::aggregate::{Aggregate, Counts, aggregate, counts, grouped};
use crate::bias::{Bias, BiasOptions, bias};
use crate::compare::Comparison;
use crate::dimension::{Dimension, Drive, drives, run_names};
use crate::results::{Outcome, Results, Run};

#[cfg(test)]
mod tests;

/// What tells drives apart in the headline, as far as it varies.
const HEADLINE_BY: [Dimension; 5] =
    [Dimension::Policy, Dimension::Set, Dimension::Scorer, Dimension::Observation, Dimension::Appearance];

/// What a report is made with.
#[derive(Debug, Clone)]
pub struct ReportOptions {
    /// The page's title.
    pub title: String,
    /// Seed of every bootstrap and permutation.
    pub seed: u64,
    /// The set that changed sets are compared with.
    pub base_set: String,
}

impl Default for ReportOptions {
    fn default() -> Self {
        Self { title: "Driving scores".to_owned(), seed: 0, base_set: BiasOptions::default().base_set }
    }
}

/// A picture or video of an episode.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Index of the run among those of the report.
    pub run: usize,
    /// Index of the episode in the run.
    pub episode: usize,
    /// Where the picture lies, relative to the page, such as `pictures/cut-in.gif`.
    pub path: String,
}

/// Everything that a report says.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// The title.
    pub title: String,
    /// The runs, in the order given.
    pub runs: Vec<RunHead>,
    /// Drives of all runs together.
    pub counts: Counts,
    /// What all drives have in common, by dimension.
    pub constant: BTreeMap<&'static str, String>,
    /// Groups by policy and by whatever else varies.
    pub headline: Aggregate,
    /// The headline's groups split by scenario family; nothing if there is one family only.
    pub categories: Option<Aggregate>,
    /// The headline's groups split by scenario.
    pub scenarios: Aggregate,
    /// Comparisons of runs, as given.
    pub comparisons: Vec<Comparison>,
    /// Bias of the scorer, coverage of the proposals; nothing if no drive tells.
    pub bias: Option<Bias>,
    /// Failed and aborted drives with their reasons.
    pub unfinished: Vec<Unfinished>,
    /// What is wrong with recordings that are damaged or incomplete, one line each; the caller looks at them.
    pub partial: Vec<String>,
}

/// A run and its name in the report.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RunHead {
    /// Its id, numbered where ids repeat.
    pub name: String,
    /// What was run.
    #[serde(flatten)]
    pub run: Run,
}

/// A drive that did not come to its end.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Unfinished {
    /// The run's name.
    pub run: String,
    /// The scenario.
    pub scenario: String,
    /// The scenario set.
    pub set: String,
    /// The policy.
    pub policy: String,
    /// The seed.
    pub seed: u64,
    /// `failed`, `aborted`, or how far it came.
    pub status: String,
    /// Why.
    pub reason: String,
    /// Ticks driven until then.
    pub ticks: u32,
}

impl Report {
    /// Makes all tables from the results of one or several runs.
    #[must_use]
    pub fn new(runs: &[Results], comparisons: Vec<Comparison>, options: &ReportOptions) -> Self {
        let drives = drives(runs);
        let by = headline_by(&drives);
        let split = |dimension: Dimension| aggregate(&drives, &extended(&by, dimension), options.seed);
        let bias = bias(&drives, &BiasOptions { base_set: options.base_set.clone(), seed: options.seed });
        Self {
            title: options.title.clone(),
            runs: run_names(runs)
                .into_iter()
                .zip(runs)
                .map(|(name, results)| RunHead { name, run: results.run.clone() })
                .collect(),
            counts: counts(&drives),
            constant: constant(&drives, runs.iter().any(Results::by_wall_clock)),
            headline: aggregate(&drives, &by, options.seed),
            categories: (Dimension::Category.values(&drives).len() > 1).then(|| split(Dimension::Category)),
            scenarios: split(Dimension::Scenario),
            comparisons,
            bias: (!bias.is_empty()).then_some(bias),
            unfinished: drives.iter().filter_map(unfinished).collect(),
            partial: Vec::new(),
        }
    }

    /// Adds what is wrong with recordings of the runs.
    #[must_use]
    pub fn with_partial(self, partial: Vec<String>) -> Self {
        Self { partial, ..self }
    }
}

/// Returns what varies; the appearance only where the set does not give it, runs only where nothing else tells them
/// apart.
fn headline_by(drives: &[Drive]) -> Vec<Dimension> {
    let varies_within = |dimension: Dimension, by: &[Dimension]| {
        grouped(drives, by).values().any(|drives| dimension.values(drives).len() > 1)
    };
    let wanted = |dimension: &Dimension| match dimension {
        Dimension::Policy => true,
        Dimension::Appearance => varies_within(Dimension::Appearance, &[Dimension::Set]),
        _ => varies_within(*dimension, &[]),
    };
    let mut by: Vec<Dimension> = HEADLINE_BY.into_iter().filter(wanted).collect();
    if varies_within(Dimension::Run, &by) {
        by.insert(0, Dimension::Run);
    }
    by
}

/// A scenario is its name within its set, so splitting by scenario splits by set as well; its family comes along.
fn extended(by: &[Dimension], dimension: Dimension) -> Vec<Dimension> {
    let mut by = by.to_vec();
    if dimension == Dimension::Scenario && !by.contains(&Dimension::Set) {
        by.insert(0, Dimension::Set);
    }
    if dimension == Dimension::Scenario {
        by.insert(0, Dimension::Category);
    }
    by.insert(0, dimension);
    by
}

fn constant(drives: &[Drive], by_wall_clock: bool) -> BTreeMap<&'static str, String> {
    let mut constant = BTreeMap::new();
    if by_wall_clock {
        constant.insert("clock", "wall clock: depends on the machine".to_owned());
    }
    for dimension in HEADLINE_BY.into_iter().chain([Dimension::Profile, Dimension::Category]) {
        let mut values = dimension.values(drives);
        if let (1, Some(value)) = (values.len(), values.pop_first()) {
            constant.insert(dimension.name(), value);
        }
    }
    constant.retain(|_, value| !value.is_empty());
    constant
}

fn unfinished(drive: &Drive) -> Option<Unfinished> {
    let episode = drive.episode;
    (episode.outcome() != Outcome::Completed).then(|| Unfinished {
        run: drive.run.clone(),
        scenario: episode.scenario.clone(),
        set: episode.set.clone(),
        policy: episode.policy.clone(),
        seed: episode.seed,
        status: episode.status.clone(),
        reason: episode.reason.clone(),
        ticks: episode.ticks,
    })
}
