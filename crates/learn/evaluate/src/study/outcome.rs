//! What a study found, as written to `STUDY.json`. All distances of frames are × 100.

use std::collections::BTreeMap;

use ds_fidelity::Interval;
use serde::{Deserialize, Serialize};

/// A value with the ends of its 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Figure {
    /// The value of all scenarios.
    pub value: f64,
    /// Lower end; that of a distance is re-centred, so it may lie below zero.
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

    /// Takes a value that has no interval.
    #[must_use]
    pub fn exact(value: f64) -> Self {
        Self { value, low: value, high: value }
    }
}

/// A distance of one source to one network's eye. Of networks that were given it is in the features' own unit, squared: not over
/// Tr Σ and not × 100.
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

/// Where a policy attends to something else in one frame of a source.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Attended {
    /// The source.
    pub source: String,
    /// The scenario.
    pub scenario: String,
    /// Whether it is the one that differs most for the policy, or the one in the middle.
    pub worst: bool,
    /// Mean |φ − φ̃|²/Tr Σ of its frames × 100.
    pub apart: f64,
    /// The frame, the one that differs most of the scenario.
    pub frame: u32,
    /// The picture beside the page: real on the left, source on the right, as the policy sees them.
    pub picture: String,
    /// Rows and columns of the places.
    pub grid: [usize; 2],
    /// Whether they are places of the ground before the car, and not of the picture.
    pub ground: bool,
    /// |c − c̃|² of each place, row by row, over the variance of a place from one real frame to another, the mean of all places.
    pub places: Vec<f64>,
}

/// One source as one policy meets it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// The policy whose plans are scored.
    pub policy: String,
    /// The source.
    pub source: String,
    /// The distance × 100.
    pub distance: f64,
    /// Mean PDMS, 0 to 1.
    pub pdms: f64,
}

/// How a metric goes with PDMS over sources.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Metric {
    /// Mean over policies of Pearson's r; the interval is over scenarios, re-centred on the scale of Fisher's z.
    pub r: Figure,
    /// 95 % interval over as many independent sources.
    pub of_sources: Option<[f64; 2]>,
    /// r of each policy.
    pub each: BTreeMap<String, f64>,
    /// Mean over policies of Spearman's.
    pub spearman: f64,
    /// Least and greatest r with one source left out.
    pub without_one: [f64; 2],
    /// What is correlated.
    pub points: Vec<Point>,
}

/// What study `correlation` found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Correlation {
    /// Sources that are correlated over.
    pub sources: usize,
    /// Mean PDMS by policy and source.
    pub pdms: BTreeMap<String, BTreeMap<String, f64>>,
    /// By metric: `fd_pi` (the mean of the other policies), `own features`, controls and the look network's.
    pub metrics: BTreeMap<String, Metric>,
    /// r of `fd_pi` less that of another metric, the same draws for both.
    pub apart: BTreeMap<String, Figure>,
}

/// How much a metric answers to an edit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Answer {
    /// m(edited)/m(true) - 1, or m(edited) in bootstrap deviations.
    pub response: Figure,
    /// FDπ's response over this one's; none where this one's interval is not above zero.
    pub times: Option<Figure>,
}

/// What an edit of the world does.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Response {
    /// The source of the true world.
    pub before: String,
    /// The source of the edited world.
    pub after: String,
    /// Whether responses are in bootstrap deviations.
    pub in_deviations: bool,
    /// By metric.
    pub answers: BTreeMap<String, Answer>,
}

/// A source on the hard scenarios.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Hard {
    /// The source.
    pub source: String,
    /// Hard scenarios.
    pub scenarios: usize,
    /// FDπ × 100 on them, in units of the variance of the whole real set.
    pub value: f64,
    /// Its mean over random subsets as large.
    pub random: f64,
    /// By which share it is more than that.
    pub more: f64,
    /// The share of random subsets, the hard one counted among them, that are as far.
    pub p: f64,
}

/// What study `sensitivity` found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Sensitivity {
    /// By edit.
    pub responses: Vec<Response>,
    /// By source.
    pub hard: Vec<Hard>,
}

/// FDπ at a mark.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Mark {
    /// The last of its ten frames.
    pub frame: u32,
    /// FDπ × 100.
    pub fd_pi: Figure,
}

/// The drift of a source.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Curve {
    /// The source.
    pub source: String,
    /// Along the drive.
    pub marks: Vec<Mark>,
    /// FDπ at the last mark less that at the first.
    pub rise: Figure,
}

/// What share of a rise is taken away.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Removed {
    /// The source that rises.
    pub without: String,
    /// The source that is meant to rise less.
    pub with: String,
    /// The share; none where the first does not rise.
    pub share: Option<Figure>,
}

/// What study `rollout` found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Rollout {
    /// By source.
    pub curves: Vec<Curve>,
    /// By pair.
    pub removed: Vec<Removed>,
}

/// Distances in units of that of two recorded sets.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Anchor {
    /// The two recorded sets whose distance is 1.
    pub unit: [String; 2],
    /// Frames by recorded set.
    pub frames: BTreeMap<String, usize>,
    /// From the first recorded set to every other one, to the study's real set and to its sources: mean over the panel.
    pub recorded_to: BTreeMap<String, f64>,
    /// From the study's real set.
    pub reference_to: BTreeMap<String, f64>,
    /// By policy.
    pub policies: BTreeMap<String, AnchorOf>,
}

/// The same to one policy.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AnchorOf {
    /// Whether it stands outside the mean.
    pub control: bool,
    /// Features of a frame.
    pub features: usize,
    /// By which share all covariances are drawn to their diagonals.
    pub shrinkage: f64,
    /// The unit over the variance of the first recorded set.
    pub unit: f64,
    /// From the first recorded set.
    pub recorded_to: BTreeMap<String, f64>,
    /// From the study's real set.
    pub reference_to: BTreeMap<String, f64>,
}

/// What a part of the frames does to the plans of a policy; intervals are over scenarios.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PartOf {
    /// The part.
    pub part: String,
    /// How much nearer plans are to those on the reference where the source's frames have the reference's pixels of the part,
    /// in metres; below zero they are further.
    pub taken_away_m: Figure,
    /// How far plans are apart where the reference's frames have the source's pixels of the part, in metres.
    pub alone_m: Figure,
    /// The share of pixels that are of the part.
    pub share: Figure,
}

/// What one policy plans on the frames of one source, against what it plans on the reference's.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlansOf {
    /// Moments that it plans at, of all scenarios.
    pub moments: usize,
    /// Mean distance of the places that plans reach after 2 s, in metres.
    pub apart_m: Figure,
    /// How much further ahead the source's plans reach, mean in metres.
    pub ahead_m: Figure,
    /// By part, the one that takes most away first.
    pub parts: Vec<PartOf>,
}

/// The moment of a scenario at which plans are furthest apart, mean over policies.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FurthestApart {
    /// The scenario.
    pub scenario: String,
    /// The frame.
    pub frame: u32,
    /// How far plans are apart, in metres.
    pub apart_m: f64,
    /// How much further ahead the source's reach, in metres.
    pub ahead_m: f64,
    /// What each part takes away of that, in metres.
    pub taken_away_m: BTreeMap<String, f64>,
    /// The picture beside the page: reference, source and layout below each other.
    pub picture: String,
}

/// What study `parts` found.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Parts {
    /// By source, then policy.
    pub sources: BTreeMap<String, BTreeMap<String, PlansOf>>,
    /// By source: moments that are furthest apart.
    pub furthest: BTreeMap<String, Vec<FurthestApart>>,
}

/// What was found.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Outcome {
    /// The study.
    pub study: String,
    /// The world whose camera makes the real set: `A`, in which everything is trained, or `B`.
    pub world: String,
    /// Whether amounts were cut down for a look.
    pub quick: bool,
    /// What the real set is: `sim-to-reference` where it is the project's own camera.
    pub kind: String,
    /// Seed of the first scenarios.
    pub first_seed: u64,
    /// Whether no training has seen any of them; none for recorded drives.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub held_out: Option<bool>,
    /// Scenarios, half of them displaced from the log.
    pub scenarios: usize,
    /// Seconds that the frames took to be made and looked at, kept ones not counted.
    pub seconds: f64,
    /// Distances from frames that real cameras recorded, where some were given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub anchor: Option<Anchor>,
    /// FDπ × 100 by source: the mean over the panel.
    pub fd_pi: BTreeMap<String, Figure>,
    /// Ratios of FDπ.
    pub ratios: Vec<Ratio>,
    /// Policies: panel and controls.
    pub policies: BTreeMap<String, Table>,
    /// Distances of the look network: `fd_look`, `fd_look_clip`. No FID and no FVD.
    pub others: BTreeMap<String, Table>,
    /// Distances of the networks that were given: `fid`, `fvd`, in the features' own unit, squared.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub given: BTreeMap<String, Table>,
    /// The scenes of each source that differ most for the panel.
    pub worst: BTreeMap<String, Vec<Scene>>,
    /// By policy whose tokens are places: where frames differ for it, in the scene that differs most of each source and the one in the middle.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub attended: BTreeMap<String, Vec<Attended>>,
    /// One moment as each source shows it: names of source and picture.
    pub looks: Vec<(String, String)>,
    /// Of study `drives`, where known: how far apart the cars of paired frames stand, by source, mean in metres.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub apart_m: BTreeMap<String, f64>,
    /// Of study `correlation`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub correlation: Option<Correlation>,
    /// Of study `sensitivity`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensitivity: Option<Sensitivity>,
    /// Of study `rollout`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rollout: Option<Rollout>,
    /// Of study `parts`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parts: Option<Parts>,
}

impl Outcome {
    /// Says how many scenarios there are, of which seeds, and whether trainings may have seen them.
    #[must_use]
    pub fn of_scenarios(&self) -> String {
        let Self { scenarios, first_seed, .. } = self;
        match self.held_out {
            None => format!("{scenarios} scenarios"),
            Some(true) => format!("{scenarios} held-out scenarios from seed {first_seed}"),
            Some(false) => format!(
                "{scenarios} scenarios from seed {first_seed}, below those held out: trainings may have seen them"
            ),
        }
    }
}
