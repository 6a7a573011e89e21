//! Labelled cases judged leave-one-case-out: every threshold that was set on them is derived anew from the others.
//!
//! Two were: the gain a single effect must have (what the effect-free cases reach, and a margin) and the temperature of
//! the probabilities (that of the highest likelihood of the labels). All others come from synthetic draws or theory.

use std::collections::BTreeMap;
use std::path::Path;

use rayon::prelude::*;

use crate::case::Case;
use crate::diagnose::{Options, diagnose_with};
use crate::settings::Thresholds;
use ds_diagnosis::CaseError;
use ds_diagnosis::schema::Diagnosis;
use ds_diagnosis::score::{Label, confidence};

/// Evidence by which a single effect must exceed the best that effect-free cases reach.
const MARGIN: f64 = 1.5;
/// Temperatures tried.
const TEMPERATURES: [f64; 5] = [1.0, 1.5, 2.0, 3.0, 5.0];

/// Diagnoses every labelled case of a folder with thresholds from the others.
///
/// # Errors
/// If a case cannot be read or makes no sense.
pub fn leave_one_out(
    root: &Path,
    labels: &BTreeMap<String, Label>,
    options: &Options,
) -> Result<BTreeMap<String, (Thresholds, Diagnosis)>, CaseError> {
    let pass = |thresholds: &(dyn Fn(&str) -> Thresholds + Sync)| -> Result<BTreeMap<String, Diagnosis>, CaseError> {
        let names: Vec<&String> = labels.keys().collect();
        let run = |name: &&String| {
            Case::read(&root.join(name)).map(|case| ((*name).clone(), diagnose_with(&case, options, &thresholds(name))))
        };
        names.par_iter().map(run).collect()
    };
    let first = pass(&|_| Thresholds::default())?;
    let derived: BTreeMap<&String, Thresholds> =
        labels.keys().map(|left| (left, derive(&first, labels, left))).collect();
    let second =
        pass(&|name| derived.iter().find(|(left, _)| left.as_str() == name).map(|d| *d.1).unwrap_or_default())?;
    Ok(second.into_iter().map(|(name, d)| (name.clone(), (derived[&name], d))).collect())
}

/// Derives the thresholds from all cases but one.
fn derive(found: &BTreeMap<String, Diagnosis>, labels: &BTreeMap<String, Label>, left: &str) -> Thresholds {
    let others = || found.iter().filter(|(name, _)| name.as_str() != left);
    let clean = others().filter(|(name, _)| labels[*name].kind == "none");
    let reached = clean.flat_map(|(_, d)| d.effects.iter().map(|e| e.evidence_gain)).fold(0.0, f64::max);
    let loss = |temperature: f64| -> f64 {
        let term = |(name, d): (&String, &Diagnosis)| {
            let (p, right) = confidence(d, &labels[name]);
            // tempering raises every probability to a power before they are normalised
            let power = Thresholds::default().temperature / temperature;
            let (yes, no) = (p.clamp(1e-9, 1.0).powf(power), (1.0 - p).clamp(1e-9, 1.0).powf(power));
            -(if right { yes } else { no } / (yes + no)).ln()
        };
        others().map(term).sum()
    };
    let temperature = TEMPERATURES.into_iter().min_by(|a, b| loss(*a).total_cmp(&loss(*b)));
    Thresholds { single_gain: reached + MARGIN, temperature: temperature.unwrap_or(1.5), ..Thresholds::default() }
}
