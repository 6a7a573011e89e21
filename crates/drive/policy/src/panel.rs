//! The policies of the panel: networks of different architectures over the same frame, state and plans.
//!
//! As the `camera` policy, each brings the newest frame of the forward camera to one known camera and answers with plans
//! of eight poses at 0.5 s, offsets from going straight on. A plan's score is what its scorer expects: NC · DAC · DDC ·
//! TLC · (5 TTC + 5 EP + 2 LK + 2 HC) / 14 of the predicted sub-scores; where a network only says how likely each plan is,
//! the logit of that; where it predicts the total itself, that; where it says both, their product, the likelihood being one of all plans; the one plan of a network
//! without either has score 1. Noise comes from the observation's draws.

use ds_graph::panel::{Answer, Inputs, Kind, Network, PLAN, STATE, Scoring, TERMS, expected, sigmoid};
use ds_nn::{Array, Weights};
use ds_raster::RgbImage;
use ds_space::{CameraModel, Draws};
use ds_world::RouteCommand;

use crate::camera::eye::Eye;
use crate::camera::proposals::{self, Candidate, TARGETS, knots_of};
use crate::error::PolicyError;
use crate::observation::{EgoView, Observation, PrivilegedView};
use crate::plan::PolicyAnswer;
use crate::{Context, Grid, Policy, Restart};

const _: () = assert!(PLAN == TARGETS, "networks and policies speak of the same plans");

/// Returns the state inputs of a network.
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "inputs are single precision")]
pub fn state_of(ego: &EgoView, command: RouteCommand) -> [f32; STATE] {
    let [speed, standing, straight, left, right] = proposals::state_of(ego.speed_mps, command);
    let acceleration = ego.acceleration_mps2 / 3.0;
    let turning = (ego.yaw_rate_radps / 0.5) as f32;
    [speed, standing, turning, acceleration.x as f32, acceleration.y as f32, straight, left, right]
}

/// Returns the noise that a network needs for one sample: normal numbers of the draws, from index `first` on.
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "inputs are single precision")]
pub fn noise_of(kind: Kind, draws: &Draws, first: u64) -> Vec<f32> {
    (0..kind.noise() as u64).map(|index| draws.normal(first + index) as f32).collect()
}

/// Drives by one network of the panel.
pub struct PanelPolicy {
    network: Network,
    eye: Eye,
}

impl PanelPolicy {
    /// Makes the policy of weights.
    ///
    /// # Errors
    /// If a weight is missing, surplus, not finite or has a wrong shape.
    pub fn new(kind: Kind, weights: &Weights) -> Result<Self, ds_nn::WeightsError> {
        Ok(Self { network: Network::new(kind, weights)?, eye: Eye::default() })
    }
}

impl Policy for PanelPolicy {
    fn name(&self) -> &str {
        self.network.kind().name()
    }

    fn privileged(&self) -> bool {
        false
    }

    fn plan(&mut self, observation: &Observation, _: Option<&PrivilegedView>) -> Result<PolicyAnswer, PolicyError> {
        observation.check()?;
        let images = self.eye.newest(observation)?;
        let state = Array::new(&[1, STATE], state_of(&observation.ego, observation.command).to_vec());
        let noise = noise_of(self.network.kind(), &observation.draw, 0);
        let noise = Array::new(&[1, noise.len()], noise);
        let answer =
            self.network.answer(&Inputs { images: &images, state: &state, noise: &noise, times: None, reversal: 0.0 });
        let plans = answer.plans.last().expect("every network has plans").values().chunks_exact(PLAN);
        let candidate =
            |(numbers, score): (&[f32], f64)| Candidate { knots: knots_of(observation.ego.speed_mps, numbers), score };
        let scores = scores(self.network.kind(), &answer);
        let candidates: Vec<Candidate> = plans.zip(scores).map(candidate).collect();
        proposals::answer(self.network.kind().name(), observation, &candidates)
    }

    fn context(&mut self, cameras: &[CameraModel], frames: &[RgbImage]) -> Result<Option<Context>, PolicyError> {
        let images = self.eye.images(cameras.iter().zip(frames))?;
        let context = self.network.context(&images);
        let shape = context.shape()[1..].to_vec();
        Ok(Some(Context { tokens: Array::new(&shape, context.into_values()), grid: grid(self.network.kind()) }))
    }

    fn restart(&self) -> Restart {
        Restart::Stateless
    }
}

/// Says what the tokens of a context are places of.
fn grid(kind: Kind) -> Option<Grid> {
    let of = match kind {
        Kind::Ltf | Kind::Diffusiondrive | Kind::DiffusiondriveV2 => Grid::Ground,
        Kind::Drivor | Kind::Sparsedrive | Kind::Rap => Grid::Picture,
    };
    kind.grid().map(of)
}

/// Returns the score of each plan of an answer of one sample.
fn scores(kind: Kind, answer: &Answer) -> Vec<f64> {
    let logits = |head: &Array| head.values().iter().map(|logit| f64::from(*logit)).collect::<Vec<f64>>();
    let totals = |head: &Array| head.values().chunks_exact(TERMS).map(expected).collect::<Vec<f64>>();
    match (kind.scoring(), answer.scores.as_slice()) {
        (Scoring::Terms | Scoring::FilteredTerms, [.., terms]) => totals(terms),
        (Scoring::Confidence, [.., confidence]) => logits(confidence),
        (Scoring::Total, [.., terms]) => terms.values().chunks_exact(TERMS).map(|logits| sigmoid(logits[0])).collect(),
        (Scoring::ConfidenceAndTerms, [.., confidence, terms]) => {
            let confidence = logits(confidence);
            let highest = confidence.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let likely: Vec<f64> = confidence.iter().map(|logit| (logit - highest).exp()).collect();
            let sum: f64 = likely.iter().sum();
            likely.iter().zip(totals(terms)).map(|(likely, total)| likely / sum * total).collect()
        }
        (_, _) => vec![1.0],
    }
}

#[cfg(test)]
mod tests;
