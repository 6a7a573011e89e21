//! The configuration of a study: sources, panel, amounts. Paths are relative to the configuration file.

use std::path::{Path, PathBuf};

use ds_camera::{CameraWorld, ReferenceWorld};
use ds_second_camera::SecondWorld;
use ds_topic::ObservationSource;
use serde::{Deserialize, Serialize};

pub use super::recorded::Recorded;
pub use super::source::Source;
use crate::error::EvaluationError;

/// What a study asks of the same frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Study {
    /// How near the frames of sources are to those of the reference camera, for policies.
    Fidelity,
    /// Whether sources that are far are those on which policies plan badly.
    Correlation,
    /// How much edits of the world are answered to, and hard scenarios.
    Sensitivity,
    /// How distances grow along a drive.
    Rollout,
    /// The video model without one of its parts.
    Ablation,
    /// How far sources are from frames that real cameras recorded.
    Anchor,
    /// Which part of a frame makes a policy plan otherwise.
    Parts,
}

impl Study {
    /// Returns its name: of the command, its files and its shipped configuration.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Fidelity => "fidelity",
            Self::Correlation => "correlation",
            Self::Sensitivity => "sensitivity",
            Self::Rollout => "rollout",
            Self::Ablation => "ablation",
            Self::Anchor => "anchor",
            Self::Parts => "parts",
        }
    }
}

/// The world whose camera makes the real set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum WorldName {
    /// The reference camera's, in which everything is trained.
    #[default]
    A,
    /// The second world, with roads and a rig of its own.
    B,
}

impl WorldName {
    /// Returns the seed from which on no training has seen what is generated.
    pub(crate) fn held_out_from(self) -> u64 {
        match self {
            Self::A => 30_000_000,
            Self::B => 10_001,
        }
    }

    /// Returns the world.
    pub(crate) fn world(self) -> &'static dyn CameraWorld {
        match self {
            Self::A => &ReferenceWorld,
            Self::B => &SecondWorld,
        }
    }
}

/// A study over declared sources.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StudyConfig {
    /// Schema version, 1.
    pub version: u32,
    /// Where results go, relative to the current folder.
    pub out: PathBuf,
    /// Seed of the first eight generated scenarios, one per family; the next seed gives the next eight.
    pub first_seed: u64,
    /// Generated scenarios.
    pub scenarios: u64,
    /// Frames after the first of each scenario, 0.1 s each.
    pub frames: u32,
    /// Every how many frames a policy looks; at least 8 (0.8 s) but of study `parts`.
    pub every: u32,
    /// The look of scenarios, as in evaluations: `daylight`, `drawn` or an appearance.
    pub look: String,
    /// Resamples of an interval.
    pub draws: u64,
    /// The sources that are measured.
    pub sources: Vec<Source>,
    /// The world whose camera makes the real set.
    #[serde(default)]
    pub world: WorldName,
    /// Ticks of the log per frame; the log's own pace without it.
    #[serde(default = "one")]
    pub pace: f64,
    /// Pairs of sources whose ratio is stated, by name.
    #[serde(default)]
    pub ratios: Vec<[String; 2]>,
    /// Of study `sensitivity`: pairs of a source and the same with an edit.
    #[serde(default)]
    pub edits: Vec<[String; 2]>,
    /// Of study `rollout`: the frames at which distances are stated, over the ten frames up to each.
    #[serde(default)]
    pub marks: Vec<u32>,
    /// Frames that real cameras recorded: the distance of the first two sets becomes a unit.
    #[serde(default)]
    pub recorded: Vec<Recorded>,
    /// The policies; FDπ is the mean over those that are no control.
    pub panel: Vec<MemberConfig>,
    /// Weights of the look network, for `fd_look` and `fd_look_clip`.
    pub look_weights: PathBuf,
    /// Frames of a clip of `fd_look_clip`.
    pub clip: u32,
    /// Manifest of a network of frames, for `fid`.
    #[serde(default)]
    pub fid: Option<PathBuf>,
    /// Manifest of a network of clips, for `fvd`.
    #[serde(default)]
    pub fvd: Option<PathBuf>,
    /// The video model; needed by source `dreamstream`.
    #[serde(default)]
    pub video: Option<VideoFiles>,
    /// Size of the frames without a video model, in pixels: width and height.
    pub size_px: (u32, u32),
    /// Where this file lies.
    #[serde(skip)]
    pub base: PathBuf,
}

fn one() -> f64 {
    1.0
}

/// Frames up to a mark whose distance is stated there.
pub(crate) const WINDOW: u32 = 10;

/// Names of figures, beside the real set's own: no source, policy or recorded set has one.
const RESERVED: [&str; 7] = ["the real set", "fd_look", "fd_look_clip", "fd_pi", "own features", "fid", "fvd"];

/// The least frames between two that distances are of.
const APART: u32 = 8;

/// A policy of the panel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MemberConfig {
    /// Name in tables.
    pub name: String,
    /// The built-in policy, the manifest of an ONNX network, or the name of a policy that connects to `listen`.
    pub policy: String,
    /// Its weights; drawn ones without.
    #[serde(default)]
    pub weights: Option<PathBuf>,
    /// Where a policy in another process connects, such as `tcp/127.0.0.1:7448`.
    #[serde(default)]
    pub listen: Option<String>,
    /// Whether it stands beside the panel, outside the mean.
    #[serde(default)]
    pub control: bool,
}

/// A video model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VideoFiles {
    /// Model preset.
    pub model: PathBuf,
    /// Weights.
    pub weights: PathBuf,
    /// The transformer of source `dreamstream-no-guidance`.
    #[serde(default)]
    pub no_guidance: PathBuf,
}

impl StudyConfig {
    /// Reads and checks a configuration.
    ///
    /// # Errors
    /// If the file cannot be read, a key is unknown or a value is out of bounds.
    pub fn load(path: &Path) -> Result<Self, EvaluationError> {
        let text = std::fs::read_to_string(path).map_err(EvaluationError::io("the study's configuration", path))?;
        let mut config: Self = toml::from_str(&text)?;
        config.base = path.parent().unwrap_or(Path::new(".")).to_path_buf();
        config.check()?;
        Ok(config)
    }

    /// Cuts the study down to minutes; its figures are for a look only.
    #[must_use]
    pub fn quick(mut self) -> Self {
        self.scenarios = self.scenarios.min(16);
        self.draws = self.draws.min(200);
        self.out = self.out.join("quick");
        self
    }

    /// Returns a path relative to the configuration file.
    #[must_use]
    pub fn path(&self, path: &Path) -> PathBuf {
        self.base.join(path)
    }

    /// Returns the frames that policies look at.
    pub fn looked(&self) -> Vec<u32> {
        if self.marks.is_empty() {
            return (self.every..=self.frames).step_by(self.every as usize).collect();
        }
        self.marks.iter().flat_map(|mark| mark + 1 - WINDOW..=*mark).collect()
    }

    /// Returns the rows of a scenario in the smallest matrix of features: frames that are looked at, or clips.
    fn rows(&self) -> u32 {
        let looked = if self.marks.is_empty() { self.frames / self.every } else { WINDOW };
        looked.min(self.frames / self.clip)
    }

    /// Returns the sources besides the real set itself.
    pub(crate) fn others(&self) -> impl Iterator<Item = (usize, &Source)> {
        self.sources.iter().enumerate().filter(|(_, source)| !source.is_real())
    }

    /// Returns the place of a source of a name.
    pub(crate) fn place(&self, name: &str) -> Option<usize> {
        self.sources.iter().position(|source| source.name() == name)
    }

    /// Checks that a study finds what it asks for.
    ///
    /// # Errors
    /// If it does not; names the field.
    pub fn check_for(&self, study: Study) -> Result<(), EvaluationError> {
        self.check()?;
        let rules = [
            ("sources", study != Study::Correlation || self.others().count() >= 4, "must name 4 besides the reference"),
            ("sources", study != Study::Parts || self.others().count() > 0, "must name one besides the reference"),
            (
                "panel",
                study != Study::Correlation || self.panel.iter().filter(|member| !member.control).count() > 1,
                "must name 2 policies that are no control: each is held against the distance of the others",
            ),
            (
                "scenarios",
                study == Study::Parts || (self.scenarios / 2).saturating_mul(u64::from(self.rows())) > 1,
                "are too few: half of them must hold 2 frames and 2 clips",
            ),
            ("recorded", study != Study::Parts || self.recorded.is_empty(), "are not of parts, which measures plans"),
            (
                "fid and fvd",
                study != Study::Parts || self.fid.is_none() && self.fvd.is_none(),
                "are not of parts, which measures plans",
            ),
            ("edits", (study == Study::Sensitivity) != self.edits.is_empty(), "are of sensitivity, which needs one"),
            ("recorded", study != Study::Anchor || self.recorded.len() > 1, "must name two sets of recorded frames"),
            ("marks", (study == Study::Rollout) == (self.marks.len() > 1), "are of rollout, which needs two"),
        ];
        match rules.iter().find(|(_, held, _)| !held) {
            Some((field, _, rule)) => Err(EvaluationError::config(*field, *rule)),
            None if study == Study::Parts => Ok(()),
            None => self.check_apart(),
        }
    }

    /// Checks that frames are far enough apart for distances.
    ///
    /// # Errors
    /// If they are not.
    pub(crate) fn check_apart(&self) -> Result<(), EvaluationError> {
        if self.every < APART {
            return Err(EvaluationError::config("every", format!("must be {APART} to frames")));
        }
        Ok(())
    }

    /// Checks all values.
    ///
    /// # Errors
    /// If one is out of bounds; names the field.
    pub fn check(&self) -> Result<(), EvaluationError> {
        let rules = [
            ("version", self.version == 1, "must be 1"),
            ("scenarios", (2..=100_000).contains(&self.scenarios), "must be 2 to 100000"),
            (
                "first_seed",
                self.first_seed.checked_add(self.scenarios).is_some(),
                "must leave as many seeds above it as there are scenarios",
            ),
            ("every", (1..=self.frames).contains(&self.every), "must be 1 to frames"),
            ("frames", self.frames <= 2_000, "must be 2000 at most"),
            ("pace", self.pace > 0.0 && self.pace <= 4.0, "must be above 0, at most 4"),
            (
                "marks",
                self.marks.iter().all(|mark| (WINDOW..=self.frames).contains(mark)) && self.marks.is_sorted(),
                "must rise, from 10 to frames",
            ),
            ("draws", (1..=100_000).contains(&self.draws), "must be 1 to 100000"),
            ("clip", (2..=self.frames).contains(&self.clip), "must be 2 to frames"),
            (
                "size_px",
                [self.size_px.0, self.size_px.1].iter().all(|side| (16..=2048).contains(side)),
                "must be 16 to 2048",
            ),
            ("sources", !self.sources.is_empty(), "must name one"),
            ("recorded", self.recorded.len() != 1, "must name two sets or none: one alone has no unit"),
            ("panel", self.panel.iter().any(|member| !member.control), "must name a policy that is no control"),
        ];
        if let Some((field, _, rule)) = rules.iter().find(|(_, held, _)| !held) {
            return Err(EvaluationError::config(*field, *rule));
        }
        self.check_names()?;
        for (field, pairs) in [("ratios", &self.ratios), ("edits", &self.edits)] {
            if let Some(absent) = pairs.iter().flatten().find(|name| self.place(name).is_none()) {
                return Err(EvaluationError::config(field, format!("{absent:?} is not among sources")));
            }
        }
        if let Some(generated) = self.sources.iter().find(|source| source.from.is_generated() && self.video.is_none()) {
            return Err(EvaluationError::config("video", format!("is needed by source {:?}", generated.name())));
        }
        if let Some((set, rule)) = self.recorded.iter().find_map(|set| Some((set, set.wrong()?))) {
            return Err(EvaluationError::config(format!("recorded.{}", set.name), rule));
        }
        let made_in_a = [ObservationSource::Reprojected, ObservationSource::SecondCamera];
        if let Some(source) = self.sources.iter().find(|s| self.world == WorldName::B && made_in_a.contains(&s.from)) {
            return Err(EvaluationError::config("sources", format!("{:?} is of world A alone", source.name())));
        }
        Ok(())
    }

    /// Checks that no row of a table takes the place of another.
    fn check_names(&self) -> Result<(), EvaluationError> {
        let sources: Vec<&str> = self.sources.iter().map(Source::name).collect();
        let panel: Vec<&str> = self.panel.iter().map(|member| member.name.as_str()).collect();
        let recorded: Vec<&str> = self.recorded.iter().map(|set| set.name.as_str()).collect();
        let real = Source::reference();
        let own = |name: &&str| {
            *name != real.name() || self.sources.iter().any(|source| source.name() == *name && !source.is_real())
        };
        let declared = sources.iter().copied().filter(own).collect();
        for (field, names) in [("sources", declared), ("panel", panel.clone()), ("recorded", recorded.clone())] {
            if let Some(taken) = names.iter().find(|name| real.name() == **name || RESERVED.contains(name)) {
                return Err(EvaluationError::config(
                    field,
                    format!("{taken:?} is the name of something else in tables"),
                ));
            }
        }
        let beside = [recorded, sources.clone()].concat();
        for (field, names) in [("sources", sources), ("panel", panel), ("recorded and sources", beside)] {
            if let Some(twice) = (1..names.len()).find(|at| names[..*at].contains(&names[*at])) {
                return Err(EvaluationError::config(field, format!("{:?} stands twice", names[twice])));
            }
        }
        Ok(())
    }
}
