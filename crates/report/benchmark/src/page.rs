//! A report as files: page, Markdown, JSON, and one CSV and Arrow file per table.

use std::path::Path;

use ds_page::{Document, Markup, Pictures, sections, svg};
use ds_run_report::write::{arrow, csv, html, points};
use serde_json::json;

use crate::file::{self, FileError};
use crate::report::Report;
use crate::table::{Table, Value};

/// Height of a row of the plot, in pixels.
const ROW_PX: f64 = 26.0;
/// Where the scale of the plot begins and ends, in pixels.
const SCALE_PX: (f64, f64) = (420.0, 930.0);

/// The report as JSON.
const JSON: &str = "report.json";
/// The folder of the tables, and how their files end.
const TABLES: &str = "tables";
const FORMS: [&str; 2] = ["csv", "arrow"];

/// Writes the report into a folder, and removes the tables of the report that is there which this one does not have.
///
/// # Errors
/// [`FileError::Write`].
pub fn write(report: &Report, folder: &Path) -> Result<(), FileError> {
    let stale: Vec<String> = tables(folder).into_iter().filter(|id| report.tables.iter().all(|t| t.id != id)).collect();
    let files = stale.iter().flat_map(|id| FORMS.map(|form| folder.join(TABLES).join(format!("{id}.{form}"))));
    for path in files.filter(|path| path.exists()) {
        std::fs::remove_file(&path).map_err(|source| FileError::Write { path, source })?;
    }
    file::write(page(report).as_bytes(), &folder.join("report.html"))?;
    file::write(markdown(report).as_bytes(), &folder.join("report.md"))?;
    file::write_json(&value(report), &folder.join(JSON))?;
    for table in &report.tables {
        let columns = table.columns();
        let [csv_file, path] = FORMS.map(|form| folder.join(TABLES).join(format!("{}.{form}", table.id)));
        file::write(csv::table(&columns).as_bytes(), &csv_file)?;
        let bytes = arrow::table(&columns, &[("title", table.title)])
            .map_err(|error| FileError::Write { path: path.clone(), source: std::io::Error::other(error) })?;
        file::write(&bytes, &path)?;
    }
    Ok(())
}

/// Returns the names of the tables of the report that is in a folder; none where it cannot be read.
fn tables(folder: &Path) -> Vec<String> {
    let report: Option<serde_json::Value> = file::read_json(&folder.join(JSON)).ok();
    let tables = report.as_ref().and_then(|report| report["tables"].as_object());
    let named = |id: &&String| id.chars().all(|letter| letter.is_ascii_lowercase());
    tables.map_or(Vec::new(), |tables| tables.keys().filter(named).cloned().collect())
}

/// Returns the report in Markdown.
#[must_use]
pub fn markdown(report: &Report) -> String {
    let mut text = format!("# {}\n\n", report.title);
    for warning in &report.warnings {
        text += &format!("**{warning}**\n\n");
    }
    for (name, value) in &report.facts {
        text += &format!("- {name}: {value}\n");
    }
    text.push('\n');
    report.tables.iter().for_each(|table| text += &table.markdown());
    text
}

fn value(report: &Report) -> serde_json::Value {
    let facts: Vec<_> = report.facts.iter().map(|(name, value)| json!({"name": name, "value": value})).collect();
    let tables: serde_json::Map<_, _> = report.tables.iter().map(|table| (table.id.to_owned(), table.json())).collect();
    json!({
        "title": report.title,
        "complete": report.complete,
        "warnings": report.warnings,
        "facts": facts,
        "tables": tables,
    })
}

/// Returns the page.
#[must_use]
pub fn page(report: &Report) -> String {
    let document =
        Document { title: &report.title, style: html::STYLE, script: Some(html::SCRIPT), pictures: Pictures::Beside };
    document.page(|m| {
        m.inside("header", &[], |m| {
            m.inside("div", &[], |m| {
                m.leaf("p", &[("class", &"brand")], "DreamStream");
                m.leaf("h1", &[], &report.title);
                report.warnings.iter().for_each(|warning| m.leaf("p", &[("class", &"alarm")], warning));
                m.inside("ul", &[("class", &"facts")], |m| {
                    for (name, value) in &report.facts {
                        m.inside("li", &[], |m| {
                            m.leaf("b", &[], name);
                            m.text(value);
                        });
                    }
                });
            });
        });
        let parts: Vec<(&'static str, &str)> = report.tables.iter().map(|table| (table.id, table.title)).collect();
        sections(m, &parts, |m, id| {
            let Some(table) = report.tables.iter().find(|table| table.id == id) else { return };
            if id == "policies" {
                plot(m, table);
            }
            table.html(m);
            report.plots.get(id).into_iter().flatten().for_each(|plot| plot.draw(m));
        });
    })
}

/// Returns what each row is called: its policy, and of set, profile and how it was driven what differs between rows.
fn labels(table: &Table) -> Vec<String> {
    let words = |row: &Vec<Value>| -> Vec<String> {
        let how = row[2].told();
        let parts = [row[0].told(), row[1].told(), row[3].told()].into_iter();
        parts.chain(how.split(" · ").map(str::to_owned)).collect()
    };
    let rows: Vec<Vec<String>> = table.rows.iter().map(words).collect();
    let differs = |place: usize| place == 0 || rows.iter().any(|row| row.get(place) != rows[0].get(place));
    let label = |row: &Vec<String>| {
        let told: Vec<&str> =
            row.iter().enumerate().filter(|(place, _)| differs(*place)).map(|(_, word)| word.as_str()).collect();
        told.join(" · ")
    };
    rows.iter().map(label).collect()
}

/// Draws a dot with whiskers for the driving score of every row.
fn plot(m: &mut Markup, table: &Table) {
    let Some(place) = table.columns.iter().position(|name| *name == "DS") else { return };
    let height = ROW_PX * (table.rows.len() as f64 + 1.5);
    let at = |value: f64| SCALE_PX.0 + (SCALE_PX.1 - SCALE_PX.0) * value.clamp(0.0, 1.0);
    let labels = labels(table);
    svg::wide(m, "Driving score with its interval", (980.0, height), |m| {
        for tenth in [0.0, 0.2, 0.4, 0.6, 0.8, 1.0] {
            svg::line(m, "grid", (at(tenth), 0.0), (at(tenth), height - ROW_PX));
            svg::text(m, "tick", (at(tenth), height - 8.0), &points(Some(tenth)));
        }
        for (index, row) in table.rows.iter().enumerate() {
            let y = ROW_PX * (index as f64 + 0.7);
            svg::text(m, "label", (SCALE_PX.0 - 12.0, y + 4.0), &svg::short(&labels[index], 58));
            let Value::Estimate(estimate, _) = &row[place] else { continue };
            m.inside("g", &[("class", &format_args!("p{}", index % 6))], |m| {
                if let Some([low, high]) = estimate.interval() {
                    svg::line(m, "whisker", (at(low), y), (at(high), y));
                }
                if let Some(value) = estimate.value {
                    svg::dot(m, "dot", (at(value), y), 5.0);
                }
            });
        }
    });
}
