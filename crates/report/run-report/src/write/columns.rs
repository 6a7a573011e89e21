//! Episodes and aggregates as named columns of equal length, which CSV and Arrow both write.
//!
//! Names with a dot are members: `sub_scores.nc`, `time_share.sim`. Scores are 0 to 1; what does not apply is empty.

use std::collections::BTreeSet;

use crate::aggregate::{Aggregate, Estimate, Group, Summary};
use crate::dimension::{Drive, drives};
use crate::results::{Episode, Results};

/// A table of columns of equal length.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// The columns in order.
    pub columns: Vec<Column>,
}

/// A named column.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Its name.
    pub name: String,
    /// Its values.
    pub values: Values,
}

/// Values of one type.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// Text; empty where there is nothing to say.
    Text(Vec<String>),
    /// Whole numbers from 0.
    Count(Vec<Option<u64>>),
    /// Real numbers.
    Number(Vec<Option<f64>>),
}

impl Values {
    /// Returns the number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::Text(values) => values.len(),
            Self::Count(values) => values.len(),
            Self::Number(values) => values.len(),
        }
    }

    /// Says whether there are no rows.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl Table {
    /// Returns the number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.columns.first().map_or(0, |column| column.values.len())
    }
}

/// Reads a part of a row, or a value of it.
type Part<T, V> = fn(&T) -> &V;
type Get<T, V> = fn(&T) -> V;

struct Rows<'a, T> {
    rows: &'a [T],
    columns: Vec<Column>,
}

impl<T> Rows<'_, T> {
    fn text(&mut self, name: &str, value: impl Fn(&T) -> String) {
        self.push(name, Values::Text(self.rows.iter().map(value).collect()));
    }

    fn count(&mut self, name: &str, value: impl Fn(&T) -> Option<u64>) {
        self.push(name, Values::Count(self.rows.iter().map(value).collect()));
    }

    fn number(&mut self, name: &str, value: impl Fn(&T) -> Option<f64>) {
        self.push(name, Values::Number(self.rows.iter().map(value).collect()));
    }

    fn push(&mut self, name: &str, values: Values) {
        self.columns.push(Column { name: name.to_owned(), values });
    }
}

/// Returns one row per episode of all runs.
#[must_use]
pub fn episodes(runs: &[Results]) -> Table {
    let mut drives = drives(runs);
    drives.sort_by_key(|drive| drive.place);
    let mut rows = Rows { rows: &drives, columns: Vec::new() };
    rows.text("run", |d| d.run.clone());
    let texts: [(&str, Part<Episode, String>); 7] = [
        ("scenario", |e| &e.scenario),
        ("set", |e| &e.set),
        ("category", |e| &e.category),
        ("policy", |e| &e.policy),
        ("observation", |e| &e.observation),
        ("appearance", |e| &e.appearance),
        ("scorer", |e| &e.scorer),
    ];
    for (name, text) in texts {
        rows.text(name, |d| text(d.episode).clone());
    }
    rows.count("seed", |d| Some(d.episode.seed));
    rows.text("score_profile", |d| d.episode.score_profile.clone());
    rows.text("score_version", |d| d.episode.score_version.clone());
    rows.text("status", |d| d.episode.status.clone());
    rows.text("reason", |d| d.episode.reason.clone());
    rows.count("attempts", |d| Some(d.episode.attempts.into()));
    rows.count("ticks", |d| Some(d.episode.ticks.into()));
    scores(&mut rows);
    costs(&mut rows);
    Table { columns: rows.columns }
}

fn scores(rows: &mut Rows<Drive>) {
    let drives = rows.rows;
    rows.number("driving_score", |d| d.episode.driving_score);
    rows.text("driving_score_reason", |d| d.episode.driving_score_reason.clone());
    rows.number("route_completion", |d| d.episode.route_completion);
    rows.number("mean_score", |d| d.episode.mean_score);
    let names = |keys: fn(&Episode) -> Vec<&String>| -> BTreeSet<String> {
        drives.iter().flat_map(|drive| keys(drive.episode)).cloned().collect()
    };
    for term in names(|e| e.sub_scores.keys().collect()) {
        rows.number(&format!("sub_scores.{term}"), |d| d.episode.sub_scores.get(&term).copied().flatten());
    }
    for term in names(|e| e.lost.keys().collect()) {
        rows.number(&format!("lost.{term}"), |d| d.episode.lost.get(&term).copied());
    }
    for term in names(|e| e.first_violations.keys().collect()) {
        rows.count(&format!("first_violations.{term}"), |d| {
            d.episode.first_violations.get(&term).map(|tick| u64::from(*tick))
        });
    }
    rows.number("proposals.best_mean", |d| d.episode.proposals.map(|p| p.best_mean));
    rows.count("proposals.ticks_without_positive", |d| {
        d.episode.proposals.map(|p| u64::from(p.ticks_without_positive))
    });
    rows.count("proposals.ticks", |d| d.episode.proposals.map(|p| u64::from(p.ticks)));
}

fn costs(rows: &mut Rows<Drive>) {
    rows.number("frames_per_second", |d| Some(d.episode.frames_per_second));
    rows.number("wall_s", |d| Some(d.episode.wall_s));
    let shares: [(&str, Get<Episode, f64>); 6] = [
        ("sim", |e| e.time_share.sim),
        ("layout", |e| e.time_share.layout),
        ("video", |e| e.time_share.video),
        ("policy", |e| e.time_share.policy),
        ("bus", |e| e.time_share.bus),
        ("other", |e| e.time_share.other),
    ];
    for (name, share) in shares {
        rows.number(&format!("time_share.{name}"), |d| Some(share(d.episode)));
    }
    rows.text("world_digest", |d| d.episode.world_digest.clone());
    rows.text("layout_digest", |d| d.episode.layout_digest.clone());
    rows.text("frame_digest", |d| d.episode.frame_digest.clone());
    rows.text("recording", |d| d.episode.recording.clone());
}

/// Returns one row per group and metric.
#[must_use]
pub fn aggregate(aggregate: &Aggregate) -> Table {
    let pairs: Vec<(&Group, &Summary)> =
        aggregate.groups.iter().flat_map(|group| group.metrics.iter().map(move |metric| (group, metric))).collect();
    let mut rows = Rows { rows: &pairs, columns: Vec::new() };
    for (index, dimension) in aggregate.by.iter().enumerate() {
        rows.text(dimension.name(), |(group, _)| group.key[index].clone());
    }
    let counts: [(&str, Get<Group, usize>); 5] = [
        ("scenarios", |group| group.counts.scenarios),
        ("episodes", |group| group.counts.episodes),
        ("completed", |group| group.counts.completed),
        ("failed", |group| group.counts.failed),
        ("aborted", |group| group.counts.aborted),
    ];
    for (name, count) in counts {
        rows.count(name, |(group, _)| Some(count(group) as u64));
    }
    rows.text("metric", |(_, metric)| metric.metric.clone());
    let estimates: [(&str, Part<Summary, Estimate>); 2] =
        [("headline", |metric| &metric.headline), ("finished", |metric| &metric.finished)];
    for (name, estimate) in estimates {
        rows.number(&format!("{name}_mean"), |(_, metric)| estimate(metric).mean);
        rows.number(&format!("{name}_low"), |(_, metric)| estimate(metric).interval.map(|i| i.low));
        rows.number(&format!("{name}_high"), |(_, metric)| estimate(metric).interval.map(|i| i.high));
        rows.count(&format!("{name}_scenarios"), |(_, metric)| Some(estimate(metric).scenarios as u64));
    }
    rows.count("not_applicable", |(_, metric)| Some(metric.not_applicable as u64));
    Table { columns: rows.columns }
}
