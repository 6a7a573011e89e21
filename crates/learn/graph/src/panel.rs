//! The networks of the policy panel: one frame of the known camera and a few numbers of state to scored plans.
//!
//! Each has an architecture of its own, after a published policy, shrunk to about a million parameters: [`Kind`] names
//! them. A plan is [`PLAN`] numbers: x, y and heading of eight poses in the units of the caller. What a planner attends
//! to of the frame, before state or command enter, is its context; everything that reads the state reads the frame
//! through it. The loss lives with the caller, who is shown the answer and returns its gradient.

mod drivor;
mod layers;
mod ltf;

use burn::tensor::Tensor;
use ds_nn::array::{Array, Declared, Weights, WeightsError};

use crate::graph::{Graph, Mode, array_of};

pub use crate::planner::{HEIGHT_PX, WIDTH_PX};

/// Numbers of one plan: x, y, heading of eight poses.
pub const PLAN: usize = 24;
/// Numbers of state: speed twice, yaw rate, acceleration along and across, command one-hot.
pub const STATE: usize = 8;
/// Sub-scores that a scorer predicts of a plan: NC, DAC, DDC, TLC, EP, TTC, LK, HC.
pub const TERMS: usize = 8;

/// A network of the panel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// A transformer over patches with registers; 64 plans by queries, scored by a second decoder (after `DrivoR`).
    Drivor,
    /// Convolutions fused with a learned latent grid; one plan, no scorer (after Latent `TransFuser`).
    Ltf,
}

impl Kind {
    /// All networks.
    pub const ALL: [Self; 2] = [Self::Drivor, Self::Ltf];

    /// Returns the name, as in `run --policy`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Drivor => "drivor",
            Self::Ltf => "ltf",
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
        }
    }

    /// Rows and columns of the context where its tokens are places, row by row.
    #[must_use]
    pub fn grid(self) -> Option<[usize; 2]> {
        match self {
            Self::Drivor => None,
            Self::Ltf => Some(ltf::LATENT),
        }
    }

    fn context(self, graph: &Graph, images: Tensor<4>) -> Tensor<3> {
        match self {
            Self::Drivor => drivor::context(graph, images),
            Self::Ltf => ltf::context(graph, images),
        }
    }

    fn forward(self, graph: &Graph, inputs: &Inputs<'_>) -> Heads {
        let context = self.context(graph, graph.tensor::<4>(inputs.images));
        let state = graph.tensor::<2>(inputs.state);
        match self {
            Self::Drivor => drivor::plan(graph, &context, &state),
            Self::Ltf => ltf::plan(graph, &context, &state),
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
}

/// What a network answers, or the gradient of a loss by it.
#[derive(Debug, Clone, PartialEq)]
pub struct Answer {
    /// Read-outs of the plans, the last being the answer: [N, M, 24] each.
    pub plans: Vec<Array>,
    /// Logits of the sub-scores of each plan, [N, M, 8]; none without a scorer.
    pub scores: Option<Array>,
}

/// An answer on the device.
struct Heads {
    plans: Vec<Tensor<3>>,
    scores: Option<Tensor<3>>,
}

impl Heads {
    fn answer(&self) -> Answer {
        Answer {
            plans: self.plans.iter().map(|plans| array_of(plans.clone())).collect(),
            scores: self.scores.clone().map(array_of),
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

/// Returns a loss and the gradient of every weight; `grade` is shown the answer and returns the loss and its gradient by
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
    let graph = Graph::new(weights, Mode::Train);
    let heads = kind.forward(&graph, inputs);
    let (loss, slope) = grade(&heads.answer());
    let surrogate = heads.surrogate(&graph, &slope);
    Ok((loss, graph.gradients(surrogate.backward())))
}

#[cfg(test)]
mod tests;
