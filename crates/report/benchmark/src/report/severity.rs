//! How hard the variants of a set are: its classes with closing speed and Δv at the contact, and whether who is left less time to
//! react loses more of the driving score.

use std::collections::BTreeMap;

use ds_stats::{fisher, sorted_quantile, spearman};

use super::rows::{Anchor, driving_score, named};
use crate::estimate::Estimate;
use crate::judge::PROFILES;
use crate::manifest::{Entry, Kind, Manifest};
use crate::plot::{Columns, Plot, Scatter, Series};
use crate::quality::{Quality, Severity};
use crate::results::Results;
use crate::sheet::Arm;
use crate::table::{EstimateStyle, Table, Value};

/// Reads a measure of a variant, in metres per second.
type Measure = fn(&Severity) -> f64;

const MEASURES: [(&str, Measure); 2] = [
    ("Closing speed at the contact, m/s", |severity| severity.closing_mps),
    ("Δv of equal masses that stay together, m/s", |severity| severity.delta_v_mps),
];
/// Quantiles that a table tells.
const QUANTILES: [f64; 4] = [0.25, 0.5, 0.75, 1.0];
/// The profile of the driving score in the plot of losses.
const PLOTTED: &str = PROFILES[0];

/// Returns the sets that have figures beside their manifest, whole and not only what reviewers accept.
fn searched(results: &Results) -> impl Iterator<Item = (&Manifest, &Quality)> {
    let sets = results.sets.iter().filter(|set| set.kind == Kind::Behavior);
    sets.filter_map(|set| Some((set, results.quality.iter().find(|quality| quality.set == set.name)?)))
}

/// Returns the variants of a set that have figures, by class.
fn by_class<'a>(set: &'a Manifest, quality: &'a Quality) -> BTreeMap<&'a str, Vec<&'a Severity>> {
    let mut classes: BTreeMap<&str, Vec<&Severity>> = BTreeMap::new();
    for entry in &set.entries {
        classes.entry(&entry.category).or_default().extend(quality.variants.get(&entry.name));
    }
    classes
}

/// Returns classes with closing speed and Δv, set by set, and their distributions as plots.
pub(super) fn severity(results: &Results) -> (Table, Vec<Plot>) {
    let (mut rows, mut plots) = (Vec::new(), Vec::new());
    for (set, quality) in searched(results) {
        let classes = by_class(set, quality);
        let all: Vec<&Severity> = classes.values().flatten().copied().collect();
        for (class, variants) in [("all", &all)].into_iter().chain(classes.iter().map(|(class, all)| (*class, all))) {
            let mut row = vec![Value::text(&set.name), Value::text(class), Value::count(variants.len())];
            row.push(Value::Score((!all.is_empty()).then(|| variants.len() as f64 / all.len() as f64)));
            row.extend(MEASURES.into_iter().flat_map(|(_, measure)| quantiles(variants, measure)));
            rows.push(row);
        }
        for (title, measure) in MEASURES {
            let groups = classes.iter().map(|(class, variants)| {
                ((*class).to_owned(), variants.iter().map(|severity| measure(severity)).collect())
            });
            plots.push(Plot::Columns(Columns { title: format!("{}: {title}", set.name), groups: groups.collect() }));
        }
    }
    let mut columns = vec!["set", "class", "variants", "share %"];
    columns.extend(["closing lower quarter", "closing median", "closing upper quarter", "closing most"]);
    columns.extend(["delta v lower quarter", "delta v median", "delta v upper quarter", "delta v most"]);
    let note = "Of the logged drive, in m/s: how fast the bodies approach at the contact, and how much the velocity of either changes if \
                equal masses stay together. Of all valid variants, whether reviewed or not."
        .to_owned();
    (Table { id: "severity", title: "Class and severity", note, columns, rows }, plots)
}

fn quantiles(variants: &[&Severity], measure: Measure) -> [Value; 4] {
    let mut values: Vec<f64> = variants.iter().map(|severity| measure(severity)).collect();
    values.sort_by(f64::total_cmp);
    QUANTILES.map(|share| Value::Number(sorted_quantile(&values, share)))
}

/// Returns how the loss of driving score goes with the reaction margin, arm by arm, and each variant as a dot.
pub(super) fn losses(results: &Results, anchor: Anchor) -> (Table, Vec<Plot>) {
    let (mut rows, mut plots) = (Vec::new(), Vec::new());
    for (set, quality) in searched(results) {
        let mut series = Vec::new();
        for arm in results.sheet.arms() {
            for profile in PROFILES {
                let Lost { margins, losses, logs } = lost(results, &arm, set, quality, profile);
                if margins.is_empty() {
                    continue;
                }
                let rank = spearman(&margins, &losses);
                let interval = |units| rank.and_then(|rank| fisher(rank, units));
                let (scenarios, logs) = (margins.len(), logs.len());
                let (by_scenario, by_log) = (interval(scenarios), interval(logs));
                let estimate = Estimate { value: rank, by_scenario, by_log, scenarios, logs };
                let mut row = named(anchor, set, &arm);
                row.extend([Value::text(profile), Value::count(scenarios)]);
                row.extend([Value::Score(ds_stats::mean(losses.iter().copied()))]);
                row.push(Value::Estimate(estimate, EstimateStyle::Rate));
                rows.push(row);
                if profile == PLOTTED {
                    let name = format!("{} · {}", arm.policy.name, super::rows::how(&arm));
                    series.push(Series { name, points: margins.into_iter().zip(losses).collect() });
                }
            }
        }
        if !series.is_empty() {
            let title = format!("{}: DS lost to the base (points, {PLOTTED}) over the reaction margin (s)", set.name);
            plots.push(Plot::Scatter(Scatter { title, series }));
        }
    }
    let columns = vec!["policy", "set", "how", "profile", "variants", "DS lost", "rank correlation"];
    let note = "DS of the base minus DS of the variant, and its rank correlation (Spearman) with the reaction margin: below 0, who is \
                left more time loses less. Intervals after Fisher, over scenarios and with logs as units; the wider one is shown. \
                Exploratory: nothing here is tested."
        .to_owned();
    (Table { id: "losses", title: "Reaction margin and loss", note, columns, rows }, plots)
}

/// Variants with a reaction margin whose base was driven too.
#[derive(Default)]
struct Lost {
    margins: Vec<f64>,
    losses: Vec<f64>,
    logs: std::collections::BTreeSet<String>,
}

fn lost(results: &Results, arm: &Arm, set: &Manifest, quality: &Quality, profile: &'static str) -> Lost {
    let score = driving_score(profile);
    let mut lost = Lost::default();
    for entry in &set.entries {
        let pair = || -> Option<(f64, f64)> {
            let margin_secs = quality.variants.get(&entry.name)?.margin_secs?;
            let base: &Entry = results.base_of(entry)?;
            Some((margin_secs, results.mean(arm, base, &score)? - results.mean(arm, entry, &score)?))
        };
        if let Some((margin_secs, loss)) = pair() {
            lost.margins.push(margin_secs);
            lost.losses.push(loss);
            lost.logs.insert(entry.log.clone());
        }
    }
    lost
}
