//! Results → tables: policies × sets, outcomes by drive, paired differences, categories, conditions, faults, sets.
//!
//! The scenario is the unit, seeds averaged within it; a drive that the policy failed counts 0, an aborted one is left out
//! and counted. Incomplete results have no headline: only what was driven, and what went wrong, is told of them.

use std::collections::BTreeMap;

mod conditions;
mod contacts;
mod endpoints;
pub mod falls;
mod faults;
mod gate;
mod quality;
mod reviews;
mod rows;
mod severity;
mod studies;
mod subset;

use self::rows::{INTERVALS, counted, named};
use crate::estimate::{Bootstrap, Unit};
use crate::judge::{Outcome, PROFILES, Scores};
use crate::manifest::{Kind, Manifest};
use crate::plot::Plot;
use crate::published::Published;
use crate::results::{Drive, Results, unit};
use crate::sheet::Arm;
use crate::table::{EstimateStyle, Table, Value};

/// A report.
#[derive(Debug)]
pub struct Report {
    /// What it is of.
    pub title: String,
    /// What a reader has to know before the tables.
    pub warnings: Vec<String>,
    /// What was driven, in words: name and value.
    pub facts: Vec<(&'static str, String)>,
    /// Whether all cells have ended.
    pub complete: bool,
    /// The tables.
    pub tables: Vec<Table>,
    /// What stands under some of them, by their names.
    pub plots: BTreeMap<&'static str, Vec<Plot>>,
}

/// Reads a score of a drive in a profile.
type Score = fn(&Scores) -> Option<f64>;
/// Reads whether something happened in a drive.
type Said = fn(&Outcome) -> bool;

/// Names of the scores in a table.
const SCORES: [(&str, Score); 3] =
    [("DS", |s| s.driving_score), ("EPDMS", |s| s.mean_score), ("RC", |s| s.route_completion)];

impl Report {
    /// Makes the report of a folder; `anchor` says of a policy whether it is privileged.
    #[must_use]
    pub fn new(results: &Results, anchor: &dyn Fn(&str) -> bool, published: &Published) -> Self {
        let (mut tables, mut plots) = (Vec::new(), BTreeMap::new());
        if results.complete() {
            let mut maker = Maker { results, anchor, arms: results.sheet.arms(), bootstrap: Bootstrap::default() };
            tables.extend([maker.policies(), maker.outcomes(), maker.categories()]);
            let bootstrap = &mut maker.bootstrap;
            tables.insert(2, endpoints::endpoints(results, bootstrap));
            tables.push(studies::differences(results, bootstrap));
            for study in [
                studies::behavior,
                contacts::contacts,
                quality::margins,
                studies::weather,
                conditions::conditions,
                subset::subset,
                studies::bias,
                studies::terms,
            ] {
                tables.push(study(results, anchor, bootstrap));
            }
            let (losses, drawn) = severity::losses(results, anchor);
            plots.insert(losses.id, drawn);
            let falls = falls::falls(results, anchor);
            plots.insert(falls.id, falls::pairs(results));
            tables.extend([losses, falls, falls::again(results)]);
            tables.retain(|table| !table.rows.is_empty());
        }
        let (severity, drawn) = severity::severity(results);
        plots.insert(severity.id, drawn);
        tables.extend(Some(severity).filter(|table| !table.rows.is_empty()));
        tables.extend(Some(gate::shown(results)).filter(|table| !table.rows.is_empty()));
        tables.extend(Some(quality::quality(results)).filter(|table| !table.rows.is_empty()));
        tables.extend((!results.reviews.is_empty()).then(|| reviews::reviews(results)));
        tables.extend([faults::faults(results), sets(results)]);
        if !published.result.is_empty() {
            tables.push(published.table());
        }
        let names: Vec<&str> = results.sets.iter().map(|set| set.name.as_str()).collect();
        Self {
            title: format!("Benchmark on {}", names.join(", ")),
            warnings: warnings(results),
            facts: facts(results),
            complete: results.complete(),
            tables,
            plots,
        }
    }
}

fn warnings(results: &Results) -> Vec<String> {
    let mut warnings = Vec::new();
    if !results.complete() {
        let (ended, cells) = (results.ended(), results.cells);
        warnings.push(format!("Incomplete: {ended} of {cells} cells ended. There is no headline before all have."));
    }
    if results.sheet.mixed {
        warnings.push("Mixed: parts of other versions, sets, weights or settings were merged by force.".to_owned());
    }
    if results.foreign > 0 {
        warnings.push(format!("{} records of other benchmarks are in no table.", results.foreign));
    }
    for set in results.sheet.sets.iter().filter(|named| !results.has_quality(&named.name)) {
        warnings.push(format!(
            "Set {}: no figures of its search lie beside its manifest, so it is in no table by reaction margin.",
            set.name
        ));
    }
    for set in results.sets.iter().filter(|set| !set.redistributable) {
        warnings.push(format!("Set {} is under {}: its scenarios may not be passed on.", set.name, set.licence));
    }
    warnings.extend(gate::warnings(results));
    warnings
}

fn facts(results: &Results) -> Vec<(&'static str, String)> {
    let sheet = &results.sheet;
    let settings = &sheet.settings;
    let mut facts = vec![
        ("program", sheet.program.clone()),
        ("cells", format!("{} of {} ended", results.ended(), results.cells)),
        ("seeds", format!("{:?}", sheet.seeds)),
        ("selection seeds", format!("{:?}", sheet.selection)),
        ("replan period", format!("{} ticks", settings.replan)),
        ("horizon", format!("{} ticks", settings.horizon)),
        ("history", format!("{} frames", settings.history)),
        ("tracker", settings.tracker.name().to_owned()),
        ("settings digest", sheet.digest().to_string()),
    ];
    for named in sheet.policies.iter().chain(&sheet.observations).filter(|named| !named.digest.is_empty()) {
        facts.push(("weights", format!("{} {}", named.name, named.digest)));
    }
    facts
}

struct Maker<'a> {
    results: &'a Results,
    anchor: &'a dyn Fn(&str) -> bool,
    arms: Vec<Arm>,
    bootstrap: Bootstrap,
}

impl Maker<'_> {
    fn policies(&mut self) -> Table {
        let mut rows = Vec::new();
        for set in &self.results.sets {
            for profile in PROFILES {
                for arm in self.arms.clone() {
                    let mut row = named(self.anchor, set, &arm);
                    row.push(Value::text(profile));
                    for (_, score) in SCORES {
                        let units = self.results.units(&arm, set, &|drive| drive.score(profile, score));
                        row.push(Value::Estimate(self.bootstrap.estimate(&units), EstimateStyle::Points));
                    }
                    row.extend(counted(set, self.results, &arm));
                    rows.push(row);
                }
            }
        }
        let mut columns = vec!["policy", "set", "how", "profile"];
        columns.extend(SCORES.map(|(name, _)| name));
        columns.extend(["entries", "logs", "failed", "aborted"]);
        let note = format!(
            "DS = RC × EPDMS of the executed drive, in points; both profiles are of the same drives. Anchors see more than \
             frames: they bound what is possible and are no competitors. {INTERVALS}"
        );
        Table { id: "policies", title: "Policies × sets", note, columns, rows }
    }

    fn outcomes(&mut self) -> Table {
        let said: [(&str, Said); 5] = [
            ("collision at fault", |o| o.collision_at_fault),
            ("contact", |o| o.contact),
            ("off road", |o| o.off_road),
            ("red light", |o| o.red_light),
            ("arrived", |o| o.arrived),
        ];
        let rates: [(&str, Said); 2] =
            [("at fault per km", |o| o.collision_at_fault), ("off road per km", |o| o.off_road)];
        let mut rows = Vec::new();
        for set in &self.results.sets {
            for arm in self.arms.clone() {
                let mut row = named(self.anchor, set, &arm);
                let success = self.results.units(&arm, set, &Drive::success);
                row.push(Value::Estimate(self.bootstrap.share(&success), EstimateStyle::Points));
                for (_, said) in said {
                    let units = self.results.units(&arm, set, &|drive| drive.happened(said));
                    row.push(Value::Estimate(self.bootstrap.share(&units), EstimateStyle::Points));
                }
                for (_, said) in rates {
                    let units = per_km(self.results, &arm, set, said);
                    row.push(Value::Estimate(self.bootstrap.estimate(&units), EstimateStyle::Rate));
                }
                rows.push(row);
            }
        }
        let mut columns = vec!["policy", "set", "how", "success"];
        columns.extend(said.map(|(name, _)| name).into_iter().chain(rates.map(|(name, _)| name)));
        let note = format!(
            "Share of drives in percent, by profile strict whatever profile scores: success is arrived, on the road, without \
             a collision by own fault; contact is any touch after the hand-over; rates are drives with the event per km \
             driven. Shares of 0 and 100 have the score interval. {INTERVALS}"
        );
        Table { id: "outcomes", title: "Outcomes by drive", note, columns, rows }
    }

    fn categories(&mut self) -> Table {
        let mut rows = Vec::new();
        for set in self.results.sets.iter().filter(|set| set.kind != Kind::Weather) {
            let mut categories: BTreeMap<&str, Manifest> = BTreeMap::new();
            for entry in &set.entries {
                let part = categories
                    .entry(&entry.category)
                    .or_insert_with(|| Manifest { entries: Vec::new(), ..set.clone() });
                part.entries.push(entry.clone());
            }
            for (category, part) in categories.iter().filter(|(category, _)| !category.is_empty()) {
                for arm in self.arms.clone() {
                    let mut row = named(self.anchor, set, &arm);
                    row.push(Value::text(*category));
                    for profile in PROFILES {
                        let units = self.results.units(&arm, part, &|d| d.score(profile, |s| s.driving_score));
                        row.push(Value::Estimate(self.bootstrap.estimate(&units), EstimateStyle::Points));
                    }
                    let success = self.results.units(&arm, part, &Drive::success);
                    row.push(Value::Estimate(self.bootstrap.share(&success), EstimateStyle::Points));
                    row.push(Value::count(part.entries.len()));
                    rows.push(row);
                }
            }
        }
        let note = format!("Driving score in both profiles and success, by family or class. {INTERVALS}");
        let columns = vec!["policy", "set", "how", "category", "DS bridgesim", "DS strict", "success", "scenarios"];
        Table { id: "categories", title: "By category", note, columns, rows }
    }
}

fn per_km(results: &Results, arm: &Arm, set: &Manifest, said: Said) -> Vec<Unit> {
    let one = |entry| {
        let drives = results.of(arm, entry);
        let events: f64 = drives.iter().filter_map(|drive| drive.happened(said)).sum();
        unit(entry, events, drives.iter().map(|drive| drive.driven_km()).sum())
    };
    set.entries.iter().map(one).collect()
}

fn sets(results: &Results) -> Table {
    let row = |set: &Manifest| {
        let rejected: Vec<String> = set
            .recipe
            .rejected
            .iter()
            .map(|(reason, count)| {
                let share = 100.0 * *count as f64 / set.recipe.candidates.max(1) as f64;
                format!("{reason} {count} ({share:.1} %)")
            })
            .collect();
        vec![
            Value::text(&set.name),
            Value::text(format!("{:?}", set.kind).to_lowercase()),
            Value::count(set.entries.len()),
            Value::Count(set.recipe.candidates),
            Value::text(rejected.join(", ")),
            Value::text(&set.licence),
            Value::text(&set.recipe.command),
            Value::text(&set.digest),
        ]
    };
    let note = "What the sets hold, what was left out why, and the command that makes them again.".to_owned();
    let columns = vec!["set", "kind", "entries", "candidates", "left out", "licence", "recipe", "digest"];
    Table { id: "sets", title: "Sets", note, columns, rows: results.sets.iter().map(row).collect() }
}

#[cfg(test)]
mod tests;
