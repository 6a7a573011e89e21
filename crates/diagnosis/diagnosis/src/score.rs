//! Scores diagnoses against labels: the figures of the specification, section 5, each with its count.

pub mod skill;

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

use ds_effect::Verdict;
use serde::{Deserialize, Serialize};

use crate::error::CaseError;
use crate::json;
use crate::schema::{self, Diagnosis};
use skill::{Reliability, Skill};

/// Most members of a group that is worth reporting.
pub const GROUP_SIZE: usize = 4;
/// Size in floor units beyond which a score demands that an effect be found up to its group.
const FAIR_SIZE: f64 = 2.0;

/// The truth about one case.
#[derive(Debug, Clone, Deserialize)]
pub struct Label {
    /// none, single, double or `out_of_library`.
    pub kind: String,
    /// Effects that were switched on.
    #[serde(default)]
    pub effects: Vec<LabelEffect>,
}

/// One effect of a label.
#[derive(Debug, Clone, Deserialize)]
pub struct LabelEffect {
    /// Its id.
    pub id: String,
    /// Its value.
    pub value: f64,
    /// Size in floor units, where it is known.
    #[serde(default)]
    pub floor_units: Option<f64>,
    /// Effects that short logs can hardly separate share a group.
    #[serde(default)]
    pub group: String,
}

/// A share of cases with its count and a 90 % Wilson interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Share {
    /// Cases that count as right.
    pub hits: usize,
    /// Cases that count.
    pub of: usize,
    /// hits / of, 0 where nothing counts.
    pub value: f64,
    /// 90 % Wilson score interval.
    pub interval90: [f64; 2],
}

impl Share {
    /// Counts a share.
    #[must_use]
    pub fn new(hits: usize, of: usize) -> Self {
        let value = if of == 0 { 0.0 } else { hits as f64 / of as f64 };
        Self { hits, of, value, interval90: ds_stats::wilson(hits, of, 1.645) }
    }
}

impl fmt::Display for Share {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [low, high] = self.interval90;
        write!(f, "{} of {} = {:.2} [{low:.2}, {high:.2}]", self.hits, self.of, self.value)
    }
}

/// All figures.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Scores {
    /// Each share by name.
    pub shares: BTreeMap<&'static str, Option<Share>>,
    /// Mean Brier score of the first probability being right.
    pub brier: f64,
    /// The same over all answers at once, beside a constant.
    pub skill: Option<Skill>,
    /// How often answers are right by how sure they are.
    pub reliability: Vec<Reliability>,
    /// Expected calibration error of the first probability, up to ten bins of equal mass.
    pub calibration_error: f64,
    /// Median of |estimate - truth| over |truth - neutral|, right singles only.
    pub relative_error: f64,
    /// Median of |predicted - realised share|, cases with a gap of `position_2s` only.
    pub share_error: f64,
    /// Cases that have a label but no diagnosis; they count as wrong.
    pub absent: Vec<String>,
}

/// Reads labels.
///
/// # Errors
/// If the file cannot be read or understood.
pub fn read_labels(path: &Path) -> Result<BTreeMap<String, Label>, CaseError> {
    json::read(path)
}

/// Reads the diagnoses `DIR/<case>/diagnosis.json` of all labelled cases and scores them; labels of cases of other engines say
/// how often what occurs.
///
/// # Errors
/// If labels or a diagnosis cannot be understood.
pub fn score_folder(folder: &Path, labels: &Path, others: &[PathBuf]) -> Result<Scores, CaseError> {
    let labels = read_labels(labels)?;
    let mut found = BTreeMap::new();
    for name in labels.keys() {
        let path = folder.join(name).join(schema::FILE);
        if path.exists() {
            found.insert(name.clone(), json::read(&path)?);
        }
    }
    let others = others.iter().map(|path| read_labels(path)).collect::<Result<Vec<_>, _>>()?;
    let others: Vec<&Label> = others.iter().flat_map(BTreeMap::values).collect();
    Ok(Scores { skill: Some(skill::skill(&found, &labels, &others)), ..score(&found, &labels) })
}

/// Scores diagnoses against labels; a case without a diagnosis was refused, and is wrong in every rate (a false alarm where
/// there is no effect) and as sure as can be.
#[must_use]
pub fn score(diagnoses: &BTreeMap<String, Diagnosis>, labels: &BTreeMap<String, Label>) -> Scores {
    let mut scores = Scores::default();
    let mut counts: BTreeMap<&'static str, (usize, usize)> = BTreeMap::new();
    let mut count = |name: &'static str, hit: bool| {
        let entry = counts.entry(name).or_default();
        entry.0 += usize::from(hit);
        entry.1 += 1;
    };
    let (mut sure, mut relative, mut shares) = (Vec::new(), Vec::new(), Vec::new());
    for (name, label) in labels {
        let found = diagnoses.get(name);
        if found.is_none() {
            scores.absent.push(name.clone());
        }
        count("answered", found.is_some());
        count("verdict", found.is_some_and(|d| verdict(d) == label.kind));
        match label.kind.as_str() {
            "none" => count("false alarms", found.is_none_or(|d| d.verdict != Verdict::None)),
            "single" => single(found, &label.effects[0], &mut count, &mut relative),
            "double" => {
                let chosen = |e: &LabelEffect| found.is_some_and(|d| d.chosen.contains(&e.id));
                count("pairs: both", label.effects.iter().all(chosen));
                count("pairs: one at least", label.effects.iter().any(chosen));
            }
            _ => {
                let called = found.is_some_and(|d| d.verdict == Verdict::Unknown);
                count("unknown called so", called);
                if label.effects.iter().any(|e| e.floor_units.is_some_and(|size| size > FAIR_SIZE)) {
                    count("unknown above 2 floor units called so", called);
                }
            }
        }
        if label.kind != "out_of_library" {
            count("known called unknown", found.is_none_or(|d| d.verdict == Verdict::Unknown));
        }
        let Some(d) = found else {
            sure.push((1.0, false));
            continue;
        };
        sure.push(confidence(d, label));
        // the further unseen drive where there is one, else the held-out one
        let positions = || d.how_far.iter().filter(|s| s.metric == "position_2s");
        let realised = positions().find(|s| s.data == "unseen").or_else(|| positions().next());
        let realised = realised.filter(|s| s.before > 2.0 * s.floor).and_then(|s| s.share_explained);
        shares.extend(d.predicted_share.zip(realised).map(|(predicted, realised)| (predicted - realised).abs()));
    }
    scores.brier =
        sure.iter().map(|(p, right)| (p - f64::from(u8::from(*right))).powi(2)).sum::<f64>() / sure.len().max(1) as f64;
    scores.reliability = skill::reliability(&sure);
    scores.calibration_error = calibration(&mut sure);
    scores.relative_error = ds_stats::quantile(&mut relative, 0.5);
    scores.share_error = ds_stats::quantile(&mut shares, 0.5);
    scores.shares = counts.into_iter().map(|(name, (hits, of))| (name, Some(Share::new(hits, of)))).collect();
    scores
}

fn verdict(d: &Diagnosis) -> &'static str {
    match d.verdict {
        Verdict::None => "none",
        Verdict::Single => "single",
        Verdict::Multiple => "double",
        Verdict::Unknown => "out_of_library",
    }
}

fn single(
    found: Option<&Diagnosis>,
    truth: &LabelEffect,
    count: &mut impl FnMut(&'static str, bool),
    relative: &mut Vec<f64>,
) {
    let effects = found.map_or(&[][..], |d| &d.effects);
    let chosen = found.map_or(&[][..], |d| &d.chosen);
    let place = effects.iter().position(|e| e.id == truth.id);
    count("singles: first", place == Some(0));
    count("singles: first or second", place.is_some_and(|p| p < 2));
    let grouped = effects.first().is_some_and(|e| e.group.contains(&truth.id) && e.group.len() <= GROUP_SIZE);
    count("singles: in the group of the first", grouped);
    if truth.floor_units.is_none_or(|size| size > FAIR_SIZE) {
        count("singles above 2 floor units: first", place == Some(0));
        count("singles above 2 floor units: in the group", grouped);
    }
    let verdict = found.map(|d| d.verdict);
    count("singles: strict", verdict == Some(Verdict::Single) && chosen == [truth.id.clone()]);
    if place == Some(0) && chosen.contains(&truth.id) {
        let first = &effects[0];
        count("intervals cover", first.interval90[0] <= truth.value && truth.value <= first.interval90[1]);
        let neutral = if first.unit == "x" { 1.0 } else { 0.0 };
        relative.push((first.value - truth.value).abs() / (truth.value - neutral).abs().max(1e-9));
    }
}

/// Returns the probability of the answer given and whether it is right.
#[must_use]
pub fn confidence(d: &Diagnosis, label: &Label) -> (f64, bool) {
    let known: f64 = d.effects.iter().filter(|e| d.chosen.contains(&e.id)).map(|e| e.probability).sum();
    match d.verdict {
        Verdict::None => (d.p_none, label.kind == "none"),
        Verdict::Unknown => (d.p_unknown, label.kind == "out_of_library"),
        _ => {
            let mut truth: Vec<&String> = label.effects.iter().map(|e| &e.id).collect();
            let mut chosen: Vec<&String> = d.chosen.iter().collect();
            truth.sort();
            chosen.sort();
            (known, label.kind != "out_of_library" && truth == chosen)
        }
    }
}

fn calibration(sure: &mut [(f64, bool)]) -> f64 {
    sure.sort_by(|a, b| a.0.total_cmp(&b.0));
    let bins = 10.min(sure.len().max(1));
    let mut error = 0.0;
    for bin in 0..bins {
        let part = &sure[bin * sure.len() / bins..(bin + 1) * sure.len() / bins];
        let gap: f64 = part.iter().map(|(p, right)| p - f64::from(u8::from(*right))).sum();
        error += gap.abs();
    }
    error / sure.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wilson_intervals_are_those_of_the_book() {
        let share = Share::new(8, 10);
        assert!((share.value - 0.8).abs() < 1e-12);
        assert!((share.interval90[0] - 0.541).abs() < 0.002, "{share:?}");
        assert!((share.interval90[1] - 0.931).abs() < 0.002, "{share:?}");
    }

    #[test]
    fn refused_cases_are_wrong_in_every_rate() {
        let effect = |id: &str| format!(r#"{{"id": "{id}", "value": 0.1, "floor_units": 9.0}}"#);
        let (a, b) = (effect("steer_delay"), effect("mu"));
        let labels = format!(
            r#"{{"n": {{"kind": "none"}}, "s": {{"kind": "single", "effects": [{a}]}},
                "d": {{"kind": "double", "effects": [{a}, {b}]}},
                "o": {{"kind": "out_of_library", "effects": [{a}]}}}}"#
        );
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("labels.json");
        std::fs::write(&path, labels).expect("labels");
        let none = |name: &str| {
            let text = serde_json::to_string(&Diagnosis::blank(name)).expect("a diagnosis");
            std::fs::create_dir_all(folder.path().join(name)).expect("a folder");
            std::fs::write(folder.path().join(name).join("diagnosis.json"), text).expect("a diagnosis");
        };
        let refused = score_folder(folder.path(), &path, &[]).expect("scores");
        assert_eq!(refused.absent, ["d", "n", "o", "s"]);
        for (name, share) in &refused.shares {
            let wrong = ["false alarms", "known called unknown"].contains(name);
            assert_eq!(share.expect("a share").value, f64::from(u8::from(wrong)), "{name}");
        }
        assert_eq!((refused.brier, refused.calibration_error), (1.0, 1.0));
        none("n");
        let one = score_folder(folder.path(), &path, &[]).expect("scores");
        let share = |scores: &Scores, name: &str| scores.shares[name].map(|share| (share.hits, share.of));
        assert_eq!((share(&one, "verdict"), share(&one, "answered")), (Some((1, 4)), Some((1, 4))));
        assert_eq!((share(&one, "false alarms"), share(&one, "known called unknown")), (Some((0, 1)), Some((2, 3))));
        assert!((one.brier - 0.75).abs() < 1e-12);
    }
}
