//! Tables as CSV after RFC 4180: a header line, CRLF, fields quoted where they need it, UTF-8.
//!
//! Text that a spreadsheet would run as a formula (it begins with `=`, `+`, `-`, `@`, tab or return) gets an
//! apostrophe in front; numbers are written with as many digits as reading them back exactly needs.

use crate::aggregate::Aggregate;
use crate::results::Results;
use crate::write::columns::{self, Table, Values};

/// Returns one row per episode of all runs.
#[must_use]
pub fn episodes(runs: &[Results]) -> String {
    table(&columns::episodes(runs))
}

/// Returns one row per group and metric.
#[must_use]
pub fn aggregate(aggregate: &Aggregate) -> String {
    table(&columns::aggregate(aggregate))
}

/// Returns any table.
#[must_use]
pub fn table(table: &Table) -> String {
    let header: Vec<String> = table.columns.iter().map(|column| field(&column.name)).collect();
    let mut text = header.join(",") + "\r\n";
    for row in 0..table.rows() {
        let fields: Vec<String> = table.columns.iter().map(|column| value(&column.values, row)).collect();
        text += &fields.join(",");
        text += "\r\n";
    }
    text
}

fn value(values: &Values, row: usize) -> String {
    match values {
        Values::Text(values) => field(&values[row]),
        Values::Count(values) => values[row].map_or_else(String::new, |count| count.to_string()),
        Values::Number(values) => values[row].map_or_else(String::new, |number| number.to_string()),
    }
}

fn field(text: &str) -> String {
    let formula = text.starts_with(['=', '+', '-', '@', '\t', '\r']);
    let text = if formula { format!("'{text}") } else { text.to_owned() };
    let plain = !text.contains(['"', ',', '\r', '\n']) && text.trim() == text;
    if plain { text } else { format!("\"{}\"", text.replace('"', "\"\"")) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample;

    #[test]
    fn fields_are_quoted_where_they_need_it() {
        for (text, expected) in [
            ("", ""),
            ("plain", "plain"),
            ("a,b", "\"a,b\""),
            ("say \"x\"", "\"say \"\"x\"\"\""),
            ("two\nlines", "\"two\nlines\""),
            (" padded ", "\" padded \""),
            ("=HYPERLINK(\"x\")", "\"'=HYPERLINK(\"\"x\"\")\""),
            ("@sum", "'@sum"),
            ("-1+1", "'-1+1"),
            ("käse → 速い", "käse → 速い"),
        ] {
            assert_eq!(field(text), expected, "{text:?}");
        }
    }

    /// A reader of its own, after the grammar of RFC 4180.
    fn read(text: &str) -> Vec<Vec<String>> {
        let (mut rows, mut row, mut cell, mut quoted) = (Vec::new(), Vec::new(), String::new(), false);
        let mut chars = text.chars().peekable();
        while let Some(c) = chars.next() {
            match c {
                '"' if quoted && chars.next_if_eq(&'"').is_some() => cell.push('"'),
                '"' => quoted = !quoted,
                ',' if !quoted => row.push(std::mem::take(&mut cell)),
                '\r' if !quoted => {
                    assert_eq!(chars.next(), Some('\n'));
                    row.push(std::mem::take(&mut cell));
                    rows.push(std::mem::take(&mut row));
                }
                c => cell.push(c),
            }
        }
        assert!(!quoted && cell.is_empty() && row.is_empty(), "the file ends with a line end");
        rows
    }

    #[test]
    fn episodes_come_back() {
        let runs = sample::runs();
        let rows = read(&episodes(&runs));
        let column = |name: &str| rows[0].iter().position(|title| title == name).expect(name);
        let (scenario, score, seed) = (column("scenario"), column("driving_score"), column("seed"));
        let all: Vec<_> = runs.iter().flat_map(|run| &run.episodes).collect();
        assert_eq!(rows.len(), all.len() + 1);
        for (row, episode) in rows[1..].iter().zip(all) {
            assert_eq!(row.len(), rows[0].len());
            assert_eq!(row[scenario].trim_start_matches('\''), episode.scenario);
            assert_eq!(row[seed], episode.seed.to_string());
            assert_eq!(row[score].parse().ok(), episode.driving_score);
        }
    }

    #[test]
    fn the_aggregate_has_a_row_per_group_and_metric() {
        let report = sample::report();
        let rows = read(&aggregate(&report.headline));
        let expected: usize = report.headline.groups.iter().map(|group| group.metrics.len()).sum();
        assert_eq!(rows.len(), expected + 1);
        assert!(rows[0].contains(&"headline_low".to_owned()) && rows.iter().all(|row| row.len() == rows[0].len()));
    }
}
