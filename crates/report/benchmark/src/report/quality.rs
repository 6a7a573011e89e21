//! What the search of adversaries came to, set by set, beside the bars; and what policies score by how long they may wait.

use super::rows::{Anchor, INTERVALS, driving_score, named};
use crate::estimate::{Bootstrap, Estimate};
use crate::judge::PROFILES;
use crate::manifest::Manifest;
use crate::quality::{Figure, Quality};
use crate::results::Results;
use crate::table::{EstimateStyle, Table, Value};

/// Reaction margins that are told apart, in seconds.
const BANDS_SECS: [(&str, f64, f64); 4] =
    [("below 1 s", 0.0, 1.0), ("1 to 2 s", 1.0, 2.0), ("2 to 3 s", 2.0, 3.0), ("3 s and more", 3.0, f64::INFINITY)];

/// Returns the figures of all sets with adversaries that have some.
pub(super) fn quality(results: &Results) -> Table {
    let row = |set: &str, figure: &Figure| {
        let estimate = Estimate {
            value: figure.value,
            by_scenario: figure.interval,
            by_log: figure.interval,
            ..Estimate::default()
        };
        let said = match figure.met() {
            None => "not measured",
            Some(_) if figure.least.is_none() && figure.most.is_none() => "no bar",
            Some(true) => "met",
            Some(false) => "missed",
        };
        vec![
            Value::text(set),
            Value::text(&figure.what),
            Value::Estimate(estimate, EstimateStyle::Rate),
            Value::text(bar(figure)),
            Value::text(said),
        ]
    };
    let of = |quality: &Quality| quality.figures.iter().map(|figure| row(&quality.set, figure)).collect::<Vec<_>>();
    let note = "Figures of the search that made the sets, as they lie beside the manifests; shares of 1, 95 % intervals of shares \
                (Wilson). What bars policies have to meet stands in the other tables."
        .to_owned();
    let columns = vec!["set", "measure", "figure", "bar", "met"];
    Table {
        id: "quality",
        title: "Adversaries as found",
        note,
        columns,
        rows: results.quality.iter().flat_map(of).collect(),
    }
}

fn bar(figure: &Figure) -> String {
    match (figure.least, figure.most) {
        (Some(least), Some(most)) => format!("{least} to {most}"),
        (Some(least), None) => format!("≥ {least}"),
        (None, Some(most)) => format!("≤ {most}"),
        (None, None) => "none".to_owned(),
    }
}

/// Returns driving score and contacts by the time that an ego may wait before even an expert meets the adversary.
pub(super) fn margins(results: &Results, anchor: Anchor, bootstrap: &mut Bootstrap) -> Table {
    let mut rows = Vec::new();
    for quality in &results.quality {
        let Some(set) = results.sets.iter().find(|set| set.name == quality.set) else { continue };
        for arm in results.sheet.arms() {
            for (name, from_secs, to_secs) in BANDS_SECS {
                let part = within(set, quality, from_secs..to_secs);
                if part.entries.is_empty() {
                    continue;
                }
                let mut row = named(anchor, set, &arm);
                row.extend([Value::text(name), Value::count(part.entries.len())]);
                for profile in PROFILES {
                    let units = results.units(&arm, &part, &driving_score(profile));
                    row.push(Value::Estimate(bootstrap.estimate(&units), EstimateStyle::Points));
                }
                let contacts = results.units(&arm, &part, &|drive| drive.happened(|outcome| outcome.contact));
                row.push(Value::Estimate(bootstrap.share(&contacts), EstimateStyle::Points));
                rows.push(row);
            }
        }
    }
    let columns = vec!["policy", "set", "how", "margin", "variants", "DS bridgesim", "DS strict", "contact"];
    let note = format!(
        "By reaction margin: from the threat tick, at which the adversary first does not go on as it did or the time to collision \
         is below 4 s, to the last one from which an expert still finds a drive that meets nobody. {INTERVALS}"
    );
    Table { id: "margins", title: "By reaction margin", note, columns, rows }
}

/// Returns the part of a set whose reaction margins lie in a range.
fn within(set: &Manifest, quality: &Quality, secs: std::ops::Range<f64>) -> Manifest {
    let margin = |name: &str| quality.variants.get(name)?.margin_secs;
    let these = |entry: &&crate::Entry| margin(&entry.name).is_some_and(|margin| secs.contains(&margin));
    Manifest { entries: set.entries.iter().filter(these).cloned().collect(), ..set.clone() }
}
