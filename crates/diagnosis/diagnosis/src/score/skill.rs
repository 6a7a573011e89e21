//! How good the probabilities are: the Brier score over all answers at once, beside a constant that knows no case.
//!
//! Answers are *none*, *unknown* and each set of effects; B is the mean of Σₖ (pₖ − yₖ)², from 0 (sure and right) to 2 (sure
//! and wrong, and so a refused case counts). The constant answers each case with the frequencies of the answers among cases of
//! other engines; skill is 1 − B / B of the constant (Brier 1950; Murphy 1973).

use std::collections::BTreeMap;

use serde::Serialize;

use super::Label;
use crate::schema::Diagnosis;

/// B where an answer is refused.
const REFUSED: f64 = 2.0;
/// Rows of the table of reliability.
const ROWS: usize = 5;

/// One answer: no effect, none of the library's, or a set.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
enum Answer {
    None,
    Unknown,
    Set(Vec<String>),
}

impl Answer {
    fn of(label: &Label) -> Self {
        match label.kind.as_str() {
            "none" => Self::None,
            "out_of_library" => Self::Unknown,
            _ => Self::set(label.effects.iter().map(|effect| &effect.id)),
        }
    }

    fn set<'a>(ids: impl Iterator<Item = &'a String>) -> Self {
        let mut ids: Vec<String> = ids.cloned().collect();
        ids.sort();
        Self::Set(ids)
    }
}

/// The Brier score over all answers, and the constant's.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Skill {
    /// B of the diagnoses.
    pub brier: f64,
    /// B of the constant, where other engines say how often what occurs.
    pub constant: Option<f64>,
    /// 1 − B / B of the constant.
    pub skill: Option<f64>,
    /// Cases.
    pub cases: usize,
}

/// One row of a table of reliability: cases whose answers are stated with about equal probability.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Reliability {
    /// Mean of the stated probabilities.
    pub stated: f64,
    /// Share of the answers that are right.
    pub right: f64,
    /// Cases.
    pub cases: usize,
}

/// Returns the skill of diagnoses beside the frequencies of the answers among labels of other engines, if there are some.
#[must_use]
pub fn skill(diagnoses: &BTreeMap<String, Diagnosis>, labels: &BTreeMap<String, Label>, others: &[&Label]) -> Skill {
    let of = |(name, label): (&String, &Label)| diagnoses.get(name).map_or(REFUSED, |d| brier(&stated(d), label));
    let mean = |all: Vec<f64>| ds_stats::mean(all).unwrap_or_default();
    let found = mean(labels.iter().map(of).collect());
    let mut usual: BTreeMap<Answer, f64> = BTreeMap::new();
    for other in others {
        *usual.entry(Answer::of(other)).or_default() += 1.0 / others.len() as f64;
    }
    let constant = (!others.is_empty()).then(|| mean(labels.values().map(|label| brier(&usual, label)).collect()));
    let skill = constant.filter(|b| *b > 0.0).map(|constant| 1.0 - found / constant);
    Skill { brier: found, constant, skill, cases: labels.len() }
}

/// Returns the probability of each answer; effects that were chosen together are one answer.
fn stated(d: &Diagnosis) -> BTreeMap<Answer, f64> {
    let mut out = BTreeMap::from([(Answer::None, d.p_none), (Answer::Unknown, d.p_unknown)]);
    for effect in &d.effects {
        let together = d.chosen.contains(&effect.id);
        let answer = if together { Answer::set(d.chosen.iter()) } else { Answer::set([&effect.id].into_iter()) };
        *out.entry(answer).or_default() += effect.probability;
    }
    out
}

fn brier(stated: &BTreeMap<Answer, f64>, label: &Label) -> f64 {
    let truth = Answer::of(label);
    let others: f64 = stated.iter().filter(|(answer, _)| **answer != truth).map(|(_, p)| p * p).sum();
    others + (1.0 - stated.get(&truth).copied().unwrap_or_default()).powi(2)
}

/// Returns how often answers are right by how sure they are, least sure first, in rows of equally many cases.
#[must_use]
pub fn reliability(sure: &[(f64, bool)]) -> Vec<Reliability> {
    let mut sure = sure.to_vec();
    sure.sort_by(|a, b| a.0.total_cmp(&b.0));
    let rows = ROWS.min(sure.len());
    let row = |k: usize| {
        let part = &sure[k * sure.len() / rows..(k + 1) * sure.len() / rows];
        let share = |of: &dyn Fn(&(f64, bool)) -> f64| part.iter().map(of).sum::<f64>() / part.len() as f64;
        Reliability { stated: share(&|s| s.0), right: share(&|s| f64::from(u8::from(s.1))), cases: part.len() }
    };
    (0..rows).map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::score::LabelEffect;

    fn label(kind: &str, ids: &[&str]) -> Label {
        let effect =
            |id: &&str| LabelEffect { id: (*id).to_owned(), value: 0.1, floor_units: None, group: String::new() };
        Label { kind: kind.to_owned(), effects: ids.iter().map(effect).collect() }
    }

    fn none(p_none: f64) -> Diagnosis {
        Diagnosis { p_none, p_unknown: 1.0 - p_none, ..Diagnosis::blank("a") }
    }

    fn of(found: &[(&str, Diagnosis)], labels: &[(&str, Label)], others: &[&Label]) -> Skill {
        let found = found.iter().map(|(name, d)| ((*name).to_owned(), d.clone())).collect();
        skill(&found, &labels.iter().map(|(name, l)| ((*name).to_owned(), l.clone())).collect(), others)
    }

    #[test]
    fn sure_and_right_is_nothing_and_refused_is_two() {
        let labels = [("a", label("none", &[])), ("b", label("single", &["mu"]))];
        let both = of(&[("a", none(1.0))], &labels, &[]);
        assert_eq!((both.brier, both.constant, both.skill, both.cases), (1.0, None, None, 2));
        let half = of(&[("a", none(0.5))], &labels[..1], &[]);
        assert!((half.brier - 0.5).abs() < 1e-12, "{half:?}");
    }

    #[test]
    fn a_constant_has_no_skill_and_certainty_has_all() {
        let (healthy, sick) = (label("none", &[]), label("single", &["mu"]));
        let others = [&healthy, &healthy, &healthy, &sick];
        let labels = [("a", healthy.clone()), ("b", healthy.clone()), ("c", healthy.clone()), ("d", sick.clone())];
        let flat = none(0.75);
        let constant = Diagnosis { p_unknown: 0.25, ..flat };
        let found = ["a", "b", "c"].map(|name| (name, constant.clone()));
        // B of the constant: 3/4 · 2 · (1/4)² + 1/4 · 2 · (3/4)² = 0.375
        let skill = of(&found, &labels, &others);
        assert!((skill.constant.expect("others") - 0.375).abs() < 1e-12, "{skill:?}");
        let sure = of(&["a", "b", "c"].map(|name| (name, none(1.0))), &labels[..3], &others);
        assert_eq!(sure.skill, Some(1.0));
    }

    #[test]
    fn rows_hold_equally_many_cases() {
        let sure: Vec<(f64, bool)> = (0..10).map(|k| (f64::from(k) / 10.0, k >= 5)).collect();
        let rows = reliability(&sure);
        assert_eq!(rows.iter().map(|row| row.cases).collect::<Vec<_>>(), [2; 5]);
        assert!((rows[0].stated - 0.05).abs() < 1e-12 && rows[0].right == 0.0 && rows[4].right == 1.0, "{rows:?}");
        assert!(reliability(&[]).is_empty());
    }
}
