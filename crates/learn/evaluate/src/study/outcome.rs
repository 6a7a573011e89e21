//! What the study `fidelity` found, as written to `fidelity.json`. All distances are × 100.

use std::collections::BTreeMap;

use ds_fidelity::Interval;
use serde::{Deserialize, Serialize};

/// A value with the ends of its 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Figure {
    /// The value of all scenarios.
    pub value: f64,
    /// Lower end; re-centred, so it may lie below zero.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

impl Figure {
    /// Takes an interval times a factor.
    #[must_use]
    pub fn of(interval: Interval, times: f64) -> Self {
        Self { value: interval.value * times, low: interval.low * times, high: interval.high * times }
    }
}

/// A distance of one source to one network's eye.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// FD × 100.
    pub fd: Figure,
    /// Mean |φ - φ̃|²/Tr Σ of paired frames × 100: never below the value.
    pub bound: f64,
    /// b(n) × 100: the value of two independent sets of as many frames that do not differ.
    pub bias: f64,
    /// The value extrapolated in 1/n × 100.
    pub extrapolated: f64,
    /// Why it is to be doubted.
    pub warnings: Vec<String>,
    /// FD of features placed in four groups × 100: ranks only. None for networks without places.
    pub placed: Option<f64>,
}

/// A network's table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Table {
    /// Whether it stands outside FDπ's mean.
    pub control: bool,
    /// Features of a frame (or clip).
    pub features: usize,
    /// Frames (or clips) in each set.
    pub frames: usize,
    /// FD of two halves of the real set × 100.
    pub halves: f64,
    /// By source.
    pub sources: BTreeMap<String, Row>,
    /// The digest of the weights.
    pub digest: String,
}

/// A ratio of FDπ of two sources.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ratio {
    /// The source above.
    pub above: String,
    /// The source below.
    pub below: String,
    /// The ratio, its interval made on the scale of logarithms; none where a value is not above zero.
    pub ratio: Option<Figure>,
}

/// A scenario whose frames differ.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Scene {
    /// The scenario.
    pub name: String,
    /// Mean |φ - φ̃|²/Tr Σ of its frames over the panel × 100.
    pub apart: f64,
    /// The frame that differs most.
    pub frame: u32,
    /// The picture beside the page: real above, source below; none where none was made.
    pub picture: Option<String>,
}

/// What was found.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Outcome {
    /// Whether amounts were cut down for a look.
    pub quick: bool,
    /// What the real set is: `sim-to-reference` where it is the project's own camera.
    pub kind: String,
    /// Seed of the first scenarios.
    pub first_seed: u64,
    /// Scenarios, half of them displaced from the log.
    pub scenarios: usize,
    /// Seconds that the frames took to be made and looked at, kept ones not counted.
    pub seconds: f64,
    /// FDπ × 100 by source: the mean over the panel.
    pub fd_pi: BTreeMap<String, Figure>,
    /// Ratios of FDπ.
    pub ratios: Vec<Ratio>,
    /// Policies: panel and controls.
    pub policies: BTreeMap<String, Table>,
    /// Distances of the look network: `fd_look`, `fd_look_clip`. No FID and no FVD.
    pub others: BTreeMap<String, Table>,
    /// The scenes of each source that differ most for the panel.
    pub worst: BTreeMap<String, Vec<Scene>>,
}
