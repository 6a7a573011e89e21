//! A running diagnosis in the viewer: the verdict as text, probability and estimate of every effect as curves over
//! simulation time, where the gap lies and how far the drive is from a reference stream.
//!
//! An effect gets curves from the first window on in which it is worth a look, and keeps them.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use ds_effect::Verdict;
use ds_topic::{DiagnosedEffect, Diagnosis, GapCell};
use rerun::{MediaType, RecordingStream, Scalars, TextDocument, TextLog};

use crate::error::RecordError;

/// Where all of it lies.
pub(crate) const ROOT: &str = "diagnosis";
/// An effect is worth a look from this probability on.
const WORTH: f64 = 0.02;
/// Cells that are listed.
const LISTED: usize = 24;

/// Logs the diagnoses of one episode.
#[derive(Debug, Default)]
pub(crate) struct Findings {
    shown: BTreeSet<String>,
}

impl Findings {
    /// Logs a diagnosis at the time that the stream is set to.
    pub(crate) fn log(&mut self, diagnosis: &Diagnosis, stream: &RecordingStream) -> Result<(), RecordError> {
        let level = if diagnosis.verdict == Verdict::None { "INFO" } else { "WARN" };
        stream.log(format!("{ROOT}/verdict"), &TextLog::new(sentence(diagnosis)).with_level(level))?;
        let scalar = |path: &str, value: f64| stream.log(format!("{ROOT}/{path}"), &Scalars::new([value]));
        scalar("none/probability", diagnosis.p_none)?;
        scalar("unknown/probability", diagnosis.p_unknown)?;
        for effect in &diagnosis.effects {
            if effect.chosen || effect.probability >= WORTH {
                self.shown.insert(effect.id.clone());
            }
            if self.shown.contains(&effect.id) {
                scalar(&format!("effects/{}/probability", effect.id), effect.probability)?;
                if let Some(value) = effect.value {
                    scalar(&format!("effects/{}/value", effect.id), value)?;
                }
            }
        }
        for (channel, rms) in &diagnosis.differences {
            scalar(&format!("differences/{channel}"), *rms)?;
        }
        stream.log(format!("{ROOT}/where"), &document(&cells(&diagnosis.cells)))?;
        Ok(())
    }
}

/// Returns a text as a document that the viewer lays out.
pub(crate) fn document(markdown: &str) -> TextDocument {
    TextDocument::new(markdown).with_media_type(MediaType::markdown())
}

/// Returns the paths of the curves that show how likely some effects are.
pub(crate) fn probabilities(effects: &[String]) -> Vec<String> {
    let of_effect = |id: &String| format!("/{ROOT}/effects/{id}/probability");
    let others = ["none", "unknown"].map(|what| format!("/{ROOT}/{what}/probability"));
    others.into_iter().chain(effects.iter().map(of_effect)).collect()
}

/// Returns an estimate with its unit and its interval.
pub(crate) fn estimate(effect: &DiagnosedEffect) -> String {
    let Some(value) = effect.value else { return String::new() };
    let unit = if ["", "1", "x"].contains(&effect.unit.as_str()) { String::new() } else { format!(" {}", effect.unit) };
    match effect.interval90 {
        [Some(low), Some(high)] => format!("{value:.4}{unit} [{low:.4}, {high:.4}]"),
        _ => format!("{value:.4}{unit}"),
    }
}

fn sentence(diagnosis: &Diagnosis) -> String {
    let (from, to) = (diagnosis.window.0.secs(), diagnosis.window.1.secs());
    let mut text = format!("{from:.1} to {to:.1} s: {}", diagnosis.verdict.words());
    for (place, effect) in diagnosis.chosen().enumerate() {
        let before = if place == 0 { ": " } else { ", " };
        let _infallible = write!(text, "{before}{} {}", effect.id, estimate(effect));
    }
    let _infallible = write!(text, " (none {:.2}, unknown {:.2})", diagnosis.p_none, diagnosis.p_unknown);
    if !diagnosis.reference.is_empty() {
        let _infallible = write!(text, ", by the log of {}", diagnosis.reference);
    }
    text
}

/// Returns the cells as a table.
pub(crate) fn cells(cells: &[GapCell]) -> String {
    if cells.is_empty() {
        return "No cell of the data is beyond its noise floor.".to_owned();
    }
    let mut text = String::from("| channel | where | times the floor | q |\n|---|---|---|---|\n");
    for cell in cells.iter().take(LISTED) {
        let bins: Vec<String> = cell.bins.iter().map(|(axis, bin)| format!("{axis} {bin}")).collect();
        let bins = if bins.is_empty() { "everywhere".to_owned() } else { bins.join(", ") };
        let _infallible =
            writeln!(text, "| {} | {bins} | {:.1} | {:.3} |", cell.channel, cell.effect_size, cell.q_value);
    }
    if cells.len() > LISTED {
        let _infallible = writeln!(text, "\nand {} more", cells.len() - LISTED);
    }
    text
}
