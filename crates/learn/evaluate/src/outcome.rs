//! The figures of an evaluation, as they are stored and reported. Maps are in the order of their keys.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use crate::estimate::Estimate;

/// Everything that was measured.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Outcome {
    /// Whether it was a quick look with few scenarios.
    pub quick: bool,
    /// The arms that were loaded.
    pub arms: BTreeMap<String, ArmNote>,
    /// Digest of the perception networks.
    pub perception: String,
    /// Whether frames are as sharp as the world's own.
    #[serde(default)]
    pub sharpness: Option<SharpnessOutcome>,
    /// Layout, fidelity, colour and seam figures.
    pub layout: Option<LayoutOutcome>,
    /// The drift curve.
    pub drift: Option<DriftOutcome>,
    /// Whether a look is kept.
    pub appearance: Option<AppearanceOutcome>,
    /// First frames from layout and words.
    #[serde(default)]
    pub first_frames: Option<FirstFramesOutcome>,
    /// Speed.
    pub speed: Option<SpeedOutcome>,
    /// Side-by-side videos, by file name.
    pub videos: Vec<String>,
}

impl Outcome {
    /// Lists the columns of all parts, A first.
    pub(crate) fn columns(&self) -> Vec<String> {
        let mut names = BTreeSet::new();
        names.extend(self.sharpness.iter().flat_map(|part| part.columns.keys().cloned()));
        names.extend(self.layout.iter().flat_map(|part| part.columns.keys().cloned()));
        names.extend(self.drift.iter().flat_map(|part| part.columns.keys().cloned()));
        names.extend(self.appearance.iter().flat_map(|part| part.columns.keys().cloned()));
        names.into_iter().collect()
    }
}

/// What an arm is.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ArmNote {
    /// How its frames are made.
    pub kind: String,
    /// Digest of preset, weights and way of making frames.
    pub digest: String,
    /// What the configuration remarks on it.
    pub remark: String,
}

/// Whether frames are as sharp as the world's own.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct SharpnessOutcome {
    /// Arm per key of `sharpness`.
    pub arms: BTreeMap<String, String>,
    /// The first and the last frame of looks, and their stride.
    pub frames: (u32, u32, u32),
    /// By column, by arm.
    pub columns: BTreeMap<String, BTreeMap<String, Sharpness>>,
    /// By column, the share of the distance beside the road that goes once layouts show structures: student against `bare`.
    #[serde(default)]
    pub structures_gain: BTreeMap<String, Estimate>,
}

/// How sharp the frames of an arm are.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Sharpness {
    /// Peak signal-to-noise ratio against the world's own frames, in decibels.
    pub psnr_db: Option<Estimate>,
    /// Mean absolute Laplacian over that of the world's own frames.
    pub laplacian_ratio: Option<Estimate>,
    /// Mean step at borders of 8×8 blocks over that inside.
    pub border_ratio: Option<Estimate>,
    /// The same of the world's own frames.
    pub reference_border_ratio: Option<Estimate>,
    /// Difference of successive frames across borders of chunks over that inside; absent of what has no chunks.
    pub seam: Option<Estimate>,
    /// Perceptual distance from the world's own frames beside the road, around frame 50.
    #[serde(default)]
    pub off_road_distance: Option<Estimate>,
}

/// Layout, fidelity, colour and seam figures.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct LayoutOutcome {
    /// Arm per key of `layout_iou`.
    pub iou: BTreeMap<String, String>,
    /// Arm per key of `feature_distance`.
    pub feature_distance: BTreeMap<String, String>,
    /// First ticks of the clips, frames after the first, the first frame and the stride of looks.
    pub clips: (Vec<u32>, u32, u32, u32),
    /// Distance beyond which a traffic light is lower than two pixels, in metres.
    pub two_pixels_m: f64,
    /// Figures by column.
    pub columns: BTreeMap<String, ColumnLayout>,
}

/// Figures of a column.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ColumnLayout {
    /// Of the world's own frames: the most that an arm can reach.
    pub reference: ArmLayout,
    /// By arm.
    pub arms: BTreeMap<String, ArmLayout>,
    /// Comparisons of arms over the same scenarios.
    pub comparisons: BTreeMap<String, Option<Estimate>>,
}

/// Figures of an arm in a column.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ArmLayout {
    /// IoU by target.
    pub iou: BTreeMap<String, Option<Estimate>>,
    /// 1 − mean IoU of lane and vehicle.
    pub error: Option<Estimate>,
    /// Traffic lights by distance.
    pub lights: Vec<LightBin>,
    /// Peak signal-to-noise ratio against the world's own frames, in decibels.
    pub psnr_db: Option<Estimate>,
    /// Perceptual distance from them.
    pub distance: Option<Estimate>,
    /// Fréchet distance of features from them.
    pub frechet: Option<Estimate>,
    /// Mean colour statistics.
    pub colour: BTreeMap<String, Option<Estimate>>,
    /// Difference of successive frames across borders of chunks over that inside.
    pub seam: Option<Estimate>,
    /// Frames looked at.
    pub frames: u64,
}

/// Traffic lights within distances.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LightBin {
    /// From, in metres.
    pub from_m: f64,
    /// To, in metres.
    pub to_m: f64,
    /// Share whose state was read right.
    pub accuracy: Option<Estimate>,
    /// Lights seen.
    pub seen: u64,
}

/// The drift curve.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct DriftOutcome {
    /// Arm per key of `drift`.
    pub arms: BTreeMap<String, String>,
    /// Frames of a distance, ticks of the log per frame.
    pub window: u32,
    /// Ticks of the log per frame.
    pub pace: f64,
    /// By column, by arm.
    pub columns: BTreeMap<String, ColumnDrift>,
}

/// Drift in a column.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ColumnDrift {
    /// By arm.
    pub arms: BTreeMap<String, ArmDrift>,
    /// Rise of the clean arm minus that of the early-timestep arm.
    pub difference: Option<Estimate>,
    /// 1 − rise of the early-timestep arm over that of the clean arm.
    pub reduction: Option<Estimate>,
}

/// Drift of an arm.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ArmDrift {
    /// Marks with the distance there.
    pub curve: Vec<(u32, Option<Estimate>)>,
    /// Distance at the last mark minus that at 50 (or the first mark).
    pub rise: Option<Estimate>,
    /// By colour statistic: marks with the mean difference from the world's own frames.
    pub colour: BTreeMap<String, Vec<(u32, Option<Estimate>)>>,
    /// The long run.
    pub long: Option<LongOutcome>,
}

/// The long run of an arm.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct LongOutcome {
    /// Frames, and where the slope begins.
    pub frames: (u32, u32),
    /// Slope of the mean difference of each colour statistic from the world's own frames, per 100 frames.
    pub colour_slopes: BTreeMap<String, Option<Estimate>>,
    /// Slope of the mean distance of features from those of the world's own frames, per 100 frames.
    pub feature_slope: Option<Estimate>,
    /// Contrast of the last looks over that of the world's own frames: near 0 after a collapse.
    pub contrast_kept: Option<Estimate>,
}

/// Whether a look is kept.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct AppearanceOutcome {
    /// Arm per key of `appearance_at_100`.
    pub arms: BTreeMap<String, String>,
    /// The frame at whose end it is looked.
    pub at: u32,
    /// By column, by condition.
    pub columns: BTreeMap<String, BTreeMap<String, ConditionOutcome>>,
}

/// Whether one look is kept.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ConditionOutcome {
    /// Share of the world's own frames whose look is named right.
    pub reference: Option<Estimate>,
    /// The same by arm.
    pub arms: BTreeMap<String, Option<Estimate>>,
    /// With minus without.
    pub gain: Option<Estimate>,
    /// By arm, what the look network names in the frames, as shares that sum to one.
    #[serde(default)]
    pub named: BTreeMap<String, BTreeMap<String, f64>>,
}

/// The picture of first frames beside the page: a row for each condition.
pub(crate) const FIRST_FRAMES_SHEET: &str = "first-frames.png";

/// Whether first frames from layout and words show what the words say, in the world of training.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct FirstFramesOutcome {
    /// Share of all frames whose look is named right.
    pub recognised: Option<Estimate>,
    /// By condition.
    pub conditions: BTreeMap<String, WordedOutcome>,
}

/// The first frames of a condition.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct WordedOutcome {
    /// Made from layout and words.
    pub words: LookFigures,
    /// The world's own in that condition.
    pub own: LookFigures,
}

/// What frames of a condition show; beside the first figure all over those of ordinary daylight, made alike.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct LookFigures {
    /// Share whose look is named right.
    pub recognised: Option<Estimate>,
    /// Mean luma.
    pub luma: Option<Estimate>,
    /// Mean luma of the road.
    pub ground: Option<Estimate>,
    /// Deviation of luma.
    pub contrast: Option<Estimate>,
    /// High-frequency energy.
    pub detail: Option<Estimate>,
}

/// Speed.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct SpeedOutcome {
    /// The preset.
    pub preset: String,
    /// Frames a second, layout in and frame out, with its interval over chunks.
    pub frames_per_second: Option<Estimate>,
    /// Share of the measured peak of matrix products that the transformer attains.
    pub gemm_share: Option<Estimate>,
    /// What the transformer attains on all threads, in GFLOP/s.
    #[serde(default)]
    pub transformer_gflops: Option<Estimate>,
    /// What plain matrix products attain in the same rounds, in GFLOP/s.
    #[serde(default)]
    pub gemm_gflops: Option<Estimate>,
    /// Threads of the machine.
    pub threads: u64,
}
