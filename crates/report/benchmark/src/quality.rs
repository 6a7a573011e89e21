//! What the search of a set's adversaries came to: figures beside its manifest, each with the bar that it is held against.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::file::{self, FileError};
use crate::manifest::Manifest;

/// How file names end.
const SUFFIX: &str = ".quality.json";

/// Figures of a set's adversaries.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Quality {
    /// The set.
    pub set: String,
    /// The digest of its manifest.
    pub digest: String,
    /// The figures, in the order of the table.
    pub figures: Vec<Figure>,
    /// How hard each entry is, by its name.
    pub variants: BTreeMap<String, Severity>,
}

/// How hard a variant is, measured along the logged drive.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Severity {
    /// Speed of approach at the contact, in metres per second.
    pub closing_mps: f64,
    /// Change of velocity of equal masses that stay together, in metres per second.
    pub delta_v_mps: f64,
    /// Deceleration that the threat asks for, in metres per second squared.
    pub required_mps2: f64,
    /// Least time to collision before the contact, in seconds; none beyond 4 s.
    pub least_ttc_secs: Option<f64>,
    /// Time from the threat to the last tick from which an expert still finds a drive, in seconds; none without a solution.
    pub margin_secs: Option<f64>,
    /// Time between the expert and the adversary at a place where both come, at the least, in seconds; none without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub post_encroachment_secs: Option<f64>,
    /// Whether the adversary crosses a red light.
    pub red_light: bool,
    /// How far it drives against the traffic, in metres.
    pub wrong_way_m: f64,
}

/// A figure with its bar.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Figure {
    /// What it is, with its unit; shares are 0 to 1.
    pub what: String,
    /// The figure; nothing where there was nothing to measure.
    pub value: Option<f64>,
    /// Its 95 % interval, where it has one.
    pub interval: Option<[f64; 2]>,
    /// The least that the bar allows.
    pub least: Option<f64>,
    /// The most that the bar allows.
    pub most: Option<f64>,
}

impl Figure {
    /// Says whether the bar is met; nothing without a figure.
    #[must_use]
    pub fn met(&self) -> Option<bool> {
        let value = self.value?;
        Some(self.least.is_none_or(|least| value >= least) && self.most.is_none_or(|most| value <= most))
    }
}

impl Quality {
    /// Returns where the figures of a set lie whose manifest is in `folder`.
    #[must_use]
    pub fn path(folder: &Path, set: &str) -> PathBuf {
        folder.join(format!("{set}{SUFFIX}"))
    }

    /// Reads the figures of a set whose manifest lies in `folder`; nothing where there are none.
    ///
    /// # Errors
    /// [`FileError`] if the file is damaged or of another manifest.
    pub fn beside(folder: &Path, set: &Manifest) -> Result<Option<Self>, FileError> {
        let path = Self::path(folder, &set.name);
        if !path.exists() {
            return Ok(None);
        }
        let quality: Self = file::read_json(&path)?;
        if quality.digest != set.digest {
            let rule = "not the digest of the manifest beside it: the figures are of another set";
            return Err(FileError::Value { field: "digest".to_owned(), value: quality.digest, rule, path });
        }
        Ok(Some(quality))
    }

    /// Writes the figures beside the manifest in `folder`.
    ///
    /// # Errors
    /// [`FileError`] if it cannot be written.
    pub fn save(&self, folder: &Path) -> Result<(), FileError> {
        file::write_json(self, &Self::path(folder, &self.set))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_have_two_ends_and_figures_belong_to_a_manifest() {
        let figure = |value, least, most| Figure { value, least, most, ..Figure::default() };
        for (figure, met) in [
            (figure(Some(0.5), Some(0.5), None), Some(true)),
            (figure(Some(0.4), Some(0.5), None), Some(false)),
            (figure(Some(0.96), Some(0.5), Some(0.95)), Some(false)),
            (figure(None, Some(0.5), None), None),
        ] {
            assert_eq!(figure.met(), met, "{figure:?}");
        }
        let folder = tempfile::tempdir().expect("a temporary folder");
        let set = crate::manifest::tests::set(&["a"]);
        assert_eq!(Quality::beside(folder.path(), &set).expect("nothing there"), None);
        let figures = vec![figure(Some(0.5), None, None)];
        let variants = [("a".to_owned(), Severity::default())].into();
        let quality = Quality { set: set.name.clone(), digest: set.digest.clone(), figures, variants };
        quality.save(folder.path()).expect("written");
        assert_eq!(Quality::beside(folder.path(), &set).expect("sound").as_ref(), Some(&quality));
        let error =
            Quality::beside(folder.path(), &Manifest { digest: "other".to_owned(), ..set }).expect_err("another");
        assert!(error.to_string().contains("digest"), "{error}");
    }
}
