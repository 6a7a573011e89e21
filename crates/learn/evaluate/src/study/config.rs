//! The configuration of the study `fidelity`: sources, panel, amounts. Paths are relative to the configuration file.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::error::AppraisalError;

/// A study of how near the frames of sources are to those of the reference camera, for policies.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FidelityConfig {
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
    /// Every how many frames a policy looks; at least 8 (0.8 s).
    pub every: u32,
    /// The look of scenarios, as in evaluations: `daylight`, `drawn` or an appearance.
    pub look: String,
    /// Resamples of an interval.
    pub draws: u64,
    /// The sources that are measured.
    pub sources: Vec<Source>,
    /// Pairs of sources whose ratio is stated.
    #[serde(default)]
    pub ratios: Vec<[Source; 2]>,
    /// The policies; FDπ is the mean over those that are no control.
    pub panel: Vec<MemberConfig>,
    /// Weights of the look network, for `fd_look` and `fd_look_clip`.
    pub look_weights: PathBuf,
    /// Frames of a clip of `fd_look_clip`.
    pub clip: u32,
    /// The video model; needed by source `dreamstream`.
    #[serde(default)]
    pub video: Option<VideoFiles>,
    /// Size of the frames without a video model, in pixels: width and height.
    pub size_px: (u32, u32),
    /// Where this file lies.
    #[serde(skip)]
    pub base: PathBuf,
}

/// An observation source, by the names of `run --observation`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Source {
    /// The reference camera: the real set itself, at distance 0.
    Reference,
    /// The plain game-engine look.
    SimRgb,
    /// The condition image.
    Layout,
    /// The autoregressive video model.
    Dreamstream,
}

impl Source {
    /// Returns the name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Reference => "reference",
            Self::SimRgb => "sim-rgb",
            Self::Layout => "layout",
            Self::Dreamstream => "dreamstream",
        }
    }
}

/// A policy of the panel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MemberConfig {
    /// Name in tables.
    pub name: String,
    /// The built-in policy.
    pub policy: String,
    /// Its weights; drawn ones without.
    #[serde(default)]
    pub weights: Option<PathBuf>,
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
}

impl FidelityConfig {
    /// Reads and checks a configuration.
    ///
    /// # Errors
    /// If the file cannot be read, a key is unknown or a value is out of bounds.
    pub fn load(path: &Path) -> Result<Self, AppraisalError> {
        let text = std::fs::read_to_string(path).map_err(AppraisalError::io("the study's configuration", path))?;
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
    pub fn looked(&self) -> impl Iterator<Item = u32> {
        (self.every..=self.frames).step_by(self.every as usize)
    }

    /// Checks all values.
    ///
    /// # Errors
    /// If one is out of bounds; names the field.
    pub fn check(&self) -> Result<(), AppraisalError> {
        let rules = [
            ("version", self.version == 1, "must be 1"),
            ("scenarios", (2..=100_000).contains(&self.scenarios), "must be 2 to 100000"),
            ("every", (8..=self.frames).contains(&self.every), "must be 8 to frames"),
            ("frames", self.frames <= 2_000, "must be 2000 at most"),
            ("draws", (1..=100_000).contains(&self.draws), "must be 1 to 100000"),
            ("clip", (2..=self.frames).contains(&self.clip), "must be 2 to frames"),
            (
                "size_px",
                [self.size_px.0, self.size_px.1].iter().all(|side| (16..=2048).contains(side)),
                "must be 16 to 2048",
            ),
            ("sources", !self.sources.is_empty(), "must name one"),
            ("panel", self.panel.iter().any(|member| !member.control), "must name a policy that is no control"),
        ];
        if let Some((field, _, rule)) = rules.iter().find(|(_, held, _)| !held) {
            return Err(AppraisalError::config(*field, *rule));
        }
        for (field, names) in [
            ("sources", self.sources.iter().map(|source| source.name()).collect::<Vec<_>>()),
            ("panel", self.panel.iter().map(|member| member.name.as_str()).collect()),
        ] {
            if let Some(twice) = (1..names.len()).find(|at| names[..*at].contains(&names[*at])) {
                return Err(AppraisalError::config(field, format!("{:?} stands twice", names[twice])));
            }
        }
        if let Some(absent) = self.ratios.iter().flatten().find(|source| !self.sources.contains(source)) {
            return Err(AppraisalError::config("ratios", format!("{:?} is not among sources", absent.name())));
        }
        if self.sources.contains(&Source::Dreamstream) && self.video.is_none() {
            return Err(AppraisalError::config("video", "is needed by source \"dreamstream\""));
        }
        Ok(())
    }
}
