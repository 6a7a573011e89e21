//! A running diagnosis in the viewer: the verdict as text, probability and estimate of every effect as curves over
//! simulation time, where the gap lies and how far the drive is from a reference stream.
//!
//! An effect gets curves from the first window on in which it is worth a look, and keeps them.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use ds_effect::Verdict;
use ds_record::viewing::{cells, estimate};
use ds_topic::Diagnosis;
use rerun::{MediaType, RecordingStream, Scalars, TextDocument, TextLog};

use crate::ViewError;

/// Where all of it lies.
pub(crate) const ROOT: &str = "diagnosis";
/// An effect is worth a look from this probability on.
const WORTH: f64 = 0.02;

/// Logs the diagnoses of one episode.
#[derive(Debug, Default)]
pub(crate) struct Findings {
    shown: BTreeSet<String>,
}

impl Findings {
    /// Logs a diagnosis at the time that the stream is set to.
    pub(crate) fn log(&mut self, diagnosis: &Diagnosis, stream: &RecordingStream) -> Result<(), ViewError> {
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
