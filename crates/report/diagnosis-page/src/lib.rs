//! A diagnosis of the gap as something to look at: one self-contained HTML page, an index over many, plain text.
//!
//! [`page`] needs the diagnosis alone; with its case folder it also draws residuals over time, the road and example
//! tiles of frames. Pages fetch nothing: style, script, plots (inline SVG) and pictures are inside, in light, dark and
//! for print. Whatever comes from outside is escaped by construction (`markup`). Nothing is diagnosed or fitted here.

use std::path::Path;

use ds_diagnosis::Verdict;
use ds_diagnosis::schema::Diagnosis;
use ds_page as markup;
use ds_run_report::closing::Closing;

mod attended;
mod attribution;
mod baseline;
mod blocks;
mod closing;
mod effects;
mod embed;
mod experiment;
mod fleet;
mod frames;
mod further;
mod headline;
mod index;
mod law;
mod material;
mod over_time;
mod place;
mod plot;
mod road;
mod shrink;
#[cfg(test)]
mod tests;
mod text;
mod tiles;
mod value;
mod when;
mod words;

pub use attribution::Attributed;
use ds_page::{Document, Markup, Pictures};
use material::Material;

const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");
const INDEX: &str = "What the simulator leaves out, case by case";

/// Returns the page of a diagnosis; the case folder it was made from adds what only the log itself can show.
#[must_use]
pub fn page(diagnosis: &Diagnosis, case: Option<&Path>) -> String {
    let material = case.map(|folder| material::of(diagnosis, folder)).unwrap_or_default();
    let title = format!("{} · gap diagnosis", diagnosis.case);
    document(&title, |m| {
        headline::header(m, diagnosis);
        markup::sections(m, &parts(diagnosis, &material), |m, id| section(m, id, diagnosis, &material));
    })
}

/// Returns the index over many cases, each with the path of its page relative to the index.
#[must_use]
pub fn index(cases: &[(String, Diagnosis)]) -> String {
    document("Gap diagnosis", |m| index::body(m, cases))
}

/// Returns a baseline as plain text for a terminal.
#[must_use]
pub fn baseline(baseline: &ds_dynamics::baseline::Baseline) -> String {
    baseline::text(baseline)
}

/// Returns the page of a fleet: who differs and by what; pages of cases are linked as `CASE/report.html`.
#[must_use]
pub fn fleet(fleet: &ds_dynamics::fleet::Fleet, cases: &[Diagnosis]) -> String {
    document("Fleet", |m| fleet::body(m, fleet, cases))
}

/// Returns a fleet as plain text for a terminal.
#[must_use]
pub fn fleet_text(fleet: &ds_dynamics::fleet::Fleet) -> String {
    fleet::text(fleet)
}

/// Returns the page of the next experiment.
#[must_use]
pub fn experiment(next: &ds_experiment::Next) -> String {
    document(&format!("{} · what to drive next", next.case), |m| experiment::body(m, next))
}

/// Returns the next experiment as plain text for a terminal.
#[must_use]
pub fn experiment_text(next: &ds_experiment::Next) -> String {
    experiment::text(next)
}

/// Returns the page of what costs policies their score; `asked` says over what, line by line.
#[must_use]
pub fn attribution(policies: &[Attributed<'_>], asked: &[(&str, String)]) -> String {
    document("What costs the score", |m| attribution::body(m, policies, asked))
}

/// Returns the page of what a correction closes; `asked` says over what, line by line, `report` is the diagnosis' page beside it.
#[must_use]
pub fn closing(diagnosis: &Diagnosis, closings: &[Closing], asked: &[(&str, String)], report: &str) -> String {
    let title = format!("{} · what the correction closes", diagnosis.case);
    document(&title, |m| closing::body(m, diagnosis, closings, asked, report))
}

/// Returns a line for every effect of the corrected simulator: its value in the figures and words of page and terminal.
#[must_use]
pub fn values(diagnosis: &Diagnosis) -> Vec<String> {
    value::lines(diagnosis)
}

/// Returns a diagnosis as plain text for a terminal.
#[must_use]
pub fn text(diagnosis: &Diagnosis) -> String {
    text::text(diagnosis)
}

fn document(title: &str, body: impl FnOnce(&mut Markup)) -> String {
    Document { title, style: STYLE, script: Some(SCRIPT), pictures: Pictures::Inside }.page(body)
}

/// The sections that this diagnosis has, by anchor and title.
fn parts(diagnosis: &Diagnosis, material: &Material) -> Vec<(&'static str, &'static str)> {
    let next = !diagnosis.next_manoeuvre.is_empty() || !diagnosis.indistinguishable.is_empty();
    let all = [
        (true, "which", "Which effect"),
        (when::changing(diagnosis).is_some(), "when", "When it acts"),
        (diagnosis.unknown_description.is_some(), "unknown", "What no effect explains"),
        (diagnosis.discovery.is_some(), "law", "A law outside the library"),
        (true, "where", "Where the gap lies"),
        (material.strip.is_some(), "frames", "In the frames"),
        (!diagnosis.how_far.is_empty(), "shrink", "How far it shrinks"),
        (!diagnosis.attended.is_empty(), "policies", "For policies"),
        (!material.traces.is_empty(), "time", "Over time"),
        (material.traces.iter().any(road::worth), "road", "On the road"),
        (next, "next", if diagnosis.verdict == Verdict::None { "What would settle it" } else { "What to drive next" }),
        (true, "method", "How to read this"),
    ];
    all.into_iter().filter(|part| part.0).map(|(_, id, title)| (id, title)).collect()
}

fn section(m: &mut Markup, id: &str, diagnosis: &Diagnosis, material: &Material) {
    match (id, &diagnosis.unknown_description, &material.strip) {
        ("which", ..) => effects::section(m, diagnosis, material.nominal.as_ref()),
        ("when", ..) => when::changing(diagnosis).into_iter().for_each(|course| when::section(m, diagnosis, course)),
        ("unknown", Some(left), _) => further::remainder(m, left),
        ("law", ..) => diagnosis.discovery.iter().for_each(|found| law::section(m, found)),
        ("where", ..) => place::section(m, diagnosis, material),
        ("frames", _, Some(strip)) => frames::section(m, diagnosis, strip),
        ("shrink", ..) => shrink::section(m, diagnosis),
        ("policies", ..) => attended::section(m, &diagnosis.attended),
        ("time", ..) => material.traces.iter().for_each(|traces| over_time::section(m, diagnosis, traces)),
        ("road", ..) => material.traces.iter().filter(|t| road::worth(t)).for_each(|traces| road::section(m, traces)),
        ("next", ..) => further::next(m, diagnosis),
        _ => further::method(m, diagnosis, material.note.as_deref()),
    }
}
