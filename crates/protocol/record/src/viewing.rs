//! What the process `viewer` is handed on its standard input besides recordings: a finished diagnosis, a training; as JSON.
//!
//! Tables are texts in Markdown already, so that a running diagnosis and a finished one read alike. Moments with a value
//! that is not finite are left out.

use std::fmt::Write as _;
use std::path::PathBuf;

use ds_topic::{DiagnosedEffect, GapCell};
use serde::{Deserialize, Serialize};

/// Cells that are listed.
const LISTED: usize = 24;

/// A finished diagnosis, as it is drawn.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Explained {
    /// Name of the case.
    pub case: String,
    /// What was found, in words.
    pub summary: String,
    /// The effects considered as a table.
    pub ranking: String,
    /// Where the gap is as a table.
    pub places: String,
    /// Numbers by their path below the diagnosis.
    pub numbers: Vec<(String, f64)>,
    /// The gap along drives.
    pub drives: Vec<Along>,
}

/// The gap along one drive.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Along {
    /// Number of the drive in its case.
    pub drive: usize,
    /// Seconds, and position in m, in order.
    pub path: Vec<[f64; 3]>,
    /// The errors over time, the one that colours the road first.
    pub curves: Vec<Curve>,
}

/// One error over time.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Curve {
    /// Its name.
    pub name: String,
    /// Seconds, error of the nominal and of the corrected simulator, noise floor; in order.
    pub moments: Vec<[f64; 4]>,
}

/// A training, as it is drawn.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Training {
    /// Its name.
    pub name: String,
    /// Its stages in order.
    pub stages: Vec<TrainedStage>,
}

/// What is shown of one stage of a training.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct TrainedStage {
    /// Its name.
    pub name: String,
    /// Curves by name: steps and losses.
    pub curves: Vec<(String, Vec<(f64, f64)>)>,
    /// A contact sheet of samples, a PNG file.
    pub sheet: Option<PathBuf>,
}

impl Explained {
    /// Returns what is drawn of effects, likeliest first, and cells, largest first; drives are added by the caller.
    #[must_use]
    pub fn new(case: &str, summary: String, effects: &[DiagnosedEffect], found: &[GapCell]) -> Self {
        let mut numbers = Vec::new();
        for effect in effects {
            let [low, high] = effect.interval90;
            let known =
                [("probability", Some(effect.probability)), ("value", effect.value), ("low", low), ("high", high)];
            let finite = known.into_iter().filter_map(|(what, number)| Some((what, number.filter(|n| n.is_finite())?)));
            numbers.extend(finite.map(|(what, number)| (format!("effects/{}/{what}", effect.id), number)));
        }
        let (ranking, places) = (ranking(effects), cells(found));
        Self { case: case.to_owned(), summary, ranking, places, numbers, drives: Vec::new() }
    }
}

impl Curve {
    /// Returns the curve of those moments that are finite.
    #[must_use]
    pub fn new(name: String, moments: impl Iterator<Item = [f64; 4]>) -> Self {
        Self { name, moments: moments.filter(|moment| moment.iter().all(|value| value.is_finite())).collect() }
    }
}

/// Returns the effects as a table.
fn ranking(effects: &[DiagnosedEffect]) -> String {
    let mut text = String::from("| effect | probability | estimate, 90 % interval | |\n|---|---|---|---|\n");
    for effect in effects {
        let chosen = if effect.chosen { "in the corrected model" } else { "" };
        text += &format!("| {} | {:.3} | {} | {chosen} |\n", effect.id, effect.probability, estimate(effect));
    }
    text
}

/// Returns an estimate with its unit and its interval.
#[must_use]
pub fn estimate(effect: &DiagnosedEffect) -> String {
    let Some(value) = effect.value else { return String::new() };
    let unit = if ["", "1", "x"].contains(&effect.unit.as_str()) { String::new() } else { format!(" {}", effect.unit) };
    match effect.interval90 {
        [Some(low), Some(high)] => format!("{value:.4}{unit} [{low:.4}, {high:.4}]"),
        _ => format!("{value:.4}{unit}"),
    }
}

/// Returns the cells as a table.
#[must_use]
pub fn cells(cells: &[GapCell]) -> String {
    if cells.is_empty() {
        return "No cell of the data is beyond its noise floor.".to_owned();
    }
    let mut text = String::from("| channel | where | times the floor | q |\n|---|---|---|---|\n");
    for cell in cells.iter().take(LISTED) {
        let bins: Vec<String> = cell.bins.iter().map(|(axis, bin)| format!("{axis} {bin}")).collect();
        let bins = if bins.is_empty() { "everywhere".to_owned() } else { bins.join(", ") };
        let q = cell.q_value.map_or_else(|| "–".to_owned(), |q| format!("{q:.3}"));
        let _infallible = writeln!(text, "| {} | {bins} | {:.1} | {q} |", cell.channel, cell.effect_size);
    }
    if cells.len() > LISTED {
        let _infallible = writeln!(text, "\nand {} more", cells.len() - LISTED);
    }
    text
}
