//! How far drives on the frames of a source lie from the same drives on the reference camera's frames.
//!
//! Paired by policy, scenario and seed: |DS on the source − DS on the reference|, in points of 0 to 100. Intervals over
//! scenarios; whether one source lies nearer than another by sign flips, corrected by Holm over all questions asked.

use std::collections::{BTreeMap, BTreeSet};

use ds_fidelity::recentred;
use ds_space::Draws;
use ds_stats::bootstrap::resamples;
use ds_stats::{holm, sign_flip, spearman};
use serde::{Deserialize, Serialize};

use super::outcome::Figure;

/// The source that others are compared with.
pub const REFERENCE: &str = "reference";

/// One drive.
#[derive(Debug, Clone, PartialEq)]
pub struct Drive {
    /// Who drove.
    pub policy: String,
    /// On which frames.
    pub source: String,
    /// What is paired: scenario and seed.
    pub unit: String,
    /// DS, 0 to 100.
    pub driving_score: f64,
}

/// A policy on a source, against the same policy on the reference.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Gap {
    /// Paired drives.
    pub drives: usize,
    /// Mean |DS − DS on the reference|.
    pub distance: Figure,
    /// Mean DS − DS on the reference.
    pub difference: Figure,
    /// Mean DS on the source.
    pub driving_score: Figure,
    /// Rank correlation of the DS of single scenarios; none where all are equal.
    pub spearman: Option<f64>,
}

/// Whether one source lies nearer to the reference than another, for one policy.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Nearer {
    /// The policy.
    pub policy: String,
    /// The source that is asked about.
    pub source: String,
    /// The one that it is compared with.
    pub than: String,
    /// Mean |DS − DS on the reference| of the first less that of the second: below zero is nearer.
    pub apart: Figure,
    /// By sign flips, two-sided.
    pub p: f64,
    /// Corrected over all questions (Holm).
    pub p_holm: f64,
}

/// What was found.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ClosedLoop {
    /// Whether amounts were cut down for a look.
    pub quick: bool,
    /// Scenario sets that were driven.
    pub sets: Vec<String>,
    /// By policy: DS on the reference.
    pub reference: BTreeMap<String, Figure>,
    /// By policy, then source.
    pub gaps: BTreeMap<String, BTreeMap<String, Gap>>,
    /// Comparisons of sources.
    pub nearer: Vec<Nearer>,
    /// By source: policies from best to worst mean DS.
    pub order: BTreeMap<String, Vec<String>>,
    /// Drives without a score or without a counterpart, which count nowhere.
    pub left_out: usize,
}

/// Compares drives; `questions` are pairs (source, than).
#[must_use]
pub fn compare(drives: &[Drive], questions: &[[String; 2]], draws: u64) -> ClosedLoop {
    let mut scores: BTreeMap<(&str, &str), BTreeMap<&str, f64>> = BTreeMap::new();
    for drive in drives {
        scores.entry((&drive.policy, &drive.source)).or_default().insert(&drive.unit, drive.driving_score);
    }
    let policies: BTreeSet<&str> = drives.iter().map(|drive| drive.policy.as_str()).collect();
    let sources: BTreeSet<&str> = drives.iter().map(|drive| drive.source.as_str()).collect();
    let mut found = ClosedLoop::default();
    let paired = |policy: &str, source: &str| -> Vec<(&str, f64, f64)> {
        let (Some(own), Some(real)) = (scores.get(&(policy, source)), scores.get(&(policy, REFERENCE))) else {
            return Vec::new();
        };
        own.iter().filter_map(|(unit, score)| Some((*unit, *score, *real.get(unit)?))).collect()
    };
    for policy in &policies {
        if let Some(real) = scores.get(&(*policy, REFERENCE)) {
            let real: Vec<f64> = real.values().copied().collect();
            found.reference.insert((*policy).to_owned(), mean(&real, draws));
        }
        for source in sources.iter().filter(|source| **source != REFERENCE) {
            let pairs = paired(policy, source);
            found.left_out += scores.get(&(*policy, *source)).map_or(0, BTreeMap::len) - pairs.len();
            if pairs.is_empty() {
                continue;
            }
            let [own, real]: [Vec<f64>; 2] =
                [pairs.iter().map(|pair| pair.1).collect(), pairs.iter().map(|pair| pair.2).collect()];
            let apart: Vec<f64> = own.iter().zip(&real).map(|(own, real)| own - real).collect();
            let far: Vec<f64> = apart.iter().map(|value| value.abs()).collect();
            let gap = Gap {
                drives: pairs.len(),
                distance: mean(&far, draws),
                difference: mean(&apart, draws),
                driving_score: mean(&own, draws),
                spearman: spearman(&own, &real),
            };
            found.gaps.entry((*policy).to_owned()).or_default().insert((*source).to_owned(), gap);
        }
    }
    for [source, than] in questions {
        for policy in &policies {
            let other: BTreeMap<&str, f64> =
                paired(policy, than).into_iter().map(|(unit, own, real)| (unit, (own - real).abs())).collect();
            let apart: Vec<f64> = paired(policy, source)
                .into_iter()
                .filter_map(|(unit, own, real)| Some((own - real).abs() - other.get(unit)?))
                .collect();
            let chance = sign_flip(&apart, &Draws::from_seed(0, "closed loop flips"));
            found.nearer.extend(chance.map(|chance| Nearer {
                policy: (*policy).to_owned(),
                source: source.clone(),
                than: than.clone(),
                apart: mean(&apart, draws),
                p: chance.p,
                p_holm: 1.0,
            }));
        }
    }
    let corrected = holm(&found.nearer.iter().map(|nearer| nearer.p).collect::<Vec<_>>());
    found.nearer.iter_mut().zip(corrected).for_each(|(nearer, p)| nearer.p_holm = p);
    for source in &sources {
        let score = |policy: &str| {
            let all = scores.get(&(policy, *source))?;
            Some((policy.to_owned(), all.values().sum::<f64>() / all.len() as f64))
        };
        let mut order: Vec<(String, f64)> = policies.iter().filter_map(|policy| score(policy)).collect();
        order.sort_by(|a, b| b.1.total_cmp(&a.1).then_with(|| a.0.cmp(&b.0)));
        found.order.insert((*source).to_owned(), order.into_iter().map(|(policy, _)| policy).collect());
    }
    found
}

/// Returns a mean with its interval over units drawn anew.
fn mean(values: &[f64], draws: u64) -> Figure {
    let all = values.iter().sum::<f64>() / values.len().max(1) as f64;
    let stream = Draws::from_seed(0, "closed loop bootstrap");
    let picked = resamples(&stream, draws, values.len());
    let drawn = picked.map(|picks| picks.iter().map(|pick| values[*pick]).sum::<f64>() / picks.len().max(1) as f64);
    Figure::of(recentred(all, drawn.collect()), 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drive(policy: &str, source: &str, unit: usize, driving_score: f64) -> Drive {
        Drive { policy: policy.to_owned(), source: source.to_owned(), unit: unit.to_string(), driving_score }
    }

    #[test]
    fn distances_are_paired_and_corrected() {
        let mut drives = Vec::new();
        for unit in 0..20 {
            let real = 40.0 + unit as f64;
            drives.push(drive("p", REFERENCE, unit, real));
            drives.push(drive("p", "near", unit, real + if unit % 2 == 0 { 1.0 } else { -1.0 }));
            drives.push(drive("p", "far", unit, real - 10.0));
            drives.push(drive("q", REFERENCE, unit, 90.0));
        }
        drives.push(drive("p", "far", 99, 0.0));
        let asked = [["near".to_owned(), "far".to_owned()]];
        let found = compare(&drives, &asked, 200);
        let gap = &found.gaps["p"]["near"];
        assert_eq!((gap.drives, gap.distance.value, gap.difference.value), (20, 1.0, 0.0));
        assert_eq!(found.gaps["p"]["far"].difference.value, -10.0);
        assert_eq!((found.left_out, found.nearer.len()), (1, 1), "q drove on no other frames");
        let nearer = &found.nearer[0];
        assert!(nearer.apart.value == -9.0 && nearer.p < 0.001 && nearer.p_holm >= nearer.p, "{nearer:?}");
        assert_eq!(found.order[REFERENCE], ["q", "p"]);
        assert_eq!(found, compare(&drives, &asked, 200));
    }
}
