//! The recipes of the networks and what their trainings share: settings, batches, a run that can stop at any step.
//!
//! Everything is a function of the recipe: draws are keyed by its seed and the step, so that an interrupted training
//! ends with the weights of an uninterrupted one.

pub mod lights;
pub mod look;
mod run;
pub mod segmenter;

use std::collections::BTreeMap;

use ds_nn::Array;
use ds_nn::optimiser::{Schedule, Shape};
use ds_scenario::Family;
use serde::{Deserialize, Serialize};

use crate::error::PerceptionError;
use crate::frames::{FIRST_HELD_OUT_SEED, FIRST_TRAINING_SEED, Looks, Take};

/// Hears how a training goes on.
pub trait Progress {
    /// A step was made: its number (from 1), how many there are, and the loss.
    fn step(&mut self, step: u32, total: u32, loss: f64);
    /// Something worth a line happened.
    fn note(&mut self, text: &str);
}

/// Says nothing.
pub struct Silent;

impl Progress for Silent {
    fn step(&mut self, _step: u32, _total: u32, _loss: f64) {}
    fn note(&mut self, _text: &str) {}
}

/// The recipes of all networks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Schema version, 2.
    pub version: u32,
    /// Keys all draws.
    pub seed: u64,
    /// Width of the frames, in pixels.
    pub width_px: u32,
    /// Height of the frames, in pixels.
    pub height_px: u32,
    /// Scenarios to measure on; the families take turns.
    pub held_out_scenarios: u64,
    /// Frames of a scenario.
    pub frames: u64,
    /// The network that names pixels.
    pub segmenter: NetworkRecipe,
    /// The network that reads traffic lights.
    pub lights: NetworkRecipe,
    /// The network that says what a frame looks like.
    pub look: NetworkRecipe,
}

/// The recipe of one network.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NetworkRecipe {
    /// Scenarios to train on; the families take turns.
    pub scenarios: u64,
    /// Updates.
    pub steps: u32,
    /// Images of a batch.
    pub batch: u64,
    /// Highest learning rate.
    pub learning_rate: f32,
    /// Updates until the highest rate.
    pub warm_up: u32,
}

impl NetworkRecipe {
    pub(crate) fn schedule(&self) -> Schedule {
        Schedule { peak: self.learning_rate, warm_up: self.warm_up, total: self.steps, shape: Shape::Cosine }
    }
}

impl Recipe {
    /// Reads and checks a recipe.
    ///
    /// # Errors
    /// If a key is unknown or a value is out of bounds.
    pub fn parse(text: &str) -> Result<Self, PerceptionError> {
        let recipe: Self = toml::from_str(text)?;
        let refuse = |field, rule| Err(PerceptionError::Recipe { field, rule });
        if recipe.version != 2 {
            return refuse("version", "must be 2");
        }
        let side = |px: u32| (16..=2_048).contains(&px) && px.is_multiple_of(ds_graph::segmenter::SIDE_PX as u32);
        if !side(recipe.width_px) {
            return refuse("width_px", "must be a multiple of 16 from 16 to 2048");
        }
        if !side(recipe.height_px) {
            return refuse("height_px", "must be a multiple of 16 from 16 to 2048");
        }
        let count = |count: u64| (1..=100_000).contains(&count);
        if !count(recipe.held_out_scenarios) || !count(recipe.frames) {
            return refuse("frames", "frames and held_out_scenarios must be 1 to 100000");
        }
        for (field, network) in [("segmenter", &recipe.segmenter), ("lights", &recipe.lights), ("look", &recipe.look)] {
            if !count(network.scenarios) || !count(network.batch) || network.steps == 0 {
                return refuse(field, "scenarios and batch must be 1 to 100000, steps at least 1");
            }
            if !(network.learning_rate > 0.0 && network.learning_rate < 1.0) {
                return refuse(field, "learning_rate must lie within (0, 1)");
            }
        }
        Ok(recipe)
    }

    pub(crate) fn training(&self, families: &[Family], scenarios: u64) -> Take {
        let size_px = (self.width_px, self.height_px);
        Take {
            families: families.to_vec(),
            first_seed: FIRST_TRAINING_SEED,
            scenarios,
            frames: self.frames,
            size_px,
            looks: Looks::Mixed,
        }
    }

    pub(crate) fn held_out(&self, families: &[Family]) -> Take {
        Take { first_seed: FIRST_HELD_OUT_SEED, ..self.training(families, self.held_out_scenarios) }
    }
}

/// Returns what a weights file says about how it was made.
pub(crate) fn metadata(network: &str, recipe: &Recipe) -> BTreeMap<String, String> {
    let note = |key: &str, value: String| (key.to_owned(), value);
    let command = format!(
        "cargo run -p ds-perception --example train-perception -- {network} --config configs/train/perception.toml"
    );
    BTreeMap::from([
        note("command", command),
        note("settings", format!("{:#}", serde_json::json!(recipe))),
        note("licence", "Apache-2.0".to_owned()),
    ])
}

/// Adds −log softmax at the true class of one row of scores, times a weight; the row becomes the gradient.
pub(crate) fn cross_entropy(row: &mut [f32], class: usize, weight: f32) -> f64 {
    let top = row.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    row.iter_mut().for_each(|value| *value = (*value - top).exp());
    let sum: f32 = row.iter().sum();
    let loss = -f64::from(weight) * f64::from((row[class] / sum).max(1e-12).ln());
    row.iter_mut().for_each(|value| *value *= weight / sum);
    row[class] -= weight;
    loss
}

/// Returns the mean of −log softmax at the true class over rows, and its gradient by the scores.
pub(crate) fn mean_cross_entropy(scores: &Array, classes: &[usize]) -> (f64, Array) {
    let mut gradient = scores.clone();
    let width = scores.values().len() / classes.len();
    let weight = 1.0 / classes.len() as f32;
    let rows = gradient.values_mut().chunks_exact_mut(width).zip(classes);
    let loss = rows.map(|(row, class)| cross_entropy(row, *class, weight)).sum();
    (loss, gradient)
}

/// Reverses the pixels of each row.
pub(crate) fn mirror<T: Copy>(values: &mut [T], row: usize, per_pixel: usize) {
    for row in values.chunks_exact_mut(row) {
        row.reverse();
        row.chunks_exact_mut(per_pixel).for_each(<[T]>::reverse);
    }
}

#[cfg(test)]
mod tests;
