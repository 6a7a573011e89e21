//! The configuration of an evaluation: arms with their weights, which arms stand in which table, how much is rolled out.
//!
//! Paths are relative to the configuration file. A table names an arm per key of `eval.json`; a key without an arm is
//! reported as not measured.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use ds_camera::Condition;
use serde::{Deserialize, Serialize};

use crate::error::EvaluationError;

/// An evaluation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EvalConfig {
    /// Schema version, 1.
    pub version: u32,
    /// Where results go, relative to the current folder.
    pub out: PathBuf,
    /// The networks that look at frames.
    pub perception: PerceptionFiles,
    /// The weights to look at, by name.
    pub arms: BTreeMap<String, ArmConfig>,
    /// Which scenarios and looks.
    pub columns: ColumnsConfig,
    /// Resamples of an interval.
    #[serde(default = "default_resamples")]
    pub resamples: u64,
    /// Whether frames are as sharp as the world's own.
    #[serde(default)]
    pub sharpness: Option<SharpnessConfig>,
    /// Layout, fidelity, colour and seam figures.
    #[serde(default)]
    pub layout: Option<LayoutConfig>,
    /// The drift curve.
    #[serde(default)]
    pub drift: Option<DriftConfig>,
    /// Whether a look is kept.
    #[serde(default)]
    pub appearance: Option<AppearanceConfig>,
    /// First frames from layout and words.
    #[serde(default)]
    pub first_frames: Option<FirstFramesConfig>,
    /// Speed; the arm whose frames are timed.
    #[serde(default)]
    pub speed: Option<SpeedConfig>,
    /// Side-by-side videos.
    #[serde(default)]
    pub videos: Option<VideosConfig>,
    /// Where this file lies.
    #[serde(skip)]
    pub base: PathBuf,
}

/// Weights of the perception networks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PerceptionFiles {
    /// Names pixels.
    pub segmenter: PathBuf,
    /// Reads traffic lights.
    pub lights: PathBuf,
    /// Says what a frame looks like.
    pub look: PathBuf,
}

/// How frames are made of weights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ArmKind {
    /// Rolled out chunk by chunk with the cache.
    Student,
    /// The same with the layout dropped from the start.
    NoLayout,
    /// Each frame anew, without cache and decoder memory.
    PerFrame,
    /// Sampled over a window of latents at once with guidance.
    Teacher,
    /// The same without layouts: the first frame and the prompt alone.
    Prior,
    /// The world's own frames, encoded and decoded again beside their layouts: the most that the others can reach.
    Autoencoder,
}

impl ArmKind {
    /// Tells whether latents are sampled by windows, not chunk by chunk.
    pub(crate) fn samples_windows(self) -> bool {
        matches!(self, Self::Teacher | Self::Prior)
    }
}

/// An arm.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArmConfig {
    /// How frames are made.
    pub kind: ArmKind,
    /// Model preset.
    pub model: PathBuf,
    /// Weights of the whole model.
    pub weights: PathBuf,
    /// Weights of another transformer in its place, such as a teacher's.
    #[serde(default)]
    pub dit: Option<PathBuf>,
    /// Another cache source than the preset's: `clean`, `renoise(σ)`, `state(j)` or `x0hat(j)`.
    #[serde(default)]
    pub cache_source: Option<String>,
    /// Guidance weight of a teacher; 1 means none.
    #[serde(default)]
    pub guidance: Option<f32>,
    /// Sampling steps of a teacher.
    #[serde(default)]
    pub steps: Option<usize>,
    /// Latents that a teacher samples at once, the given first one included, as in its training; a longer clip goes on
    /// from the last one.
    #[serde(default)]
    pub window: Option<usize>,
    /// What a teacher's guidance does without: `layout` (the default) or `all`, as in its training.
    #[serde(default)]
    pub dropout: Option<ds_train::guidance::Dropout>,
    /// Whether a teacher's guidance leaves mean and deviation of each latent channel as c∅ has them, as in the training of
    /// clips with an edited first frame; c∅ must keep the first frame.
    #[serde(default)]
    pub keep_look: bool,
    /// Whether its layouts leave out what stands beside the road.
    #[serde(default)]
    pub bare: bool,
    /// A remark for the report, such as what the arm stands in for.
    #[serde(default)]
    pub remark: String,
}

/// Which scenarios are rolled out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ColumnsConfig {
    /// Seed of the first eight generated scenarios, one per family; the next seed gives the next eight.
    pub first_seed: u64,
    /// Generated scenarios of each world for tables that name no number of rollouts.
    pub scenarios: u64,
    /// The look of generated scenarios: `daylight` (clear and overcast in turn), `drawn` (any condition), or the name of an
    /// appearance such as `day` or `snow`.
    pub look: String,
    /// How far the camera is turned to the left of the rig's own front camera, in degrees.
    #[serde(default)]
    pub turned_deg: f64,
    /// Scenario files, logs or folders of them for the column `real`; absent ones are skipped with a note.
    #[serde(default)]
    pub real: Vec<PathBuf>,
}

/// Whether frames are as sharp as the world's own: along whole drives, as a policy sees them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SharpnessConfig {
    /// Arm per key of `sharpness`: autoencoder, student, before; where structures are asked about, `bare`, which has never seen any, and `untold`.
    pub arms: BTreeMap<String, String>,
    /// Scenarios, one rollout each.
    pub rollouts: u64,
    /// The first frame that is looked at.
    pub first: u32,
    /// The last.
    pub last: u32,
    /// Every how many frames it is looked.
    pub every: u32,
}

/// Layout, fidelity, colour and seam figures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LayoutConfig {
    /// Arm per key of `layout_iou`: student, before, teacher, no_layout.
    pub iou: BTreeMap<String, String>,
    /// Arm per key of `feature_distance`: layout_guidance, standard_cfg, no_guidance.
    #[serde(default)]
    pub feature_distance: BTreeMap<String, String>,
    /// First ticks of the clips of each scenario.
    pub starts: Vec<u32>,
    /// Frames after the first; for a teacher a multiple of the latents' stride.
    pub frames: u32,
    /// The first frame that is looked at.
    pub first: u32,
    /// Every how many frames it is looked.
    pub every: u32,
}

/// The drift curve.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DriftConfig {
    /// Arm per key of `drift`: early_timestep, clean.
    pub arms: BTreeMap<String, String>,
    /// Generated scenarios, one rollout each.
    pub rollouts: u64,
    /// The frames at whose end the distance is taken.
    pub marks: Vec<u32>,
    /// Frames of a distance: k − window + 1 to k.
    pub window: u32,
    /// Ticks of the log per frame; below 1 a drive lasts longer.
    pub pace: f64,
    /// Directions that features are reduced to.
    pub directions: usize,
    /// Share of each covariance's off-diagonal that is removed.
    pub shrinkage: f64,
    /// The long run.
    #[serde(default)]
    pub long: Option<LongConfig>,
}

/// The long run: the slope of colour statistics and feature distance from `from` to `frames`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LongConfig {
    /// Rollouts.
    pub rollouts: u64,
    /// Frames.
    pub frames: u32,
    /// Where the slope begins.
    pub from: u32,
}

/// Whether a look is kept.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AppearanceConfig {
    /// Arm per key of `appearance_at_100`: with, without, before, teacher, prior.
    pub arms: BTreeMap<String, String>,
    /// Conditions, such as `snow`, `rain`, `night`, `fog`: one value of one axis each.
    pub conditions: Vec<String>,
    /// Generated scenarios, one rollout per condition each.
    pub rollouts: u64,
    /// The frame at whose end it is looked.
    pub at: u32,
    /// Frames that are looked at: at − window + 1 to at.
    pub window: u32,
    /// Ticks of the log per frame.
    pub pace: f64,
}

/// First frames from layout and words.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FirstFramesConfig {
    /// Model preset.
    pub model: PathBuf,
    /// Weights of a teacher with its autoencoder.
    pub weights: PathBuf,
    /// Euler steps.
    pub steps: usize,
    /// Guidance towards layout and words; 1 is none.
    pub guidance: f32,
    /// Generated scenarios, a frame of each for every wording.
    pub scenarios: u64,
    /// By condition, such as `snow`: ordinary words for it.
    pub wordings: BTreeMap<String, Vec<String>>,
}

/// What is timed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpeedConfig {
    /// Model preset.
    pub model: PathBuf,
    /// Weights; drawn ones without, for speed does not depend on them.
    #[serde(default)]
    pub weights: Option<PathBuf>,
    /// Frames that are timed, after as many to warm up as a window holds.
    pub frames: u32,
}

/// Side-by-side videos.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VideosConfig {
    /// Arms that stand beside the world's own frames and the layouts; a teacher is shown as long as its clip.
    pub arms: Vec<String>,
    /// Generated scenarios.
    pub scenarios: u64,
    /// Frames.
    pub frames: u32,
}

fn default_resamples() -> u64 {
    400
}

/// The key of the student among the arms of a part.
pub(crate) const STUDENT: &str = "student";
/// The targets of `layout_iou`.
pub(crate) const LAYOUT_TARGETS: [&str; 4] = ["lane", "crosswalk", "vehicle", "pedestrian"];
/// The keys of `sharpness`.
pub const SHARPNESS_ARMS: [&str; 5] = ["autoencoder", "student", "before", "bare", "untold"];
/// The keys of the tables of `eval.json`.
pub const LAYOUT_ARMS: [&str; 4] = ["student", "before", "teacher", "no_layout"];
/// The keys of `feature_distance`.
pub const GUIDANCE_ARMS: [&str; 3] = ["layout_guidance", "standard_cfg", "no_guidance"];
/// The keys of `drift`.
pub const DRIFT_ARMS: [&str; 2] = ["early_timestep", "clean"];
/// The keys of `appearance_at_100.{condition}`.
pub const DIVERSE_ARMS: [&str; 5] = ["with", "without", "before", "teacher", "prior"];

impl EvalConfig {
    /// Reads and checks a configuration.
    ///
    /// # Errors
    /// If the file cannot be read, a key is unknown or a value is out of bounds.
    pub fn load(path: &Path) -> Result<Self, EvaluationError> {
        let text =
            std::fs::read_to_string(path).map_err(EvaluationError::io("the evaluation's configuration", path))?;
        Self::parse(&text, path.parent().unwrap_or(Path::new(".")))
    }

    /// Reads and checks a configuration whose file lies in a folder.
    ///
    /// # Errors
    /// If a key is unknown or a value is out of bounds.
    pub fn parse(text: &str, base: &Path) -> Result<Self, EvaluationError> {
        let mut config: Self = toml::from_str(text)?;
        config.base = base.to_path_buf();
        config.check()?;
        Ok(config)
    }

    /// Cuts the evaluation down to minutes: fewer scenarios, shorter rollouts; figures are then for a look only.
    #[must_use]
    pub fn quick(mut self) -> Self {
        self.columns.scenarios = self.columns.scenarios.min(4);
        self.resamples = self.resamples.min(100);
        if let Some(sharpness) = &mut self.sharpness {
            sharpness.rollouts = sharpness.rollouts.min(4);
        }
        if let Some(layout) = &mut self.layout {
            layout.starts.truncate(1);
        }
        if let Some(drift) = &mut self.drift {
            drift.rollouts = drift.rollouts.min(4);
            drift.marks.retain(|mark| *mark <= 100);
            drift.long = None;
        }
        if let Some(appearance) = &mut self.appearance {
            appearance.rollouts = appearance.rollouts.min(2);
        }
        if let Some(first_frames) = &mut self.first_frames {
            first_frames.scenarios = first_frames.scenarios.min(2);
        }
        if let Some(videos) = &mut self.videos {
            videos.scenarios = videos.scenarios.min(1);
        }
        self
    }

    /// Returns a path relative to the configuration file.
    #[must_use]
    pub fn path(&self, path: &Path) -> PathBuf {
        self.base.join(path)
    }

    fn check(&self) -> Result<(), EvaluationError> {
        let refuse = |field: &str, rule: &str| Err(EvaluationError::config(field, rule));
        let (columns, amounts) = (&self.columns, 1..=100_000);
        let rules = [
            ("version", self.version == 1, "must be 1"),
            ("columns.scenarios", amounts.contains(&columns.scenarios), "must be 1 to 100000"),
            ("columns.first_seed", columns.first_seed <= u64::MAX - amounts.end(), "must leave 100000 seeds above it"),
            ("resamples", amounts.contains(&self.resamples), "must be 1 to 100000"),
        ];
        if let Some((field, _, rule)) = rules.iter().find(|(_, held, _)| !held) {
            return refuse(field, rule);
        }
        for (name, arm) in &self.arms {
            let (teacher, sampled) = (arm.kind == ArmKind::Teacher, arm.kind.samples_windows());
            if !teacher && (arm.guidance.is_some() || arm.dropout.is_some() || arm.keep_look) {
                return refuse(&format!("arms.{name}"), "guidance, dropout and keep_look are a teacher's");
            }
            if arm.keep_look && arm.dropout == Some(ds_train::guidance::Dropout::All) {
                return refuse(&format!("arms.{name}"), "keep_look needs dropout = \"layout\"");
            }
            if !sampled && (arm.steps.is_some() || arm.window.is_some()) {
                return refuse(&format!("arms.{name}"), "steps and window are a teacher's or prior's");
            }
            if sampled && arm.cache_source.is_some() {
                return refuse(&format!("arms.{name}"), "a teacher has no cache");
            }
        }
        if let Some(sharpness) = &self.sharpness {
            self.table("sharpness.arms", &sharpness.arms, &SHARPNESS_ARMS)?;
            if sharpness.rollouts == 0 || sharpness.every == 0 || sharpness.first > sharpness.last {
                return refuse("sharpness", "needs a rollout, every of at least 1, and first no later than last");
            }
        }
        if let Some(layout) = &self.layout {
            self.table("layout.iou", &layout.iou, &LAYOUT_ARMS)?;
            self.table("layout.feature_distance", &layout.feature_distance, &GUIDANCE_ARMS)?;
            if layout.starts.is_empty() || layout.every == 0 || layout.first == 0 || layout.first > layout.frames {
                return refuse("layout", "needs starts, every of at least 1, and first from 1 to frames");
            }
        }
        if let Some(drift) = &self.drift {
            self.table("drift.arms", &drift.arms, &DRIFT_ARMS)?;
            let rising = drift.marks.windows(2).all(|pair| pair[0] < pair[1]);
            let first = drift.marks.first().copied().unwrap_or(0);
            if drift.rollouts < 2 || !rising || drift.window == 0 || first < drift.window {
                return refuse("drift", "needs 2 rollouts, rising marks and a window no longer than the first mark");
            }
            let bounds = drift.pace > 0.0 && drift.pace <= 4.0 && (0.0..=1.0).contains(&drift.shrinkage);
            if !bounds || !(1..=16).contains(&drift.directions) {
                return refuse(
                    "drift",
                    "pace must lie within (0, 4], shrinkage within 0 to 1, directions within 1 to 16",
                );
            }
            if drift.long.as_ref().is_some_and(|long| long.rollouts == 0 || long.from + 20 > long.frames) {
                return refuse("drift.long", "needs a rollout and frames at least 20 behind from");
            }
        }
        if let Some(appearance) = &self.appearance {
            self.table("appearance.arms", &appearance.arms, &DIVERSE_ARMS)?;
            if appearance.rollouts == 0 || appearance.window == 0 || appearance.at < appearance.window {
                return refuse("appearance", "needs a rollout and a window no longer than at");
            }
            if !(appearance.pace > 0.0 && appearance.pace <= 4.0) {
                return refuse("appearance.pace", "must lie within (0, 4]");
            }
        }
        if let Some(first_frames) = &self.first_frames {
            let wordings = &first_frames.wordings;
            let none = first_frames.scenarios == 0 || first_frames.steps == 0 || wordings.is_empty();
            if none || wordings.values().any(Vec::is_empty) {
                return refuse("first_frames", "needs a scenario, a step and wordings of every condition");
            }
        }
        if let Some(videos) = &self.videos {
            for arm in &videos.arms {
                self.known("videos.arms", arm)?;
            }
        }
        self.check_conditions()
    }

    fn check_conditions(&self) -> Result<(), EvaluationError> {
        for name in self.appearance.iter().flat_map(|appearance| &appearance.conditions) {
            condition("appearance.conditions", name)?;
        }
        for name in self.first_frames.iter().flat_map(|first_frames| first_frames.wordings.keys()) {
            condition("first_frames.wordings", name)?;
        }
        Ok(())
    }

    fn table(&self, field: &str, table: &BTreeMap<String, String>, keys: &[&str]) -> Result<(), EvaluationError> {
        for (key, arm) in table {
            if !keys.contains(&key.as_str()) {
                let rule = format!("{key:?} is none of {}", keys.join(", "));
                return Err(EvaluationError::config(field, rule));
            }
            self.known(field, arm)?;
        }
        Ok(())
    }

    fn known(&self, field: &str, arm: &str) -> Result<(), EvaluationError> {
        if self.arms.contains_key(arm) {
            return Ok(());
        }
        Err(EvaluationError::config(field, format!("there is no arm {arm:?}")))
    }
}

/// Reads the name of a condition in a field of the configuration.
pub(crate) fn condition(field: &str, name: &str) -> Result<Condition, EvaluationError> {
    name.parse().map_err(|error| EvaluationError::config(field, format!("{error}")))
}
