//! A diagnosis as plain text for a terminal: the same order and the same words as the page, at most 100 columns wide.
//!
//! Control characters in names and warnings become U+FFFD, so that no log can drive the terminal.

use std::fmt::Write as _;

use ds_diagnosis::schema::{Diagnosis, Shrink};

use super::effects::shown;
use super::headline::{at_floor, data, predicted, sentence, telling};
use super::law;
use super::place;
use super::shrink::saved;
use super::value;
use super::when;
use super::words;

const WIDTH: usize = 100;
/// Cells that are listed.
const CELLS: usize = 8;
const BAR: usize = 20;

/// Returns the diagnosis as text.
pub(crate) fn text(diagnosis: &Diagnosis) -> String {
    let mut out = String::new();
    line(&mut out, &diagnosis.case);
    wrap(&mut out, &sentence(diagnosis), "");
    for warning in &diagnosis.warnings {
        wrap(&mut out, &format!("warning: {warning}"), "  ");
    }
    which(&mut out, diagnosis);
    if let Some(course) = when::changing(diagnosis) {
        title(&mut out, "When");
        wrap(&mut out, &when::sentence(diagnosis, course), "  ");
    }
    if let Some(left) = &diagnosis.unknown_description {
        title(&mut out, "Not explained");
        wrap(&mut out, &left.text, "  ");
    }
    if let Some(found) = &diagnosis.discovery {
        title(&mut out, "A law outside the library");
        wrap(&mut out, &law::sentence(found), "  ");
        let places = found.insertion.iter().take(3);
        let told: Vec<String> =
            places.map(|p| format!("{} {}", law::place_name(&p.id), words::chance(p.probability))).collect();
        wrap(&mut out, &format!("where it acts: {}", told.join(", ")), "  ");
    }
    where_(&mut out, diagnosis);
    how_far(&mut out, diagnosis);
    next(&mut out, diagnosis);
    out
}

fn which(out: &mut String, diagnosis: &Diagnosis) {
    title(out, "Which");
    let mut rows: Vec<(f64, String, String)> = shown(diagnosis)
        .iter()
        .map(|finding| {
            let estimate = value::estimate(finding);
            let mark = if diagnosis.chosen.contains(&finding.id) { "* " } else { "  " };
            let told = estimate.map(|e| format!("{} {}", e.value, e.interval)).unwrap_or_default();
            (finding.probability, format!("{mark}{}", words::effect(&finding.id)), told)
        })
        .collect();
    rows.push((diagnosis.p_none, "  nothing missing".to_owned(), String::new()));
    rows.push((diagnosis.p_unknown, "  something unknown".to_owned(), String::new()));
    rows.sort_by(|a, b| b.0.total_cmp(&a.0));
    for (p, name, estimate) in rows {
        let full = if p.is_finite() { (p.clamp(0.0, 1.0) * BAR as f64).round() as usize } else { 0 };
        let bar = format!("{}{}", "█".repeat(full), "·".repeat(BAR - full));
        line(out, &format!("  {:>6}  {bar}{name:<30} {estimate}", words::chance(p)));
    }
    for finding in shown(diagnosis).into_iter().filter(|f| value::with_usual(diagnosis, f).is_some()) {
        value::line(diagnosis, finding).into_iter().for_each(|told| wrap(out, &told, "  "));
    }
    for group in &diagnosis.indistinguishable {
        let names: Vec<String> = group.iter().map(|id| words::effect(id)).collect();
        wrap(out, &format!("not told apart by these data: {}", names.join(" or ")), "  ");
    }
}

fn where_(out: &mut String, diagnosis: &Diagnosis) {
    title(out, "Where");
    if diagnosis.cells.is_empty() {
        line(out, "  no cell lies significantly beyond the noise floor");
    }
    let mut cells: Vec<_> = diagnosis.cells.iter().collect();
    cells.sort_by(|a, b| b.effect_size.total_cmp(&a.effect_size));
    for cell in cells.iter().take(CELLS) {
        line(out, &format!("  {}", place::told(cell)));
    }
    if cells.len() > CELLS {
        line(out, &format!("  and {} further cells", cells.len() - CELLS));
    }
}

fn how_far(out: &mut String, diagnosis: &Diagnosis) {
    let Some(first) = diagnosis.how_far.first() else { return };
    title(out, &format!("How far, {}", data(first)));
    let heads = ["before", "after", "floor"];
    let shares = ["calibrated", "effects"];
    line(
        out,
        &format!(
            "  {:<24} {:>9} {:>9} {:>9} {:<9} {:>10} {:>8}",
            "", heads[0], heads[1], heads[2], "", shares[0], shares[1]
        ),
    );
    for shrink in &diagnosis.how_far {
        line(out, &metric(shrink));
    }
    if let Some(saved) = telling(diagnosis).and_then(saved) {
        wrap(out, &saved, "  ");
    }
    if let (Some(shrink), Some(share)) = (predicted(diagnosis).filter(|s| !at_floor(s)), diagnosis.predicted_share) {
        let (name, _) = words::metric(&shrink.metric);
        let share = words::share(share);
        line(out, &format!("  promised by the fit for {name}: {share}"));
    }
}

fn metric(shrink: &Shrink) -> String {
    let (name, unit) = words::metric(&shrink.metric);
    let [before, after, floor] = words::aligned([shrink.before, shrink.after, shrink.floor]);
    let calibrated = shrink.share_nuisance.map_or(words::NOTHING.to_owned(), words::share);
    let interval = shrink.interval90.map(words::shares).unwrap_or_default();
    let share = shrink.share_explained.map_or("  no gap".to_owned(), |s| format!("{:>8}  {interval}", words::share(s)));
    format!("  {name:<24} {before:>9} {after:>9} {floor:>9} {unit:<9} {calibrated:>10} {share}")
}

fn next(out: &mut String, diagnosis: &Diagnosis) {
    if diagnosis.next_manoeuvre.is_empty() {
        return;
    }
    title(out, "What to drive next");
    for run in &diagnosis.next_manoeuvre {
        let [a, b] = run.separates.each_ref().map(|id| words::effect(id));
        let factor = words::fixed(run.expected_log_bayes_factor, 1);
        let time = words::duration(run.secs_needed);
        wrap(out, &format!("{}: tells {a} from {b}, log Bayes factor {factor}, {time} needed", run.name), "  ");
    }
}

fn title(out: &mut String, words: &str) {
    out.push('\n');
    line(out, words);
}

/// Writes a line without control characters; spaces that hold figures together are plain ones in a terminal.
fn line(out: &mut String, words: &str) {
    let words: String = words.chars().map(clean).collect();
    let _ = writeln!(out, "{}", words.trim_end());
}

fn clean(c: char) -> char {
    match c {
        '\u{a0}' => ' ',
        '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' | '\u{200e}' | '\u{200f}' => '\u{fffd}',
        c if c.is_control() => '\u{fffd}',
        c => c,
    }
}

/// Writes words on lines of at most [`WIDTH`] columns.
fn wrap(out: &mut String, words: &str, indent: &str) {
    let mut current = indent.to_owned();
    for word in words.split([' ', '\n']) {
        if current.chars().count() + word.chars().count() + 1 > WIDTH && current.trim() != "" {
            line(out, &current);
            current = format!("{indent}  ");
        }
        if !current.ends_with(' ') && !current.is_empty() {
            current.push(' ');
        }
        current += word;
    }
    line(out, &current);
}
