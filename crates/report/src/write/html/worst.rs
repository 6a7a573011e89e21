//! The drives to look at first: the lowest scores under the constraint that they broke first, with their pictures;
//! and every drive that failed or was aborted, with its reason.

use std::collections::BTreeMap;

use super::Pictures;
use super::markup::{Markup, link};
use super::table::{Cell, Heading, Order, table};
use crate::dimension::{Drive, drives};
use crate::metric::Metric;
use crate::report::Report;
use crate::results::{Outcome, Results};
use crate::term;
use crate::write::points;

/// Most drives that are shown per constraint.
const MAX_CARDS: usize = 12;
/// Drives that broke nothing are shown below this driving score.
const LOW_SCORE: f64 = 0.5;

/// Writes the cards, grouped by the constraint broken first.
pub(crate) fn section(m: &mut Markup, runs: &[Results], pictures: &Pictures) {
    let all = drives(runs);
    let groups = by_constraint(&all);
    if groups.is_empty() {
        m.leaf("p", &[], format_args!("No drive broke a constraint, and none scored below {}.", 100.0 * LOW_SCORE));
        return;
    }
    m.leaf(
        "p",
        &[("class", &"lead")],
        "Lowest driving score first, under the constraint that broke first. Ticks count from the start of the drive.",
    );
    for (constraint, drives) in groups {
        let title = constraint.map_or_else(|| "low score, no constraint broken".to_owned(), term::title);
        let many = if drives.len() > MAX_CARDS { format!(", the worst {MAX_CARDS} shown") } else { String::new() };
        let noun = if drives.len() == 1 { "drive" } else { "drives" };
        m.leaf("h3", &[], format_args!("{}: {} {noun}{many}", capitalised(&title), drives.len()));
        m.inside("ul", &[("class", &"cards")], |m| {
            for drive in drives.iter().take(MAX_CARDS) {
                m.inside("li", &[], |m| card(m, drive, pictures.get(&drive.place).copied()));
            }
        });
    }
}

/// Groups drives by the constraint that they broke first; the constraint with the most drives comes first.
fn by_constraint<'a, 'b>(all: &'b [Drive<'a>]) -> Vec<(Option<&'b str>, Vec<&'b Drive<'a>>)> {
    let score = |drive: &Drive| Metric::DrivingScore.headline(drive.episode);
    let mut groups: BTreeMap<Option<&str>, Vec<&Drive>> = BTreeMap::new();
    for drive in all.iter().filter(|drive| drive.episode.outcome() != Outcome::Aborted) {
        let first = drive.episode.first_violations.iter().min_by_key(|(_, tick)| **tick).map(|(term, _)| term.as_str());
        let low = score(drive).is_some_and(|score| score < LOW_SCORE) && drive.episode.outcome() == Outcome::Completed;
        if first.is_some() || low {
            groups.entry(first).or_default().push(drive);
        }
    }
    let mut groups: Vec<_> = groups.into_iter().collect();
    for (_, drives) in &mut groups {
        drives.sort_by(|a, b| score(a).unwrap_or(2.0).total_cmp(&score(b).unwrap_or(2.0)));
    }
    groups.sort_by(|a, b| a.0.is_none().cmp(&b.0.is_none()).then(b.1.len().cmp(&a.1.len())));
    groups
}

fn card(m: &mut Markup, drive: &Drive, picture: Option<&str>) {
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
        let names = [&episode.set, &episode.policy, &episode.observation, &episode.appearance, &episode.scorer];
        let names: Vec<&str> = names.into_iter().map(String::as_str).filter(|name| !name.is_empty()).collect();
        m.inside("p", &[], |m| m.leaf("bdi", &[], format_args!("{} · seed {}", names.join(" · "), episode.seed)));
        let mut broken: Vec<(&String, &u32)> = episode.first_violations.iter().collect();
        broken.sort_by_key(|(_, tick)| **tick);
        for (index, (name, tick)) in broken.into_iter().enumerate() {
            let class = if index == 0 { "chip" } else { "chip later" };
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
