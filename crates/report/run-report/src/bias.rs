//! What a policy's own scorer costs it, and whether its proposals still hold a good one in a changed world.
//!
//! `scorer bias = DS(oracle) - DS(learned)`, paired by scenario: what the policy would gain if it ranked its own
//! proposals well. `proposal coverage = DS(oracle, changed set) - DS(oracle, base set)`: what is lost although ranking
//! is perfect, because no good proposal is there. Beside them the oracle's view of the proposals themselves.
//! Driving scores are headline values; weighting as in `aggregate`.

use std::collections::{BTreeMap, BTreeSet};

use ds_stats::mean;
use serde::Serialize;

use crate::aggregate::{Estimate, WEIGHTING, by_scenario, estimate, grouped};
use crate::bootstrap::{self, Interval};
use crate::compare::{Pair, Pairing, pair};
use crate::dimension::{Dimension, Drive};
use crate::metric::{Applicable, Metric};
use crate::results::ProposalStats;

#[cfg(test)]
mod tests;

/// Scorer of the policy itself.
pub const LEARNED: &str = "learned";
/// What the names of oracle scorers begin with.
pub const ORACLE: &str = "oracle";

/// What the bias is computed from.
#[derive(Debug, Clone)]
pub struct BiasOptions {
    /// The set that changed sets are compared with.
    pub base_set: String,
    /// Seed of the bootstrap.
    pub seed: u64,
}

impl Default for BiasOptions {
    fn default() -> Self {
        Self { base_set: "base".to_owned(), seed: 0 }
    }
}

/// Bias, coverage and proposals of all policies.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Bias {
    /// The set that changed sets are compared with.
    pub base_set: String,
    /// How values are weighted.
    pub weighting: &'static str,
    /// Per policy and set.
    pub scorer: Vec<ScorerBias>,
    /// Per policy and changed set.
    pub coverage: Vec<Coverage>,
    /// Per policy, set and scorer.
    pub proposals: Vec<ProposalSummary>,
}

/// Which drives a row is about.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct Subject {
    /// The policy.
    pub policy: String,
    /// The scenario set.
    pub set: String,
    /// The oracle, or whoever ranked the proposals.
    pub scorer: String,
    /// The observation source.
    pub observation: String,
    /// The score's definition.
    pub profile: String,
}

/// `DS(oracle) - DS(learned)` on the scenarios driven with both.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ScorerBias {
    /// Policy, set and oracle.
    pub subject: Subject,
    /// Driving score with the policy's own ranking.
    pub learned: Option<f64>,
    /// Driving score with the oracle's ranking.
    pub oracle: Option<f64>,
    /// The bias with its interval.
    pub bias: Estimate,
    /// Drives that only one of the scorers has.
    pub unmatched: usize,
}

/// `DS(oracle, changed set) - DS(oracle, base set)`; negative where the changed world is harder to propose for.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Coverage {
    /// Policy, changed set and oracle.
    pub subject: Subject,
    /// Driving score on the base set, over the scenarios used.
    pub base: Option<f64>,
    /// Driving score on the changed set.
    pub changed: Option<f64>,
    /// Their difference.
    pub difference: Option<f64>,
    /// Its interval.
    pub interval: Option<Interval>,
    /// Whether every changed scenario was paired with the base scenario that its name begins with.
    pub paired: bool,
    /// Base scenarios used.
    pub base_scenarios: usize,
    /// Changed scenarios used.
    pub changed_scenarios: usize,
}

/// The oracle's view of the proposals, whoever picked among them.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ProposalSummary {
    /// Policy, set and who picked.
    pub subject: Subject,
    /// Mean score of the best proposal.
    pub best: Estimate,
    /// Share of ticks without any positive proposal.
    pub bare_ticks: Estimate,
    /// Share of scenarios with at least one such tick.
    pub scenarios_with_bare_tick: Estimate,
    /// Share of scenarios without a positive proposal at any tick.
    pub scenarios_without_positive: Estimate,
}

impl Bias {
    /// Says whether there is nothing to show.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.scorer.is_empty() && self.coverage.is_empty() && self.proposals.is_empty()
    }
}

/// Computes bias, coverage and proposals of the drives, as far as they tell.
#[must_use]
pub fn bias(drives: &[Drive], options: &BiasOptions) -> Bias {
    let mut groups: BTreeMap<Subject, Vec<Drive>> = BTreeMap::new();
    let by = [Dimension::Policy, Dimension::Set, Dimension::Scorer, Dimension::Observation, Dimension::Profile];
    for (key, drives) in grouped(drives, &by) {
        if let Ok([policy, set, scorer, observation, profile]) = <[String; 5]>::try_from(key) {
            groups.insert(Subject { policy, set, scorer, observation, profile }, drives);
        }
    }
    let oracles = || groups.iter().filter(|(subject, _)| subject.scorer.starts_with(ORACLE));
    let with = |subject: &Subject, change: &dyn Fn(&mut Subject)| {
        let mut other = subject.clone();
        change(&mut other);
        groups.get(&other)
    };
    let scorer = oracles().filter_map(|(subject, drives)| {
        let learned = with(subject, &|other| other.scorer = LEARNED.to_owned())?;
        Some(scorer_bias(subject.clone(), learned, drives, options.seed))
    });
    let coverage = oracles().filter(|(subject, _)| subject.set != options.base_set).filter_map(|(subject, drives)| {
        let base = with(subject, &|other| other.set.clone_from(&options.base_set))?;
        Some(coverage(subject.clone(), base, drives, options.seed))
    });
    let proposals = groups.iter().filter_map(|(subject, drives)| proposals(subject.clone(), drives, options.seed));
    Bias {
        base_set: options.base_set.clone(),
        weighting: WEIGHTING,
        scorer: scorer.collect(),
        coverage: coverage.collect(),
        proposals: proposals.collect(),
    }
}

fn headline(drives: &[Drive]) -> Option<f64> {
    // What applies matters to sub-metrics only.
    let applicable = Applicable::default();
    mean(drives.iter().filter_map(|drive| Metric::DrivingScore.headline(drive, &applicable)))
}

fn scorer_bias(subject: Subject, learned: &[Drive], oracle: &[Drive], seed: u64) -> ScorerBias {
    let renames = BTreeMap::from([(LEARNED.to_owned(), subject.scorer.clone())]);
    let pairing = Pairing { renames: BTreeMap::from([(Dimension::Scorer, renames)]), by: Vec::new() };
    let joined = pair(learned, oracle, &pairing);
    let mut units: BTreeMap<_, Vec<(f64, f64)>> = BTreeMap::new();
    for Pair { a, b } in &joined.pairs {
        if let (Some(learned), Some(oracle)) = (headline(a), headline(b)) {
            units.entry(a[0].unit()).or_default().push((learned, oracle));
        }
    }
    let over = |value: &dyn Fn(&(f64, f64)) -> f64| -> Vec<f64> {
        units.values().filter_map(|pairs| mean(pairs.iter().map(value))).collect()
    };
    let differences = over(&|(learned, oracle)| oracle - learned);
    ScorerBias {
        subject,
        learned: mean(over(&|(learned, _)| *learned)),
        oracle: mean(over(&|(_, oracle)| *oracle)),
        bias: Estimate {
            mean: mean(differences.iter().copied()),
            interval: bootstrap::mean_interval(&differences, &bootstrap::draws(seed)),
            scenarios: differences.len(),
        },
        unmatched: joined.unmatched.iter().map(|unmatched| unmatched.episodes).sum(),
    }
}

fn coverage(subject: Subject, base: &[Drive], changed: &[Drive], seed: u64) -> Coverage {
    let scores = |drives: &[Drive]| -> BTreeMap<String, f64> {
        let score = |((_, scenario), drives): ((String, String), Vec<&Drive>)| {
            let drives: Vec<Drive> = drives.into_iter().cloned().collect();
            Some((scenario, headline(&drives)?))
        };
        by_scenario(drives).into_iter().filter_map(score).collect()
    };
    let (base, changed) = (scores(base), scores(changed));
    let names: BTreeSet<&str> = base.keys().map(String::as_str).collect();
    let mut families: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for (name, score) in &changed {
        if let Some(base) = base_name(name, &names) {
            families.entry(base).or_default().push(*score);
        }
    }
    let paired = !changed.is_empty() && families.values().map(Vec::len).sum::<usize>() == changed.len();
    let (before, after): (Vec<f64>, Vec<f64>) = if paired {
        families.iter().filter_map(|(name, scores)| Some((base[*name], mean(scores.iter().copied())?))).unzip()
    } else {
        (base.values().copied().collect(), changed.values().copied().collect())
    };
    let means = (mean(before.iter().copied()), mean(after.iter().copied()));
    let interval = if paired {
        let differences: Vec<f64> = before.iter().zip(&after).map(|(before, after)| after - before).collect();
        bootstrap::mean_interval(&differences, &bootstrap::draws(seed))
    } else {
        bootstrap::difference_interval(&after, &before, seed)
    };
    Coverage {
        subject,
        base: means.0,
        changed: means.1,
        difference: means.0.zip(means.1).map(|(base, changed)| changed - base),
        interval,
        paired,
        base_scenarios: before.len(),
        changed_scenarios: changed.len(),
    }
}

/// Returns the base scenario that a changed scenario's name begins with, up to `.`, `__` or `--`; the longest if
/// several do. `cut-in.fog` and `cut-in__late-cut-in` belong to `cut-in`, `cut-in-wide` does not.
#[must_use]
pub fn base_name<'a>(name: &str, base_names: &BTreeSet<&'a str>) -> Option<&'a str> {
    let belongs = |base: &&&str| {
        let rest = name.strip_prefix(**base);
        rest.is_some_and(|rest| rest.is_empty() || [".", "__", "--"].iter().any(|mark| rest.starts_with(mark)))
    };
    base_names.iter().filter(belongs).max_by_key(|base| base.len()).copied()
}

fn proposals(subject: Subject, drives: &[Drive], seed: u64) -> Option<ProposalSummary> {
    let stats = |drive: &Drive| drive.episode.proposals.filter(|proposals| proposals.ticks > 0);
    if !drives.iter().any(|drive| stats(drive).is_some()) {
        return None;
    }
    let over = |value: &dyn Fn(ProposalStats) -> f64| estimate(drives, seed, &|drive| stats(drive).map(value));
    let bare = |p: ProposalStats| f64::from(p.ticks_without_positive) / f64::from(p.ticks);
    // A scenario counts as soon as one of its drives does, so the share is over scenarios, not drives.
    let share = |counts: &dyn Fn(ProposalStats) -> bool| {
        let worst = by_scenario(drives).into_iter().filter_map(|(unit, drives)| {
            let known: Vec<bool> = drives.iter().filter_map(|drive| stats(drive).map(counts)).collect();
            (!known.is_empty()).then(|| (unit, f64::from(u8::from(known.contains(&true)))))
        });
        let worst: BTreeMap<_, f64> = worst.collect();
        estimate(drives, seed, &|drive| worst.get(&drive.unit()).copied())
    };
    Some(ProposalSummary {
        best: over(&|p| p.best_mean),
        bare_ticks: over(&bare),
        scenarios_with_bare_tick: share(&|p| p.ticks_without_positive > 0),
        scenarios_without_positive: share(&|p| p.ticks_without_positive == p.ticks),
        subject,
    })
}
