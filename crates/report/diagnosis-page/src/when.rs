//! When an accepted effect acts: one sentence, and how large it is in each drive.

use ds_diagnosis::modulation::{CONSTANT, Modulation, OFFSET, RAMP};
use ds_diagnosis::schema::Diagnosis;

use super::markup::Markup;
use super::plot;
use super::words;

/// Returns the course of an effect that is not constant.
pub(crate) fn changing(diagnosis: &Diagnosis) -> Option<&Modulation> {
    diagnosis.modulation.as_ref().filter(|m| m.kind != CONSTANT && m.onset_s.is_some())
}

/// Returns the course in words.
pub(crate) fn sentence(diagnosis: &Diagnosis, course: &Modulation) -> String {
    let verb = match course.kind.as_str() {
        OFFSET => "ends",
        RAMP => "grows from",
        _ => "begins",
    };
    let at = if course.kind == RAMP { "" } else { "at " };
    let secs = words::fixed(course.onset_s.unwrap_or(f64::NAN), 1);
    let within = course.interval90.map(|[a, b]| format!(" (90 %: {} to {} s)", words::fixed(a, 1), words::fixed(b, 1)));
    let rest = match course.scope.as_deref() {
        Some("drive") => ", and acts in that drive alone",
        Some("each") => ", and does so at the same time of every drive",
        _ if course.kind == OFFSET => ", and is gone in the drives after it",
        _ => ", and stays in the drives after it",
    };
    let drive = course.drive.unwrap_or(0);
    let unit = diagnosis.effects.iter().find(|e| e.id == course.effect).map_or("", |e| e.unit.as_str());
    let size =
        course.value.filter(|v| v.is_finite()).map(|v| format!("; while it acts it is {} {unit}", words::figure(v)));
    format!(
        "{} {verb} {at}{secs} s{} of drive {drive}{rest}{}. Log evidence over a constant effect: {}.",
        words::capital(&words::effect(&course.effect)),
        within.unwrap_or_default(),
        size.unwrap_or_default().trim_end(),
        words::fixed(course.evidence, 1)
    )
}

/// Writes the sentence and the size by drive.
pub(crate) fn section(m: &mut Markup, diagnosis: &Diagnosis, course: &Modulation) {
    m.leaf("p", &[("class", &"said")], sentence(diagnosis, course));
    let most = course.sessions.iter().map(|s| s.size).filter(|v| v.is_finite()).fold(1.0, f64::max);
    let height = 24.0 + 24.0 * course.sessions.len() as f64;
    plot::picture(m, "plot bars", "Size of the effect by drive", (560.0, height), |m| {
        plot::text(
            m,
            "tick begin",
            (160.0, 12.0),
            "size in each drive of the fit, as a share of the estimate over all",
        );
        for (k, session) in course.sessions.iter().enumerate() {
            let y = 22.0 + 24.0 * k as f64;
            let size = if session.size.is_finite() { session.size } else { 0.0 };
            plot::text(m, "label", (148.0, y + 13.5), &format!("drive {}", session.drive));
            plot::area(m, "share", (160.0, y + 2.0), (330.0 * (size / most).clamp(0.0, 1.0), 15.0), "");
            plot::text(m, "value strong", (550.0, y + 14.0), &words::fixed(session.size, 2));
        }
    });
}
