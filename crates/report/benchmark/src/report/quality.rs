//! What the search of adversaries came to, set by set, beside the bars.

use crate::estimate::Estimate;
use crate::quality::Figure;
use crate::results::Results;
use crate::table::{Shown, Table, Value};

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
            Value::Estimate(estimate, Shown::Rate),
            Value::text(bar(figure)),
            Value::text(said),
        ]
    };
    let of =
        |quality: &crate::Quality| quality.figures.iter().map(|figure| row(&quality.set, figure)).collect::<Vec<_>>();
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
