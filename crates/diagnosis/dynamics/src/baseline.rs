//! What healthy drives of a vehicle say about its nominal simulator: how parameters scatter, what no parameter mends, how
//! noisy the residuals are, and what each statistic reaches without any effect. A diagnosis against a baseline asks what
//! differs from those drives, not from the library's passenger car.
//!
//! Learned by [`crate::healthy::learn`]; a case that carries one is diagnosed with its priors, floors and nulls. Equations:
//! `docs/gap-baseline.md`.

pub mod correlation;
pub(crate) mod discrepancy;
pub(crate) mod features;
pub mod nulls;
pub mod sampling;
mod sound;
pub(crate) mod spread;
pub(crate) mod study;
pub mod windows;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use ds_diagnosis::meta::{Nominal, VehicleMeta};
use ds_diagnosis::{CaseError, json};
use ds_effect::{Channel, Nuisance};
use serde::{Deserialize, Serialize};

use crate::drive::Drive;
use crate::motion::StandIn;
use crate::settings::Thresholds;
use crate::space::Space;
use crate::windows::{Anchor, EgoRecord};
use correlation::Correlation;
use discrepancy::Discrepancy;
pub use features::NAMES;
use nulls::Null;
use sampling::Sampling;
use windows::Windows;

/// Version of the file.
pub const SCHEMA: u32 = 1;
/// Chance of a healthy log to be given an effect, and of one to be called unknown.
pub const ALARM: f64 = 0.02;

/// How far beyond what healthy drives had a feature is far from it, and the same as a share of their range.
const STRANGE: f64 = 0.1;
/// See [`STRANGE`].
const STRANGE_SHARE: f64 = 0.25;

/// Usual value and spread of every parameter by effect, in search units.
pub type Spread = BTreeMap<String, Vec<Option<Usual>>>;

/// A baseline, as written to a file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Baseline {
    /// Version of this schema.
    pub schema_version: u32,
    /// Digests of the nominal simulators of the healthy cases.
    pub nominal_hash: Vec<String>,
    /// Channels that were recorded.
    pub channels: Vec<String>,
    /// The kind of simulator that was the nominal one; absent for the built-in car.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub simulator: Option<String>,
    /// Wheelbase of the nominal simulator, m; absent in files of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wheelbase_m: Option<f64>,
    /// Lightest and heaviest of the nominal simulators, kg; absent in files of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mass_kg: Option<[f64; 2]>,
    /// Samples per second of the residuals.
    pub rate_hz: f64,
    /// What was learned from.
    pub units: Units,
    /// Factor on the library's floor by channel and block.
    pub noise: BTreeMap<String, Vec<f64>>,
    /// How the residuals of a window go together; absent in files of earlier versions.
    #[serde(default)]
    pub correlation: Correlation,
    /// How parameters scatter.
    pub spread: Spread,
    /// Jitter and repeats of their samples; those of any receiver in files of earlier versions.
    #[serde(default)]
    pub sampling: Sampling,
    /// Residuals that no parameter mends.
    pub discrepancy: Discrepancy,
    /// What healthy logs reach of each statistic.
    pub nulls: Vec<Null>,
    /// What they leave by channel and regime, see [`crate::cells`]; absent in files of earlier versions.
    #[serde(default)]
    pub cells: Vec<Null>,
    /// What healthy logs leave in single windows, for a watch; absent in files of earlier versions and of one log.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub windows: Option<Windows>,
    /// Log evidence from which an effect of a part of the loop is told from a healthy log, and from which size on.
    pub detection_limits: BTreeMap<String, f64>,
    /// First and last hundredth of each feature.
    pub domain: BTreeMap<String, [f64; 2]>,
    /// How far each unit moves the rest.
    pub influence: Vec<Influence>,
    /// What can be told with so few logs, and what cannot.
    pub warnings: Vec<String>,
}

/// The names of what a baseline was learned from; a unit is a log, or a drive where there are fewer than three logs.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Units {
    /// Vehicles.
    pub vehicle: Vec<String>,
    /// Days.
    pub day: Vec<String>,
    /// Logs or drives.
    pub drive: Vec<String>,
    /// Digests of the drives themselves; absent in files of earlier versions.
    #[serde(default)]
    pub digest: Vec<String>,
}

/// A usual value and its spread.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Usual {
    /// Mean.
    pub mean: f64,
    /// Standard deviation from log to log.
    pub sd: f64,
}

/// What one unit does to the baseline.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Influence {
    /// Its name.
    pub unit: String,
    /// Chance of a healthy log to lie as far from the others as this one.
    pub chance: f64,
    /// The parameter that it moves most, and by how many of the library's standard deviations.
    pub moves: Option<(String, f64)>,
}

impl Baseline {
    /// Reads a baseline.
    ///
    /// # Errors
    /// If the file cannot be read, is no baseline or one of another version, or lacks a part or has one that no healthy logs leave.
    pub fn read(path: &Path) -> Result<Self, CaseError> {
        let found: Self = json::read(path)?;
        let refuse = |why: String| Err(CaseError::Baseline { why, path: path.to_path_buf() });
        if found.schema_version != SCHEMA {
            return refuse(format!("schema_version is {}, this version reads {SCHEMA}", found.schema_version));
        }
        sound::unsound(&found).map_or(Ok(found), refuse)
    }

    /// Writes the baseline.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), CaseError> {
        json::write(self, path)
    }

    /// Checks that the baseline is one for a case.
    ///
    /// # Errors
    /// If the case has another nominal simulator than the only one that was learned from, a channel that no healthy
    /// drive had, or another simulator in the place of the built-in car.
    pub fn check(&self, meta: &VehicleMeta, drives: &[Drive], stand_in: Option<&StandIn>) -> Result<(), CaseError> {
        let own = digest(&meta.nominal);
        let refuse = |why: String| Err(CaseError::OtherBaseline { why, case: meta.case.clone() });
        if let ([one], false) = (self.nominal_hash.as_slice(), self.nominal_hash.contains(&own)) {
            return refuse(format!("its nominal simulator is {own:?}, the baseline's is {one:?}"));
        }
        let (driven, learned) = (stand_in.map(|stand_in| stand_in.kind.as_str()), self.simulator.as_deref());
        if driven != learned {
            let named =
                |kind: Option<&str>| kind.map_or("the built-in car".to_owned(), |k| format!("a simulator of {k}"));
            return refuse(format!("its nominal one is {}, the baseline's is {}", named(driven), named(learned)));
        }
        let fresh = channels(drives).into_iter().find(|name| !self.channels.contains(name));
        fresh.map_or(Ok(()), |name| refuse(format!("no healthy drive had a channel {name:?}")))
    }

    /// Sets the usual values of a space to those of the healthy drives.
    pub(crate) fn settle(&self, space: &mut Space) {
        settle(space, &self.spread, |usual, _| usual.sd);
    }

    /// Returns the factor on the library's floor of a channel and block.
    pub(crate) fn factor(&self, channel: Channel, block: usize) -> f64 {
        self.noise.get(channel.name()).and_then(|table| table.get(block).copied()).unwrap_or(1.0)
    }

    /// Returns, for every channel and block of a window, the residual that healthy drives have there and the factor on the
    /// library's floor.
    pub(crate) fn expected(&self, record: &EgoRecord, anchor: &Anchor) -> Vec<(f64, f64)> {
        let features = features::blocks(record, anchor);
        let widening: Vec<f64> = features.iter().map(|f| self.discrepancy.widening(f)).collect();
        let of = |channel: usize| {
            let name = Channel::ALL[channel];
            let each = features.iter().zip(&widening).enumerate();
            each.map(move |(block, (f, w))| (self.discrepancy.at(channel, f), w * self.factor(name, block)))
        };
        (0..crate::windows::EGO).flat_map(of).collect()
    }

    /// Returns the thresholds for a part of the loop: what healthy logs reach by chance raises them.
    #[must_use]
    pub fn thresholds(&self, part: usize, library: &Thresholds) -> Thresholds {
        let asked = nulls::gain_at(&self.nulls, part, ALARM).unwrap_or(0.0).max(library.single_gain);
        let scale = asked / library.single_gain;
        Thresholds {
            single_gain: asked,
            temperature: library.temperature * scale,
            further_gain: library.further_gain * scale,
        }
    }

    /// Tells whether the car does something in a window that is far from all that healthy drives had.
    #[must_use]
    pub(crate) fn is_strange(&self, record: &EgoRecord, anchor: &Anchor) -> bool {
        let far = |name: &str, value: f64| {
            self.domain.get(name).is_some_and(|[low, high]| {
                let margin = STRANGE + STRANGE_SHARE * (high - low);
                value < low - margin || value > high + margin
            })
        };
        features::blocks(record, anchor)
            .iter()
            .any(|block| NAMES.iter().zip(block).any(|(name, value)| far(name, *value)))
    }

    /// Returns the share of the windows in which the car does something far from all that healthy drives had; nothing where
    /// there is no window.
    #[must_use]
    pub fn outside_share(&self, records: &[EgoRecord]) -> Option<f64> {
        let windows = records.iter().flat_map(|record| record.anchors.iter().map(move |anchor| (record, anchor)));
        let strange: Vec<bool> = windows.map(|(record, anchor)| self.is_strange(record, anchor)).collect();
        let outside = strange.iter().filter(|strange| **strange).count();
        (!strange.is_empty()).then(|| outside as f64 / strange.len() as f64)
    }
}

/// Returns what is usual of a coordinate of a space.
fn usual(spread: &Spread, space: &Space, k: usize) -> Option<Usual> {
    let effect = space.coordinates[k].effect;
    let place = k - space.of(effect)[0];
    spread.get(space.effects[effect].id)?.get(place).copied().flatten()
}

/// Moves the usual values of a space to those found, and its ranges with them, with the library's spread where it has one.
pub(crate) fn centre(space: &mut Space, spread: &Spread) {
    settle(space, spread, |usual, library| library.map_or(usual.sd, |library| library.sd));
}

/// Moves usual values and ranges of a space to those found, with the spread that is made of what was found and the library's.
fn settle(space: &mut Space, spread: &Spread, sd: impl Fn(Usual, Option<Nuisance>) -> f64) {
    for k in 0..space.coordinates.len() {
        let Some(usual) = usual(spread, space, k) else { continue };
        let coordinate = &mut space.coordinates[k];
        coordinate.settle(Nuisance { mean: usual.mean, sd: sd(usual, coordinate.nuisance) });
    }
}

/// Returns a short digest of a nominal simulator.
pub(crate) fn digest(nominal: &Nominal) -> String {
    let text = serde_json::to_string(nominal).unwrap_or_default();
    blake3::hash(text.as_bytes()).to_hex()[..16].to_owned()
}

/// Returns a short digest of what a drive holds.
pub(crate) fn digest_of(drive: &Drive) -> String {
    let mut hasher = blake3::Hasher::new();
    for (name, column) in drive.columns() {
        hasher.update(name.as_bytes());
        column.iter().for_each(|value| {
            hasher.update(&value.to_le_bytes());
        });
    }
    hasher.finalize().to_hex()[..16].to_owned()
}

/// Returns the channels that some drives have.
pub(crate) fn channels(drives: &[Drive]) -> Vec<String> {
    let columns: BTreeSet<&str> = drives.iter().flat_map(|drive| drive.columns()).map(|(name, _)| name).collect();
    let followers = drives.iter().any(|drive| !drive.followers.is_empty());
    columns.into_iter().map(str::to_owned).chain(followers.then(|| "agents".to_owned())).collect()
}
