//! Tables for terminals, pull requests and documents, in points of 100.
//!
//! Names are escaped so that they end neither a cell nor a line and become no markup.

use std::fmt::Write;

use crate::aggregate::{Aggregate, HEADLINE, INTERVALS, WEIGHTING};
use crate::bias::{Bias, Subject};
use crate::compare::Comparison;
use crate::report::Report;
use crate::term;
use crate::write::{chance, points, range, signed};

/// Returns the whole report.
#[must_use]
pub fn report(report: &Report) -> String {
    let mut text = format!("# {}\n\n", escaped(&report.title));
    let counts = report.counts;
    let _ = writeln!(
        text,
        "{} scenarios, {} drives: {} completed, {} failed, {} aborted.\n",
        counts.scenarios, counts.episodes, counts.completed, counts.failed, counts.aborted
    );
    for line in &report.partial {
        let _ = writeln!(text, "- partial: {}", escaped(line));
    }
    for (name, value) in &report.constant {
        let _ = writeln!(text, "- {name}: {}", escaped(value));
    }
    let _ = writeln!(text, "\n## Headline\n\n{}", aggregate(&report.headline));
    if let Some(categories) = &report.categories {
        let _ = writeln!(text, "## By category\n\n{}", aggregate(categories));
    }
    for compared in &report.comparisons {
        let _ =
            writeln!(text, "## {} against {}\n\n{}", escaped(&compared.b), escaped(&compared.a), comparison(compared));
    }
    if let Some(found) = &report.bias {
        let _ = writeln!(text, "## Scorer and proposals\n\n{}", bias(found));
    }
    if !report.unfinished.is_empty() {
        let rows = report.unfinished.iter().map(|drive| {
            let seed = drive.seed.to_string();
            [&drive.scenario, &drive.policy, &seed, &drive.status, &drive.reason].map(String::clone).to_vec()
        });
        let titles = ["scenario", "policy", "seed", "status", "reason"];
        let _ = writeln!(text, "## Failed and aborted\n\n{}", table(&titles, rows));
    }
    text
}

/// Returns one row per group: driving score with both means, and the other totals.
#[must_use]
pub fn aggregate(aggregate: &Aggregate) -> String {
    let mut titles: Vec<&str> = aggregate.by.iter().map(|dimension| dimension.name()).collect();
    titles.extend(["scenarios", "drives", "driving score", "95 %", "finished only", "route completion", "mean score"]);
    titles.extend(["failed", "aborted", "not applicable"]);
    let rows = aggregate.groups.iter().map(|group| {
        let mut row = group.key.clone();
        let mean = |name: &str| points(group.metric(name).and_then(|metric| metric.headline.mean));
        let score = group.metric("driving_score");
        row.extend([group.counts.scenarios.to_string(), group.counts.episodes.to_string(), mean("driving_score")]);
        row.push(range(score.and_then(|score| score.headline.interval)));
        row.push(points(score.and_then(|score| score.finished.mean)));
        row.extend([mean("route_completion"), mean("mean_score")]);
        row.extend([group.counts.failed.to_string(), group.counts.aborted.to_string()]);
        row.push(score.map_or(0, |score| score.not_applicable).to_string());
        row
    });
    format!("{}\nPoints of 100. Weighting: {WEIGHTING}. {HEADLINE}. Intervals: {INTERVALS}.\n", table(&titles, rows))
}

/// Returns one row per metric of every group, then what has no partner.
#[must_use]
pub fn comparison(comparison: &Comparison) -> String {
    let mut titles: Vec<&str> = comparison.by.iter().map(|dimension| dimension.name()).collect();
    titles.extend(["metric", "a", "b", "b − a", "95 %", "p", "p (Holm)", "scenarios", "conclusion"]);
    let rows = comparison.groups.iter().flat_map(|group| {
        group.metrics.iter().map(|metric| {
            let mut row = group.key.clone();
            row.extend([term::metric_title(&metric.metric), points(metric.a), points(metric.b)]);
            row.extend([signed(metric.difference), range(metric.interval), chance(metric.p), chance(metric.p_holm)]);
            row.extend([metric.scenarios.to_string(), metric.verdict.words().to_owned()]);
            row
        })
    });
    let mut text = format!("a: {}, b: {}\n\n", escaped(&comparison.a), escaped(&comparison.b));
    text += &table(&titles, rows);
    for note in &comparison.notes {
        let _ = writeln!(text, "\nNote: {}.", escaped(note));
    }
    let _ = writeln!(text, "\nPoints of 100. Test: {}. Weighting: {WEIGHTING}.", comparison.test);
    if !comparison.unmatched.is_empty() {
        let rows = comparison.unmatched.iter().map(|unmatched| {
            vec![
                unmatched.run.to_owned(),
                unmatched.set.clone(),
                unmatched.scenario.clone(),
                unmatched.episodes.to_string(),
            ]
        });
        let _ = writeln!(text, "\nWithout a partner:\n\n{}", table(&["only in", "set", "scenario", "drives"], rows));
    }
    text
}

/// Returns scorer bias, proposal coverage and the proposals themselves, each as far as known.
#[must_use]
pub fn bias(bias: &Bias) -> String {
    let named = |subject: &Subject| [&subject.policy, &subject.set, &subject.scorer].map(String::clone).to_vec();
    let mut text = String::new();
    if !bias.scorer.is_empty() {
        let rows = bias.scorer.iter().map(|row| {
            let mut cells = named(&row.subject);
            cells.extend([points(row.learned), points(row.oracle), signed(row.bias.mean), range(row.bias.interval)]);
            cells.push(row.bias.scenarios.to_string());
            cells
        });
        let titles = ["policy", "set", "oracle", "DS learned", "DS oracle", "scorer bias", "95 %", "scenarios"];
        text += &table(&titles, rows);
    }
    if !bias.coverage.is_empty() {
        let rows = bias.coverage.iter().map(|row| {
            let mut cells = named(&row.subject);
            cells.extend([points(row.base), points(row.changed), signed(row.difference), range(row.interval)]);
            cells.push(format!("{} / {}", row.base_scenarios, row.changed_scenarios));
            cells.push(if row.paired { "paired" } else { "unpaired" }.to_owned());
            cells
        });
        let base = format!("DS on {}", bias.base_set);
        let titles =
            ["policy", "set", "oracle", &base, "DS on set", "proposal coverage", "95 %", "scenarios", "interval"];
        let _ = write!(text, "\n{}", table(&titles, rows));
    }
    if !bias.proposals.is_empty() {
        let rows = bias.proposals.iter().map(|row| {
            let mut cells = named(&row.subject);
            cells.extend([points(row.best.mean), range(row.best.interval), points(row.bare_ticks.mean)]);
            cells.extend([points(row.scenarios_with_bare_tick.mean), points(row.scenarios_without_positive.mean)]);
            cells.push(row.best.scenarios.to_string());
            cells
        });
        let titles = [
            "policy",
            "set",
            "scorer",
            "best proposal",
            "95 %",
            "% ticks without positive",
            "% scenarios with such a tick",
            "% scenarios without any",
            "scenarios",
        ];
        let _ = write!(text, "\n{}", table(&titles, rows));
    }
    text
}

fn table(titles: &[&str], rows: impl Iterator<Item = Vec<String>>) -> String {
    let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
    let mut text = line(titles.iter().map(|title| escaped(title)).collect());
    text += &line(vec!["---".to_owned(); titles.len()]);
    for row in rows {
        text += &line(row.iter().map(|cell| escaped(cell)).collect());
    }
    text
}

/// Keeps names from ending a cell, a line or from becoming markup.
fn escaped(text: &str) -> String {
    let mut out = String::new();
    let mut rest = text.chars().peekable();
    while let Some(c) = rest.next() {
        match c {
            // Before a space or at the end it begins no markup, and a terminal shows it as it is.
            '<' if rest.peek().is_none_or(|next| *next == ' ') => out.push('<'),
            '\\' | '|' | '`' | '*' | '[' | ']' | '#' | '~' => out.extend(['\\', c]),
            '<' => out += "&lt;",
            '>' => out += "&gt;",
            '&' => out += "&amp;",
            c if c.is_control() => out.push(' '),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample;

    #[test]
    fn hostile_names_stay_in_their_cell() {
        assert_eq!(escaped("a|b\n<img>`*[x](y)"), "a\\|b &lt;img&gt;\\`\\*\\[x\\](y)");
    }

    #[test]
    fn a_small_p_value_reads_as_it_is() {
        assert_eq!(escaped(&chance(Some(0.0004))), "< 0.001");
        assert_eq!(escaped("a <b> < c <"), "a &lt;b&gt; < c <");
    }

    #[test]
    fn every_row_has_the_cells_of_its_header() {
        let text = report(&sample::report());
        let mut columns = 0;
        for line in text.lines() {
            let cells = line.replace("\\|", "").matches('|').count();
            if columns > 0 && cells > 0 {
                assert_eq!(cells, columns, "{line}");
            }
            columns = cells;
        }
        for part in
            ["## Headline", "## Failed and aborted", "## Scorer and proposals", "Weighting", "Without a partner"]
        {
            assert!(text.contains(part), "{part} is missing:\n{text}");
        }
    }
}
