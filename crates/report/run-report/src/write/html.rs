//! The page: one self-contained HTML file with tables and plots, nothing fetched from anywhere.
//!
//! Names and reasons are hostile input and are escaped by construction (`markup`); the page forbids itself every
//! request but pictures beside it. Plots are inline SVG in light and dark; sorting and filtering tables is the only
//! script, and all content is there without it. Scores are points of 100 here.

use std::collections::BTreeMap;

use ds_page as markup;

use crate::dimension::Dimension;
use crate::report::{Picture, Report};
use crate::results::Results;

mod differences;
mod method;
mod overview;
mod plot;
mod scenarios;
mod table;
#[cfg(test)]
mod tests;
mod worst;

use markup::{Document, Markup};

/// The rules of a page of drives.
pub const STYLE: &str = include_str!("html/page.css");
/// The script of a page of drives.
pub const SCRIPT: &str = include_str!("html/page.js");

/// Returns the page of a report; `runs` are those that it was made from, pictures lie beside the page.
#[must_use]
pub fn page(report: &Report, runs: &[Results], pictures: &[Picture]) -> String {
    let pictures = pictures.iter().map(|picture| ((picture.run, picture.episode), picture.path.as_str())).collect();
    let document =
        Document { title: &report.title, style: STYLE, script: Some(SCRIPT), pictures: markup::Pictures::Beside };
    document.page(|m| body(m, report, runs, &pictures))
}

type Pictures<'a> = BTreeMap<(usize, usize), &'a str>;

fn body(m: &mut Markup, report: &Report, runs: &[Results], pictures: &Pictures) {
    overview::header(m, report);
    markup::sections(m, &parts(report), |m, id| match id {
        "headline" => overview::headline(m, report),
        "losses" => overview::losses(m, report),
        "categories" => overview::categories(m, report),
        "comparisons" => differences::comparisons(m, report),
        "bias" => differences::bias(m, report),
        "worst" => worst::section(m, report, runs, pictures),
        "scenarios" => scenarios::section(m, report),
        "unfinished" => worst::unfinished(m, report),
        _ => method::section(m, report),
    });
}

/// The sections that this report has, by anchor and title.
fn parts(report: &Report) -> Vec<(&'static str, &'static str)> {
    let mut parts = vec![("headline", "Driving score")];
    let mut add = |wanted: bool, id, title| {
        if wanted {
            parts.push((id, title));
        }
    };
    let terms = report.headline.groups.iter().any(|group| group.metrics.len() > 3 || group.lost.is_some());
    add(terms, "losses", "Where points are lost");
    add(report.categories.is_some(), "categories", "By category");
    add(!report.comparisons.is_empty(), "comparisons", "Comparison");
    add(report.bias.is_some(), "bias", "Scorer and proposals");
    add(true, "worst", "Worst drives");
    add(true, "scenarios", "Scenarios");
    add(!report.unfinished.is_empty(), "unfinished", "Failed and aborted");
    add(true, "method", "How to read this");
    parts
}

/// What tells a group apart, in words: its key without empty values; `all drives` if nothing does.
fn group_name(key: &[String]) -> String {
    let parts: Vec<&str> = key.iter().map(String::as_str).filter(|part| !part.is_empty()).collect();
    if parts.is_empty() { "all drives".to_owned() } else { parts.join(" · ") }
}

/// Numbers the values of a dimension, so that rows of one kind share a colour.
fn colour_of(by: &[Dimension], key: &[String], groups: &[crate::aggregate::Group]) -> usize {
    let Some(place) = by.iter().position(|dimension| *dimension == Dimension::Policy) else { return 0 };
    let values: std::collections::BTreeSet<&String> = groups.iter().map(|group| &group.key[place]).collect();
    values.iter().position(|value| **value == key[place]).unwrap_or_default()
}
