//! Which members of a fleet differ, and how common each effect is among them: every member is diagnosed against a baseline
//! of the others, and those that differ are taken out of it.
//!
//! A member is called affected by e-values under a false discovery rate (e-BH: Wang and Ramdas, arXiv 2009.02824), which
//! holds whatever the members share; the e-value is the mean of the Bayes factors of all effects. How common an effect is
//! follows by expectation and maximisation over the same factors, a member having one effect or none.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use ds_diagnosis::{CaseError, Diagnosis};
use ds_effect::Scale;
use ds_stats::log_sum;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::baseline::Baseline;
use crate::diagnose::{Options, diagnose};
use crate::healthy::{Healthy, Progress, Reference};
use crate::settings::{LIMIT_GAIN, Thresholds};

/// Version of the file.
pub const SCHEMA: u32 = 1;
/// Share of the members called affected that may be called so wrongly.
pub const FALSE_DISCOVERIES: f64 = 0.1;
/// Members from which on some can be told from the others.
const LEAST: usize = 4;
/// Of so many members one is taken for affected at first.
const HIDING: usize = 4;
/// How often members that differ are taken out of the reference, at most.
const ROUNDS: usize = 5;
/// Steps of expectation and maximisation.
const STEPS: usize = 200;

/// What is said of a fleet.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Fleet {
    /// Version of this schema.
    pub schema_version: u32,
    /// What a member is: `vehicle`, `day` or `software`.
    pub by: String,
    /// Share of the affected members that may be called so wrongly.
    pub false_discovery_rate: f64,
    /// Every member, the likeliest affected first.
    pub members: Vec<Member>,
    /// Every effect that some member is likelier to have than not, the commonest first.
    pub effects: Vec<Common>,
    /// What can be told with so few members, and what cannot.
    pub warnings: Vec<String>,
}

/// One member of a fleet.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Member {
    /// Its name.
    pub name: String,
    /// Names of its cases.
    pub cases: Vec<String>,
    /// Whether it is called affected.
    pub affected: bool,
    /// Logarithm of its e-value against being like the others.
    pub log_e: f64,
    /// Probability to have no effect that the others have not.
    pub p_none: f64,
    /// Probability of each effect above one in a hundred, the likeliest first.
    pub effects: Vec<Suspicion>,
    /// Cases in which something is left that no effect explains.
    pub unexplained: Vec<String>,
}

/// An effect that a member may have.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Suspicion {
    /// The effect.
    pub id: String,
    /// Its probability, given how common it is.
    pub probability: f64,
    /// Log evidence over all cases of the member, in units in which a healthy log reaches what the library's cars do.
    pub log_bayes: f64,
    /// Its value in the case that tells most, relative to the others.
    pub value: f64,
    /// Unit of the value.
    pub unit: String,
    /// 90 % interval of the value.
    pub interval90: [f64; 2],
}

/// How common an effect is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Common {
    /// The effect.
    pub id: String,
    /// Share of members that have it, by the posterior mean.
    pub share: f64,
    /// Members that are called affected and have it first.
    pub members: Vec<String>,
    /// Mean of its value over these.
    pub value: f64,
    /// Unit of the value.
    pub unit: String,
}

/// Diagnoses a fleet: `of` names the member of each case. Returns what is said of it, and the diagnosis of every case
/// against the members that are like each other, less its own. `progress` is told [`steps`] times.
///
/// # Errors
/// If there are fewer than four members.
pub fn fleet(
    cases: Vec<Healthy>,
    by: &str,
    of: &[String],
    options: &Options,
    progress: Progress<'_>,
) -> Result<(Fleet, Vec<Diagnosis>), CaseError> {
    let names: Vec<&String> = of.iter().collect::<BTreeSet<_>>().into_iter().collect();
    if names.len() < LEAST {
        return Err(CaseError::SmallFleet { members: names.len(), least: LEAST });
    }
    let group: Vec<usize> = of.iter().filter_map(|name| names.binary_search(&name).ok()).collect();
    let mut warnings = Vec::new();
    let mut out = BTreeSet::new();
    let reference = Reference::study(&cases, progress);
    let mut shown = cases;
    let mut round = 0;
    let (diagnoses, factors, affected) = loop {
        let baselines = against(&shown, &reference, &group, names.len(), &out);
        let done: Progress<'_> = if round == 0 { progress } else { &|| () };
        let diagnoses = diagnosed(&mut shown, &baselines, &group, options, done);
        let factors = factors(&diagnoses, &baselines, &group);
        let e_values: Vec<f64> = factors.iter().map(log_e).collect();
        let affected = discovered(&e_values);
        let settled = affected == out;
        let divided = !settled && 2 * affected.len() >= names.len();
        if divided {
            warnings.push("half of the members or more differ from the rest: there is no majority to go by".to_owned());
        }
        round += 1;
        if settled || divided || round == ROUNDS {
            break (diagnoses, factors, affected);
        }
        // members that share a fault hide each other: at first the likeliest stay out whether or not they were called
        let careful = if round == 1 { names.len().div_ceil(HIDING) } else { 0 };
        out = affected.into_iter().chain(largest(&e_values).into_iter().take(careful)).collect();
    };
    let told = Round { names: &names, group: &group, cases: &shown, diagnoses: &diagnoses, factors: &factors };
    let fleet = told.fleet(by, &affected, warnings);
    Ok((fleet, diagnoses))
}

/// Returns how often the progress is told over some cases.
#[must_use]
pub fn steps(cases: usize) -> u64 {
    2 * cases as u64
}

/// Log Bayes factors of one member by effect.
type Factors = BTreeMap<String, f64>;

/// Returns the baseline for each member: of all others but those taken out.
fn against(
    cases: &[Healthy],
    reference: &Reference,
    group: &[usize],
    members: usize,
    out: &BTreeSet<usize>,
) -> Vec<Arc<Baseline>> {
    let kept = |member: usize| -> Vec<usize> {
        (0..cases.len()).filter(|k| group[*k] != member && !out.contains(&group[*k])).collect()
    };
    let whole: Vec<usize> = (0..cases.len()).filter(|k| !out.contains(&group[*k])).collect();
    let judged = reference.judged(cases, &whole);
    (0..members).map(|member| Arc::new(reference.baseline(cases, &kept(member), &judged))).collect()
}

fn diagnosed(
    cases: &mut [Healthy],
    baselines: &[Arc<Baseline>],
    group: &[usize],
    options: &Options,
    done: &(dyn Fn() + Sync),
) -> Vec<Diagnosis> {
    let one = |(healthy, member): (&mut Healthy, &usize)| {
        healthy.case.baseline = Some(baselines[*member].clone());
        let mut found = diagnose(&healthy.case, options);
        found.case.clone_from(&healthy.name);
        done();
        found
    };
    cases.par_iter_mut().zip(group).map(one).collect()
}

/// Returns the log Bayes factors of every member: over its cases the sum, in units in which healthy logs reach what the
/// library's cars do.
fn factors(diagnoses: &[Diagnosis], baselines: &[Arc<Baseline>], group: &[usize]) -> Vec<Factors> {
    let library = Thresholds::default();
    let mut all = vec![Factors::new(); baselines.len()];
    for (diagnosis, member) in diagnoses.iter().zip(group) {
        for finding in &diagnosis.effects {
            let part = usize::from(finding.id.starts_with("tr_"));
            let scale = baselines[*member].thresholds(part, &library).single_gain / library.single_gain;
            *all[*member].entry(finding.id.clone()).or_default() += (finding.evidence_gain - cost(&finding.id)) / scale;
        }
    }
    all
}

/// Returns the evidence that an effect must have beyond others, as in a diagnosis: a limit, which no vehicle has a little of.
fn cost(id: &str) -> f64 {
    let limit = ds_effect::find(id).is_some_and(|e| e.parameters.iter().any(|p| p.scale == Scale::Limit));
    if limit { LIMIT_GAIN } else { 0.0 }
}

/// Returns the logarithm of the mean of Bayes factors.
fn log_e(factors: &Factors) -> f64 {
    log_sum(factors.values().copied()) - (factors.len().max(1) as f64).ln()
}

/// Returns the members by their e-values, the largest first.
fn largest(log_e: &[f64]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..log_e.len()).collect();
    order.sort_by(|a, b| log_e[*b].total_cmp(&log_e[*a]).then(a.cmp(b)));
    order
}

/// Returns the members whose e-values are discoveries: of the k largest, each at least members over k times the rate.
fn discovered(log_e: &[f64]) -> BTreeSet<usize> {
    let order = largest(log_e);
    let asked = |k: usize| (log_e.len() as f64 / (FALSE_DISCOVERIES * (k + 1) as f64)).ln();
    let count = (0..order.len()).rev().find(|k| log_e[order[*k]] >= asked(*k)).map_or(0, |k| k + 1);
    order.into_iter().take(count).collect()
}

/// Returns the share of members that have each effect, by the posterior mean: to have one or none under Beta(½, ½), which one
/// beforehand alike.
fn shares(factors: &[Factors]) -> BTreeMap<String, f64> {
    let ids: BTreeSet<&String> = factors.iter().flat_map(Factors::keys).collect();
    let (effects, members) = (ids.len() as f64, factors.len() as f64);
    let mut shares: BTreeMap<String, f64> = ids.iter().map(|id| ((*id).clone(), 0.5 / effects)).collect();
    for _ in 0..STEPS {
        let mut counts: BTreeMap<&String, f64> = BTreeMap::new();
        for own in factors {
            for (id, p) in posterior(own, &shares).0 {
                *counts.entry(id).or_default() += p;
            }
        }
        let of = |id: &&String| {
            let count = counts.get(*id).copied().unwrap_or(0.0);
            ((*id).clone(), (0.5 / effects + count) / (1.0 + members))
        };
        shares = ids.iter().map(of).collect();
    }
    shares
}

/// Returns the probability of each effect of a member and that of none, given how common the effects are.
fn posterior<'a>(own: &'a Factors, shares: &BTreeMap<String, f64>) -> (Vec<(&'a String, f64)>, f64) {
    let none = (1.0 - shares.values().sum::<f64>()).max(1e-3).ln();
    let logs: Vec<(&String, f64)> =
        own.iter().map(|(id, factor)| (id, factor + shares.get(id).copied().unwrap_or(1e-3).ln())).collect();
    let total = log_sum(logs.iter().map(|l| l.1).chain([none]));
    (logs.into_iter().map(|(id, l)| (id, (l - total).exp())).collect(), (none - total).exp())
}

/// What the last round found.
struct Round<'a> {
    names: &'a [&'a String],
    group: &'a [usize],
    cases: &'a [Healthy],
    diagnoses: &'a [Diagnosis],
    factors: &'a [Factors],
}

impl Round<'_> {
    fn fleet(&self, by: &str, affected: &BTreeSet<usize>, warnings: Vec<String>) -> Fleet {
        let shares = shares(self.factors);
        let mut members: Vec<Member> =
            (0..self.names.len()).map(|m| self.member(m, affected.contains(&m), &shares)).collect();
        members.sort_by(|a, b| b.log_e.total_cmp(&a.log_e).then_with(|| a.name.cmp(&b.name)));
        Fleet {
            schema_version: SCHEMA,
            by: by.to_owned(),
            false_discovery_rate: FALSE_DISCOVERIES,
            effects: common(&members, &shares),
            members,
            warnings,
        }
    }

    fn member(&self, member: usize, affected: bool, shares: &BTreeMap<String, f64>) -> Member {
        let own: Vec<usize> = (0..self.cases.len()).filter(|k| self.group[*k] == member).collect();
        let (found, p_none) = posterior(&self.factors[member], shares);
        let mut effects: Vec<Suspicion> = found
            .into_iter()
            .filter(|(_, probability)| *probability > 0.01)
            .filter_map(|(id, probability)| self.suspicion(id, probability, &own))
            .collect();
        effects.sort_by(|a, b| b.probability.total_cmp(&a.probability));
        let unexplained = own.iter().filter(|k| self.diagnoses[**k].p_unknown > 0.5);
        Member {
            name: self.names[member].clone(),
            cases: own.iter().map(|k| self.cases[*k].name.clone()).collect(),
            affected,
            log_e: log_e(&self.factors[member]),
            p_none,
            effects,
            unexplained: unexplained.map(|k| self.cases[*k].name.clone()).collect(),
        }
    }

    fn suspicion(&self, id: &str, probability: f64, own: &[usize]) -> Option<Suspicion> {
        let findings = own.iter().filter_map(|k| self.diagnoses[*k].effects.iter().find(|f| f.id == id));
        let best = findings.max_by(|a, b| a.evidence_gain.total_cmp(&b.evidence_gain))?;
        let member = self.group[*own.first()?];
        Some(Suspicion {
            id: id.to_owned(),
            probability,
            log_bayes: self.factors[member].get(id).copied().unwrap_or(0.0),
            value: best.value,
            unit: best.unit.clone(),
            interval90: best.interval90,
        })
    }
}

fn common(members: &[Member], shares: &BTreeMap<String, f64>) -> Vec<Common> {
    let of = |(id, share): (&String, &f64)| {
        let having: Vec<(&Member, &Suspicion)> = members
            .iter()
            .filter(|m| m.affected)
            .filter_map(|m| m.effects.first().filter(|s| s.id == *id).map(|s| (m, s)))
            .collect();
        let (_, first) = having.first()?;
        Some(Common {
            id: id.clone(),
            share: *share,
            members: having.iter().map(|(m, _)| m.name.clone()).collect(),
            value: ds_stats::mean(having.iter().map(|(_, s)| s.value))?,
            unit: first.unit.clone(),
        })
    };
    let mut all: Vec<Common> = shares.iter().filter_map(of).collect();
    all.sort_by(|a, b| b.share.total_cmp(&a.share));
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn discoveries_need_more_evidence_the_fewer_they_are() {
        let found = |e: &[f64]| discovered(&e.iter().map(|e: &f64| e.ln()).collect::<Vec<_>>());
        assert_eq!(found(&[39.0, 1.0, 1.0, 1.0]), BTreeSet::new());
        assert_eq!(found(&[41.0, 1.0, 1.0, 1.0]), BTreeSet::from([0]));
        assert_eq!(found(&[1.0, 21.0, 21.0, 1.0]), BTreeSet::from([1, 2]));
        assert_eq!(found(&[]), BTreeSet::new());
    }

    #[test]
    fn an_effect_that_others_have_is_likelier() {
        let own = |a: f64, b: f64| Factors::from([("a".to_owned(), a), ("b".to_owned(), b)]);
        let common = shares(&[own(9.0, 0.0), own(9.0, 0.0), own(9.0, 0.0), own(0.0, 0.0)]);
        assert!(common["a"] > 0.5 && common["b"] < 0.2, "{common:?}");
        let alike = own(3.0, 3.0);
        let (found, none) = posterior(&alike, &common);
        assert!(found[0].1 > 2.0 * found[1].1, "{found:?}");
        assert!((found.iter().map(|f| f.1).sum::<f64>() + none - 1.0).abs() < 1e-9);
    }
}
