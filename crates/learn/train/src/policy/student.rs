//! Who is trained: the `camera` policy's network or one of the panel, each with its own inputs and loss.

use ds_graph::panel::{self, Inputs, Kind};
use ds_graph::planner;
use ds_nn::Array;
use ds_nn::array::{Declared, Weights};
use ds_policy::Policy;
use ds_policy::camera::{self, CameraPolicy, SIZE, proposals};
use ds_policy::panel::{PanelPolicy, state_of};

use super::PolicyTrainError;
use super::judge::Judge;
use super::shown::Shown;
use super::{loss, panel_loss};

/// A policy that is trained.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Student {
    /// The `camera` policy.
    Camera,
    /// A policy of the panel.
    Panel(Kind),
}

impl Student {
    /// Finds who is trained by the policy's name.
    #[must_use]
    pub fn of(name: &str) -> Option<Self> {
        if name == camera::NAME { Some(Self::Camera) } else { Kind::of(name).map(Self::Panel) }
    }

    /// Returns the policy's name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Camera => camera::NAME,
            Self::Panel(kind) => kind.name(),
        }
    }

    /// Returns the name of the weights file.
    #[must_use]
    pub fn file_name(self) -> String {
        match self {
            Self::Camera => "camera_policy.safetensors".to_owned(),
            Self::Panel(kind) => format!("{}.safetensors", kind.name()),
        }
    }

    pub(super) fn declared(self) -> Vec<Declared> {
        match self {
            Self::Camera => SIZE.declared(),
            Self::Panel(kind) => kind.declared(),
        }
    }

    /// Makes the policy of weights.
    pub(super) fn policy(self, weights: &Weights) -> Result<Box<dyn Policy>, PolicyTrainError> {
        Ok(match self {
            Self::Camera => Box::new(CameraPolicy::new(weights)?),
            Self::Panel(kind) => Box::new(PanelPolicy::new(kind, weights)?),
        })
    }

    /// Returns the loss of a batch and its gradient by the weights; `images` are [N, 96, 160, 3].
    pub(super) fn gradient(
        self,
        weights: &Weights,
        images: &Array,
        batch: &[Shown<'_>],
        judge: &mut Judge,
    ) -> Result<(f64, Weights), PolicyTrainError> {
        match self {
            Self::Camera => {
                let rows = batch.iter().flat_map(|shown| proposals::state_of(shown.speed_mps, shown.sample.command));
                let state = Array::new(&[batch.len(), proposals::STATE], rows.collect());
                let targets: Vec<_> = batch.iter().map(Shown::target).collect();
                let speeds: Vec<f64> = batch.iter().map(|shown| shown.speed_mps).collect();
                let grade = |outputs: &Array| loss::grade(outputs, &targets, &speeds);
                Ok(planner::gradient(SIZE, weights, images, &state, grade)?)
            }
            Self::Panel(kind) => {
                let rows = batch.iter().flat_map(|shown| state_of(&shown.ego(), shown.sample.command));
                let state = Array::new(&[batch.len(), panel::STATE], rows.collect());
                let mut refused = None;
                let grade = |answer: &panel::Answer| match panel_loss::grade(answer, batch, judge) {
                    Ok(found) => found,
                    Err(error) => {
                        refused = Some(error);
                        (f64::NAN, answer.clone())
                    }
                };
                let found = panel::gradient(kind, weights, &Inputs { images, state: &state }, grade)?;
                refused.map_or(Ok(found), Err)
            }
        }
    }
}
