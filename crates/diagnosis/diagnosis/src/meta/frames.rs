//! The description of a case of two paired streams of frames.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::error::CaseError;
use crate::json;
use crate::meta::{FILE, name_of};

/// A case of two streams of frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FrameMeta {
    /// Name of the case.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub case: String,
    /// Columns, px.
    pub width: usize,
    /// Rows, px.
    pub height: usize,
    /// `rgb` or `grey`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub channels: Option<String>,
    /// Frames per second.
    pub frame_rate_hz: f64,
    /// Whether frames follow each other in a fixed step.
    #[serde(default = "yes")]
    pub contiguous: bool,
    /// The camera.
    pub intrinsics: PinholeEntry,
    /// Rows of the whole sensor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensor_rows: Option<f64>,
    /// Frames at which the video model starts anew.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub rollout_anchor_frames: Vec<u64>,
    /// Which frames to fit and which to keep.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub suggested_split: Option<FrameSplit>,
    /// How the frames of the two streams belong together.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pairing: Option<Pairing>,
    /// Folder of effect-free pairs of the same generator, relative to the case.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nuisance: Option<PathBuf>,
    /// Height of the camera over the road, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera_height_m: Option<f64>,
    /// Folders of the simulated streams, relative to the case: several draws of a generator for the same states; `sim`
    /// alone where the list is empty.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub seeds: Vec<PathBuf>,
    /// Folders of its clips, relative to the case, each a case of its own; the case itself then has no pictures.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub clips: Vec<PathBuf>,
}

/// A pinhole, px.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PinholeEntry {
    /// Focal length across.
    pub fx: f64,
    /// Focal length down.
    pub fy: f64,
    /// Column of the axis.
    pub cx: f64,
    /// Row of the axis.
    pub cy: f64,
}

/// First and last frames for the fit and kept back.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FrameSplit {
    /// Frames to fit; all others without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fit: Option<[u64; 2]>,
    /// Frames kept back.
    pub held_out: [u64; 2],
}

/// How the frames of two streams belong together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Pairing {
    /// The same pixels but for the effect.
    Aligned,
    /// The same states, other texture.
    SameLayout,
    /// Other states of the same kind of road.
    Unpaired,
}

impl Pairing {
    /// Its name in `meta.json`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Aligned => "aligned",
            Self::SameLayout => "same-layout",
            Self::Unpaired => "unpaired",
        }
    }
}

const fn yes() -> bool {
    true
}

impl FrameMeta {
    /// Describes a case by its pictures and their camera alone.
    #[must_use]
    pub fn new([width, height]: [usize; 2], frame_rate_hz: f64, intrinsics: PinholeEntry) -> Self {
        Self {
            case: String::new(),
            width,
            height,
            channels: None,
            frame_rate_hz,
            contiguous: true,
            intrinsics,
            sensor_rows: None,
            rollout_anchor_frames: Vec::new(),
            suggested_split: None,
            pairing: None,
            nuisance: None,
            camera_height_m: None,
            seeds: Vec::new(),
            clips: Vec::new(),
        }
    }

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
