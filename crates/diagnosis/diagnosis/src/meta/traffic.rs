//! The description of a case of recorded traffic.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::error::CaseError;
use crate::json;
use crate::meta::{FILE, name_of};

/// What `model` says of such a case.
pub const TRAFFIC: &str = "traffic";

/// A case of recorded traffic.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct TrafficMeta {
    /// Name of the case.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub case: String,
    /// [`TRAFFIC`].
    pub model: String,
    /// Its recordings.
    pub recordings: Vec<RecordingEntry>,
    /// The nominal simulator of the agents.
    pub nominal: Drivers,
    /// Which recordings to keep from the fit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub suggested_split: Option<HeldOut>,
}

/// A recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordingEntry {
    /// The scene, relative to the case.
    pub scene: PathBuf,
    /// The tracks as a table, relative to the case; those logged in the scene without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tracks: Option<PathBuf>,
    /// From when on the agents react to the ego, s.
    #[serde(default)]
    pub from_secs: f64,
}

/// How the agents of a nominal simulator drive; what is absent is the simulator's own.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Drivers {
    /// Time gap, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub headway: Option<f64>,
    /// Gap at standstill, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub min_gap: Option<f64>,
    /// m/s².
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_accel: Option<f64>,
    /// m/s².
    #[serde(skip_serializing_if = "Option::is_none")]
    pub comfort_decel: Option<f64>,
    /// m/s; that of the lane without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub desired_speed: Option<f64>,
    /// Whether they change lanes, yield and walk by themselves.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub interactive: Option<bool>,
}

/// Recordings kept back.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct HeldOut {
    /// Their indices.
    pub held_out: Vec<usize>,
}

impl Default for TrafficMeta {
    fn default() -> Self {
        Self {
            case: String::new(),
            model: TRAFFIC.to_owned(),
            recordings: Vec::new(),
            nominal: Drivers::default(),
            suggested_split: None,
        }
    }
}

impl TrafficMeta {
    /// Reads `meta.json` of a case folder; a case without a name gets that of its folder.
    ///
    /// # Errors
    /// If the file is absent or is not such a description; the error names the key.
    pub fn read(case: &Path) -> Result<Self, CaseError> {
        let mut meta: Self = json::read(&case.join(FILE))?;
        if meta.case.is_empty() {
            meta.case = name_of(case);
        }
        Ok(meta)
    }

    /// Writes `meta.json` into a case folder.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write(&self, case: &Path) -> Result<(), CaseError> {
        json::write(self, &case.join(FILE))
    }
}
