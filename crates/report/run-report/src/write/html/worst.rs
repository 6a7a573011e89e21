//! The drives to look at first: the lowest scores under the constraint that they broke, with their pictures; and every
//! drive that failed or was aborted, with its reason.
//!
//! A drive stands under the constraint (a term that multiplies the score) that it broke first; if it broke none, under
//! the weighted term that it broke first.

use std::collections::BTreeMap;

use super::Pictures;
use super::markup::{Markup, link};
use super::table::{Cell, Heading, Order, table};
use crate::dimension::{Drive, drives};
use crate::report::Report;
use crate::results::{Episode, Outcome, Results};
use crate::term;
use crate::write::points;

/// Most drives that are shown per constraint.
const MAX_CARDS: usize = 8;
/// Drives that broke nothing are shown below this driving score.
const LOW_SCORE: f64 = 0.5;

/// Writes the cards, grouped by the constraint broken first.
pub(crate) fn section(m: &mut Markup, report: &Report, runs: &[Results], pictures: &Pictures) {
    let all = drives(runs);
    let groups = by_constraint(&all);
    if groups.is_empty() {
        m.leaf("p", &[], format_args!("No drive broke a constraint, and none scored below {}.", 100.0 * LOW_SCORE));
        return;
    }
    m.leaf(
        "p",
        &[("class", &"lead")],
        "Lowest driving score first, under the constraint that was broken first, or else the comfort or safety term. Ticks \
         count from the start of the drive.",
    );
    for (constraint, drives) in groups {
        let title = constraint.map_or_else(|| "low score, no constraint broken".to_owned(), term::title);
        let many = if drives.len() > MAX_CARDS { format!(", the worst {MAX_CARDS} shown") } else { String::new() };
        let noun = if drives.len() == 1 { "drive" } else { "drives" };
        m.leaf("h3", &[], format_args!("{}: {} {noun}{many}", capitalised(&title), drives.len()));
        m.inside("ul", &[("class", &"cards")], |m| {
            for drive in drives.iter().take(MAX_CARDS) {
                m.inside("li", &[], |m| card(m, report, drive, pictures.get(&drive.place).copied()));
            }
        });
    }
}

/// Groups drives by what they broke, in order of the score's definition; those that broke nothing come last.
fn by_constraint<'a, 'b>(all: &'b [Drive<'a>]) -> Vec<(Option<&'b str>, Vec<&'b Drive<'a>>)> {
    let score = |drive: &Drive| match drive.episode.outcome() {
        Outcome::Completed => drive.episode.driving_score,
        _ => Some(0.0),
    };
    let mut groups: BTreeMap<Option<&str>, Vec<&Drive>> = BTreeMap::new();
    for drive in all.iter().filter(|drive| drive.episode.outcome() != Outcome::Aborted) {
        let broken = broken(drive.episode);
        let low = score(drive).is_some_and(|score| score < LOW_SCORE) && drive.episode.outcome() == Outcome::Completed;
        if broken.is_some() || low {
            groups.entry(broken).or_default().push(drive);
        }
    }
    let mut groups: Vec<_> = groups.into_iter().collect();
    for (_, drives) in &mut groups {
        drives.sort_by(|a, b| score(a).unwrap_or(2.0).total_cmp(&score(b).unwrap_or(2.0)));
    }
    groups.sort_by_key(|(broken, _)| broken.map_or(usize::MAX, term::rank));
    groups
}

/// Returns what a drive is shown under: its first broken constraint, else its first broken term.
fn broken(episode: &Episode) -> Option<&str> {
    let first = episode.first_violations.iter().min_by_key(|(name, tick)| (!term::is_constraint(name), **tick));
    first.map(|(name, _)| name.as_str())
}

fn card(m: &mut Markup, report: &Report, drive: &Drive, picture: Option<&str>) {
    let episode = drive.episode;
    if let Some(picture) = picture {
        let target = link(picture);
        let alt = format!("{} drives {}, seed {}", episode.policy, episode.scenario, episode.seed);
        m.inside("a", &[("href", &target)], |m| {
            m.void("img", &[("src", &target), ("alt", &alt), ("loading", &"lazy")]);
        });
    }
    m.inside("div", &[], |m| {
        let score = if episode.outcome() == Outcome::Failed { Some(0.0) } else { episode.driving_score };
        m.leaf("span", &[("class", &"score"), ("title", &"driving score")], points(score));
        m.inside("b", &[], |m| m.leaf("bdi", &[], &episode.scenario));
        let dimensions = report.headline.by.iter().filter(|d| !report.constant.contains_key(d.name()));
        let names: Vec<String> =
            dimensions.map(|dimension| dimension.of(drive)).filter(|name| !name.is_empty()).collect();
        let names = if names.is_empty() { episode.policy.clone() } else { names.join(" · ") };
        m.inside("p", &[], |m| m.leaf("bdi", &[], format_args!("{names} · seed {}", episode.seed)));
        let mut terms: Vec<(&String, &u32)> = episode.first_violations.iter().collect();
        terms.sort_by_key(|(_, tick)| **tick);
        for (name, tick) in terms {
            let class = if Some(name.as_str()) == broken(episode) { "chip" } else { "chip later" };
            m.leaf("span", &[("class", &class)], format_args!("{} at tick {tick}", term::title(name)));
        }
        if !episode.reason.is_empty() {
            m.leaf("p", &[], format_args!("{}: {}", episode.status, episode.reason));
        }
        if !episode.recording.is_empty() {
            m.inside("p", &[], |m| m.leaf("code", &[], &episode.recording));
        }
    });
}

/// Writes the list of failed and aborted drives.
pub(crate) fn unfinished(m: &mut Markup, report: &Report) {
    let headings = [
        Heading::text("scenario"),
        Heading::text("set"),
        Heading::text("policy"),
        Heading::text("run"),
        Heading::number("seed"),
        Heading::text("status"),
        Heading::number("ticks").hint("driven until then"),
        Heading::text("reason"),
    ];
    let rows: Vec<Vec<Cell>> = report
        .unfinished
        .iter()
        .map(|drive| {
            let mut row: Vec<Cell> = [&drive.scenario, &drive.set, &drive.policy, &drive.run].map(Cell::name).to_vec();
            row.push(Cell::number(drive.seed, Some(drive.seed as f64)));
            row.push(Cell::name(&drive.status).class(if drive.status == "failed" { "alarm" } else { "" }));
            row.extend([Cell::number(drive.ticks, Some(f64::from(drive.ticks))), Cell::name(&drive.reason)]);
            row
        })
        .collect();
    let caption = "Failed drives count 0 in the headline; aborted ones, and those that have not ended, are in no mean.";
    table(m, caption, Order::Sortable, &headings, &rows);
}

fn capitalised(text: &str) -> String {
    let mut chars = text.chars();
    chars.next().map_or_else(String::new, |first| first.to_uppercase().chain(chars).collect())
}
