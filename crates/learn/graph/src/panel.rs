//! The networks of the policy panel: one frame of the known camera and a few numbers of state to scored plans.
//!
//! Each has an architecture of its own, after a published policy, shrunk to about a million parameters: [`Kind`] names
//! them. A plan is [`PLAN`] numbers: x, y and heading of eight poses, as offsets from going straight on in [`units`]. What
//! a planner attends to of the frame, before state or command enter, is its context; everything that reads the state reads
//! the frame through it. The loss lives with the caller, who is shown the answer and returns its gradient. Networks draw
//! nothing: one that needs noise is handed it.

mod choosing;
mod diffusion;
mod diffusiondrive;
mod diffusiondrive_v2;
mod drivor;
mod layers;
mod ltf;
mod rap;
mod sampling;
pub mod sparsedrive;
mod terms;
mod trunk;
mod view;
pub mod vocabulary;

use burn::tensor::Tensor;
use ds_nn::array::{Array, Declared, Weights, WeightsError};

use crate::graph::{Graph, Mode, array_of};

pub use crate::planner::{HEIGHT_PX, WIDTH_PX};
pub use terms::{expected, sigmoid, total};

/// Numbers of one plan: x, y, heading of eight poses.
pub const PLAN: usize = 24;
/// Time between poses, in seconds; the first is so far from now.
pub const POSE_SECS: f64 = 0.5;
/// Numbers of state: speed twice, yaw rate, acceleration along and across, command one-hot.
pub const STATE: usize = 8;
/// The unit of the first number of state, in metres per second.
pub const SPEED_MPS: f64 = 10.0;
/// Sub-scores that a scorer predicts of a plan: NC, DAC, DDC, TLC, EP, TTC, LK, HC.
pub const TERMS: usize = 8;

/// Returns the units of x and y, in metres, and heading, in radians, of a pose: they grow with time, so that all numbers
/// of plans are of order one.
#[must_use]
pub fn units(pose: usize) -> [f64; 3] {
    let after_secs = POSE_SECS * (pose + 1) as f64;
    [0.3 + 1.2 * after_secs, 0.2 + 0.8 * after_secs, 0.05 + 0.15 * after_secs]
}

/// Returns how far a car has come at a pose that goes straight on, in metres; backwards it stands.
#[must_use]
pub fn straight_on_m(speed_mps: f64, pose: usize) -> f64 {
    speed_mps.max(0.0) * POSE_SECS * (pose + 1) as f64
}

/// A network of the panel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// A transformer over patches with registers; 64 plans by queries, scored by a second decoder (after `DrivoR`).
    Drivor,
    /// Convolutions fused with a learned latent grid; one plan, no scorer (after Latent `TransFuser`).
    Ltf,
    /// Truncated diffusion from anchored plans over the trunk of `ltf`; 20 plans with a logit each (after `DiffusionDrive`).
    Diffusiondrive,
    /// Those 20 plans and 40 copies at other speeds, scored coarsely, the best 16 again (after `DiffusionDriveV2`).
    DiffusiondriveV2,
    /// 64 plans out of a vocabulary of paths and profiles of speed, filtered twice, each with a logit and sub-scores (after
    /// `SparseDriveV2`).
    Sparsedrive,
    /// 32 plans refined where they lie in the frame, which learns from rasters too (after RAP).
    Rap,
}

/// What the logits of plans say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scoring {
    /// Nothing: there is one plan and no logit.
    Single,
    /// The sub-scores of each plan, [`TERMS`] of the last read-out.
    Terms,
    /// The sub-scores of each plan of each read-out, [`TERMS`]: of all, then of those that the first ones keep.
    FilteredTerms,
    /// How likely each plan is the right one, one number of each read-out.
    Confidence,
    /// The total score of each plan, then its sub-scores but the last, [`TERMS`] in all; before it one number of each sample, whether
    /// its context is of a raster.
    Total,
    /// Both: the last but one says how likely each plan is the right one, the last the sub-scores of each.
    ConfidenceAndTerms,
}

impl Kind {
    /// All networks.
    pub const ALL: [Self; 6] =
        [Self::Drivor, Self::Ltf, Self::Diffusiondrive, Self::DiffusiondriveV2, Self::Sparsedrive, Self::Rap];

    /// Returns the name, as in `run --policy`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Drivor => "drivor",
            Self::Ltf => "ltf",
            Self::Diffusiondrive => "diffusiondrive",
            Self::DiffusiondriveV2 => "diffusiondrive_v2",
            Self::Sparsedrive => "sparsedrive",
            Self::Rap => "rap",
        }
    }

    /// Finds a network by its name.
    #[must_use]
    pub fn of(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// Lists the weights.
    #[must_use]
    pub fn declared(self) -> Vec<Declared> {
        match self {
            Self::Drivor => drivor::declared(),
            Self::Ltf => ltf::declared(),
            Self::Diffusiondrive => diffusiondrive::declared(),
            Self::DiffusiondriveV2 => diffusiondrive_v2::declared(),
            Self::Sparsedrive => sparsedrive::declared(),
            Self::Rap => rap::declared(),
        }
    }

    /// Returns what its logits say.
    #[must_use]
    pub fn scoring(self) -> Scoring {
        match self {
            Self::Drivor => Scoring::Terms,
            Self::Ltf => Scoring::Single,
            Self::Diffusiondrive => Scoring::Confidence,
            Self::DiffusiondriveV2 => Scoring::FilteredTerms,
            Self::Sparsedrive => Scoring::ConfidenceAndTerms,
            Self::Rap => Scoring::Total,
        }
    }

    /// Returns how many normal numbers a sample needs as noise.
    #[must_use]
    pub fn noise(self) -> usize {
        match self {
            Self::Drivor | Self::Ltf | Self::Sparsedrive | Self::Rap => 0,
            Self::Diffusiondrive => diffusiondrive::PLANS * diffusion::POINTS,
            Self::DiffusiondriveV2 => diffusiondrive_v2::NOISE,
        }
    }

    /// Returns below which number times are drawn in training; none for a network without noise.
    #[must_use]
    pub fn times(self) -> Option<u32> {
        (self.noise() > 0).then_some(diffusion::TIMES)
    }

    /// Returns the names of the weights that are given to it of the teacher's drives and not trained: x and y of the plans it
    /// starts from; the paths and the profiles that it puts plans together of, in this order; or plans to learn from.
    #[must_use]
    pub fn given(self) -> &'static [&'static str] {
        match self {
            Self::Drivor | Self::Ltf | Self::Rap => &[],
            Self::Diffusiondrive => &[diffusiondrive::ANCHORS],
            Self::DiffusiondriveV2 => &[diffusiondrive_v2::VOCABULARY],
            Self::Sparsedrive => &[sparsedrive::PATHS, sparsedrive::PROFILES],
        }
    }

    /// Returns the network that it goes on from, whose weights it keeps as they are.
    #[must_use]
    pub fn begins_with(self) -> Option<Self> {
        (self == Self::DiffusiondriveV2).then_some(Self::Diffusiondrive)
    }

    /// Says whether training changes the weight of this name.
    #[must_use]
    pub fn trains(self, name: &str) -> bool {
        !self.given().contains(&name) && (self.begins_with().is_none() || name.starts_with(diffusiondrive_v2::SELECTOR))
    }

    /// Rows and columns of the context where its tokens are places, row by row.
    #[must_use]
    pub fn grid(self) -> Option<[usize; 2]> {
        match self {
            Self::Drivor => None,
            Self::Ltf => Some(trunk::LATENT),
            Self::Diffusiondrive | Self::DiffusiondriveV2 => Some(sampling::MAP),
            Self::Sparsedrive => Some(view::MAPS[1]),
            Self::Rap => Some(rap::GRID),
        }
    }

    fn context(self, graph: &Graph, images: Tensor<4>) -> Tensor<3> {
        match self {
            Self::Drivor => drivor::context(graph, images),
            Self::Ltf => ltf::context(graph, images),
            Self::Diffusiondrive | Self::DiffusiondriveV2 => diffusiondrive::context(graph, images),
            Self::Sparsedrive => sparsedrive::context(graph, images),
            Self::Rap => rap::context(graph, images),
        }
    }

    fn forward(self, graph: &Graph, inputs: &Inputs<'_>) -> Heads {
        let context = || self.context(graph, graph.tensor::<4>(inputs.images));
        let state = graph.tensor::<2>(inputs.state);
        match self {
            Self::Drivor => drivor::plan(graph, &context(), &state),
            Self::Ltf => ltf::plan(graph, context(), state),
            Self::Diffusiondrive => diffusiondrive::plan(graph, context(), state, inputs),
            Self::DiffusiondriveV2 => diffusiondrive_v2::plan(graph, &context(), &state, inputs),
            Self::Sparsedrive => sparsedrive::plan(graph, inputs),
            Self::Rap => rap::plan(graph, &context(), state, inputs),
        }
    }
}

/// What a network is shown.
#[derive(Debug, Clone, Copy)]
pub struct Inputs<'a> {
    /// Frames of the known camera, [N, 96, 160, 3].
    pub images: &'a Array,
    /// [N, 8].
    pub state: &'a Array,
    /// Normal numbers, [N, [`Kind::noise`]].
    pub noise: &'a Array,
    /// In training how strongly each sample's noise is mixed in, below [`Kind::times`]; none to answer in all steps.
    /// `diffusiondrive_v2` takes all steps, and learns from a vocabulary's plans besides where there are times.
    pub times: Option<&'a [u32]>,
    /// In training how strongly the context unlearns whether it is of a raster, for [`Scoring::Total`].
    pub reversal: f32,
}

impl Inputs<'_> {
    #[expect(clippy::cast_possible_truncation, reason = "inputs are single precision")]
    fn speeds_mps(&self) -> Vec<f32> {
        self.state.values().chunks_exact(STATE).map(|state| SPEED_MPS as f32 * state[0]).collect()
    }
}

/// What a network answers, or the gradient of a loss by it.
#[derive(Debug, Clone, PartialEq)]
pub struct Answer {
    /// Read-outs of the plans, the last being the answer: [N, M, 24] each.
    pub plans: Vec<Array>,
    /// Logits of each plan, as [`Kind::scoring`] says: [N, M, 8] of the last read-out or of each, or [N, M, 1] of each. Those of `sparsedrive`
    /// begin with the logits of all paths, then all profiles, of both layers: [N, words, 1].
    pub scores: Vec<Array>,
}

/// An answer on the device.
struct Heads {
    plans: Vec<Tensor<3>>,
    scores: Vec<Tensor<3>>,
}

impl Heads {
    fn answer(&self) -> Answer {
        Answer {
            plans: self.plans.iter().map(|plans| array_of(plans.clone())).collect(),
            scores: self.scores.iter().map(|scores| array_of(scores.clone())).collect(),
        }
    }

    /// Returns a number whose gradient by the heads is `slope`.
    fn surrogate(self, graph: &Graph, slope: &Answer) -> Tensor<1> {
        let pairs = self.plans.into_iter().zip(&slope.plans).chain(self.scores.into_iter().zip(&slope.scores));
        let sums = pairs.map(|(head, slope)| (head * graph.tensor::<3>(slope)).sum());
        sums.reduce(|sum, next| sum + next).expect("every network has plans")
    }
}

/// A network with checked weights, ready to answer.
pub struct Network {
    kind: Kind,
    graph: Graph,
}

impl Network {
    /// Checks the weights and puts them on the device.
    ///
    /// # Errors
    /// [`WeightsError`] names the first weight that does not fit.
    pub fn new(kind: Kind, weights: &Weights) -> Result<Self, WeightsError> {
        weights.check(&kind.declared())?;
        Ok(Self { kind, graph: Graph::new(weights, Mode::Infer) })
    }

    /// Returns which network it is.
    #[must_use]
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// Returns what the planner attends to of images [N, 96, 160, 3], before any state enters: [N, tokens, channels].
    #[must_use]
    pub fn context(&self, images: &Array) -> Array {
        array_of(self.kind.context(&self.graph, self.graph.tensor::<4>(images)))
    }

    /// Answers a batch.
    #[must_use]
    pub fn answer(&self, inputs: &Inputs<'_>) -> Answer {
        self.kind.forward(&self.graph, inputs).answer()
    }
}

/// Returns a loss and the gradient of every weight that is trained; `grade` is shown the answer and returns the loss and its gradient by
/// the answer.
///
/// # Errors
/// [`WeightsError`] names the first weight that does not fit.
pub fn gradient(
    kind: Kind,
    weights: &Weights,
    inputs: &Inputs<'_>,
    grade: impl FnOnce(&Answer) -> (f64, Answer),
) -> Result<(f64, Weights), WeightsError> {
    weights.check(&kind.declared())?;
    let graph = Graph::learning(weights, |name| kind.trains(name));
    let heads = kind.forward(&graph, inputs);
    let (loss, slope) = grade(&heads.answer());
    let surrogate = heads.surrogate(&graph, &slope);
    let mut gradients = graph.gradients(surrogate.backward());
    gradients.keep(|name| kind.trains(name));
    Ok((loss, gradients))
}

#[cfg(test)]
mod tests;
