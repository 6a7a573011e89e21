//! The value of an effect in the same figures and words wherever it is told: page, terminal and the file of `gap apply`.
//!
//! A diagnosis tells an effect beyond what is usual of the vehicle; the corrected simulator has it with that. Where the two
//! read alike, one number is all there is to say.

use ds_diagnosis::schema::{Diagnosis, Finding};

use super::words::{self, Estimate};

/// Returns the estimate of a finding; nothing where it was not fitted at all.
pub(crate) fn estimate(finding: &Finding) -> Option<Estimate> {
    has_estimate(finding).then(|| words::estimate(finding.value, finding.interval90, &finding.unit)).flatten()
}

/// Tells whether a finding was fitted at all.
pub(crate) fn has_estimate(finding: &Finding) -> bool {
    !(finding.unit.is_empty() && finding.params.is_empty()) && finding.value.is_finite()
}

/// Says of a value that is told beyond what is usual of the vehicle what it is with that; nothing where both read alike or the
/// effect is not in the corrected simulator.
pub(crate) fn with_usual(diagnosis: &Diagnosis, finding: &Finding) -> Option<String> {
    let beyond = estimate(finding)?.value;
    let added = diagnosis.corrected_model.effects.iter().find(|effect| effect.id == finding.id)?;
    let whole = *added.values.first()?;
    let interval = finding.interval90.map(|end| end + whole - finding.value);
    let whole = words::estimate(whole, interval, &finding.unit)?.value;
    (whole != beyond).then(|| format!("beyond what is usual of the vehicle, {whole} with it"))
}

/// Returns a line of a finding: its value with its interval and, where that differs, what it is with what is usual.
pub(crate) fn line(diagnosis: &Diagnosis, finding: &Finding) -> Option<String> {
    let Estimate { value, interval } = estimate(finding)?;
    let whole = with_usual(diagnosis, finding).unwrap_or_default();
    let words: Vec<String> = [value, interval, whole].into_iter().filter(|part| !part.is_empty()).collect();
    Some(format!("{}: {}", finding.id, words.join(" ")).replace('\u{a0}', " "))
}

/// Returns the lines of all effects of the corrected simulator.
pub(crate) fn lines(diagnosis: &Diagnosis) -> Vec<String> {
    let found = |id: &String| diagnosis.effects.iter().find(|finding| finding.id == *id);
    let added = diagnosis.corrected_model.effects.iter();
    added.filter_map(|effect| line(diagnosis, found(&effect.id)?)).collect()
}
