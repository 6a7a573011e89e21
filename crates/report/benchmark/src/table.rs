//! Tables of a report as values, and their four forms: CSV, Arrow, Markdown, HTML. Scores are 0 to 1 in files and points
//! of 100 where people read them.

use ds_page::Markup;
use ds_run_report::write::columns::{self, Column, Values};
use ds_run_report::write::{chance, number, points, signed};
use serde_json::json;

use crate::estimate::Estimate;

/// How an estimate is shown to people.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EstimateStyle {
    /// Points of 100.
    Points,
    /// Points of 100 with their sign.
    Signed,
    /// As it is, with two digits.
    Rate,
}

/// One cell.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// Words.
    Text(String),
    /// A whole number.
    Count(u64),
    /// A value with its intervals.
    Estimate(Estimate, EstimateStyle),
    /// A score, shown in points; nothing where there is none.
    Score(Option<f64>),
    /// A p-value.
    Chance(Option<f64>),
    /// A measured number, shown with one digit; nothing where it was not measured.
    Number(Option<f64>),
}

impl Value {
    /// Makes words.
    #[must_use]
    pub fn text(words: impl Into<String>) -> Self {
        Self::Text(words.into())
    }

    /// Makes a whole number.
    #[must_use]
    pub fn count(count: usize) -> Self {
        Self::Count(count as u64)
    }

    /// Returns the value for people.
    #[must_use]
    pub fn told(&self) -> String {
        match self {
            Self::Text(words) => words.clone(),
            Self::Count(count) => count.to_string(),
            Self::Estimate(estimate, shown) => told(estimate, *shown),
            Self::Score(value) => points(*value),
            Self::Chance(p) => chance(*p),
            Self::Number(value) => value.map_or("n/a".to_owned(), |value| number(value, 1)),
        }
    }

    fn json(&self) -> serde_json::Value {
        match self {
            Self::Text(words) => json!(words),
            Self::Count(count) => json!(count),
            Self::Estimate(estimate, _) => {
                json!({"value": estimate.value, "interval": estimate.interval(), "by_scenario": estimate.by_scenario,
                    "by_log": estimate.by_log, "scenarios": estimate.scenarios, "logs": estimate.logs})
            }
            Self::Score(value) | Self::Chance(value) | Self::Number(value) => json!(value),
        }
    }

    /// Returns what the value is sorted by, if it is a number.
    fn sort(&self) -> Option<f64> {
        match self {
            Self::Text(_) => None,
            Self::Count(count) => Some(*count as f64),
            Self::Estimate(estimate, _) => estimate.value,
            Self::Score(value) | Self::Chance(value) | Self::Number(value) => *value,
        }
    }
}

fn told(estimate: &Estimate, shown: EstimateStyle) -> String {
    let one = |value: f64| match shown {
        EstimateStyle::Points => points(Some(value)),
        EstimateStyle::Signed => signed(Some(value)),
        EstimateStyle::Rate => number(value, 2),
    };
    match (estimate.value, estimate.interval()) {
        (Some(value), Some([low, high])) => format!("{} ({} … {})", one(value), one(low), one(high)),
        (Some(value), None) => one(value),
        (None, _) => "n/a".to_owned(),
    }
}

/// A table.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// Its name in files.
    pub id: &'static str,
    /// Its title.
    pub title: &'static str,
    /// What its figures are.
    pub note: String,
    /// Its headings.
    pub columns: Vec<&'static str>,
    /// Its rows.
    pub rows: Vec<Vec<Value>>,
}

impl Table {
    /// Returns the table as columns of numbers and words: an estimate becomes its value, the interval that is shown, both
    /// intervals, and how much they are over.
    #[must_use]
    pub fn columns(&self) -> columns::Table {
        let mut all = Vec::new();
        for (index, name) in self.columns.iter().enumerate() {
            let cells: Vec<&Value> = self.rows.iter().map(|row| &row[index]).collect();
            all.extend(column(name, &cells));
        }
        columns::Table { columns: all }
    }

    /// Returns the table as JSON: one object per row.
    #[must_use]
    pub fn json(&self) -> serde_json::Value {
        let row = |row: &Vec<Value>| -> serde_json::Map<String, serde_json::Value> {
            self.columns.iter().zip(row).map(|(name, value)| ((*name).to_owned(), value.json())).collect()
        };
        let rows: Vec<_> = self.rows.iter().map(row).collect();
        json!({"title": self.title, "note": self.note, "rows": rows})
    }

    /// Returns the table in Markdown.
    #[must_use]
    pub fn markdown(&self) -> String {
        let clean = |text: &str| text.replace('|', "\\|").replace(['\n', '\r', '<'], " ");
        let mut text = format!("## {}\n\n{}\n\n| {} |\n", self.title, self.note, self.columns.join(" | "));
        text += &format!("|{}\n", "---|".repeat(self.columns.len()));
        for row in &self.rows {
            let cells: Vec<String> = row.iter().map(|value| clean(&value.told())).collect();
            text += &format!("| {} |\n", cells.join(" | "));
        }
        text + "\n"
    }

    /// Writes the table into a page.
    pub fn html(&self, m: &mut Markup) {
        m.leaf("p", &[("class", &"note")], &self.note);
        m.inside(
            "div",
            &[("class", &"scroll"), ("tabindex", &0), ("role", &"region"), ("aria-label", &self.title)],
            |m| {
                m.inside("table", &[("class", &"sortable")], |m| {
                    m.inside("thead", &[], |m| {
                        m.inside("tr", &[], |m| {
                            for name in &self.columns {
                                m.inside("th", &[("scope", &"col")], |m| {
                                    m.leaf("button", &[("type", &"button")], name)
                                });
                            }
                        });
                    });
                    m.inside("tbody", &[], |m| self.rows.iter().for_each(|row| write_row(m, row)));
                });
            },
        );
    }
}

fn write_row(m: &mut Markup, row: &[Value]) {
    m.inside("tr", &[], |m| {
        for (index, value) in row.iter().enumerate() {
            let tag = if index == 0 { "th" } else { "td" };
            match value {
                Value::Text(words) => m.inside(tag, &[("class", &"name")], |m| m.leaf("bdi", &[], words)),
                value => {
                    let sort = value.sort().map(|sort| sort.to_string()).unwrap_or_default();
                    m.leaf(tag, &[("class", &"n"), ("data-sort", &sort)], value.told());
                }
            }
        }
    });
    m.raw("\n");
}

/// Returns the columns that one column of cells becomes; it is of the kind of its first cell.
fn column(name: &str, cells: &[&Value]) -> Vec<Column> {
    let name = name.to_lowercase().replace([' ', '-'], "_");
    let numbers = |suffix: &str, value: &dyn Fn(&Estimate) -> Option<f64>| {
        let values = cells.iter().map(|cell| match cell {
            Value::Estimate(estimate, _) => value(estimate),
            _ => None,
        });
        Column { name: format!("{name}{suffix}"), values: Values::Number(values.collect()) }
    };
    match cells.first() {
        Some(Value::Estimate(..)) => vec![
            numbers("", &|e| e.value),
            numbers("_low", &|e| e.interval().map(|i| i[0])),
            numbers("_high", &|e| e.interval().map(|i| i[1])),
            numbers("_low_by_scenario", &|e| e.by_scenario.map(|i| i[0])),
            numbers("_high_by_scenario", &|e| e.by_scenario.map(|i| i[1])),
            numbers("_low_by_log", &|e| e.by_log.map(|i| i[0])),
            numbers("_high_by_log", &|e| e.by_log.map(|i| i[1])),
        ],
        Some(Value::Score(_) | Value::Chance(_) | Value::Number(_)) => {
            let values = cells.iter().map(|cell| cell.sort()).collect();
            vec![Column { name, values: Values::Number(values) }]
        }
        Some(Value::Count(_)) => {
            let count = |cell: &&Value| if let Value::Count(count) = cell { Some(*count) } else { None };
            vec![Column { name, values: Values::Count(cells.iter().map(count).collect()) }]
        }
        _ => vec![Column { name, values: Values::Text(cells.iter().map(|cell| cell.told()).collect()) }],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_table_has_four_forms() {
        let estimate = Estimate {
            value: Some(0.5),
            by_scenario: Some([0.4, 0.6]),
            by_log: Some([0.25, 0.75]),
            scenarios: 9,
            logs: 3,
        };
        let table = Table {
            id: "some",
            title: "Some",
            note: "What it is.".to_owned(),
            columns: vec!["policy", "DS", "p"],
            rows: vec![
                vec![Value::text("a|<b>"), Value::Estimate(estimate, EstimateStyle::Points), Value::Chance(Some(0.25))],
                vec![
                    Value::text("c"),
                    Value::Estimate(Estimate::default(), EstimateStyle::Points),
                    Value::Chance(None),
                ],
            ],
        };
        let csv = ds_run_report::write::csv::table(&table.columns());
        assert!(csv.starts_with("policy,ds,ds_low,ds_high,ds_low_by_scenario,"), "{csv}");
        assert!(csv.contains("0.5,0.25,0.75,0.4,0.6,0.25,0.75,0.25\r\n"), "{csv}");
        let markdown = table.markdown();
        assert!(markdown.contains("| a\\| b> | 50.0 (25.0 … 75.0) | 0.250 |"), "{markdown}");
        let mut m = Markup::default();
        table.html(&mut m);
        let page = m.finish();
        assert!(page.contains("a|&lt;b&gt;") && page.contains("data-sort=\"0.5\"") && page.contains("n/a"), "{page}");
    }
}
