//! Training of the network that reads traffic lights: crops of softened frames, the states drawn alike often.

use std::path::Path;

use ds_graph::classifier;
use ds_nn::Array;
use ds_nn::safetensors::WeightsFile;
use ds_scenario::Family;
use ds_space::{DigestWriter, Draws};
use ds_world::LightState;
use serde_json::json;

use super::run::Run;
use super::{Progress, Recipe, mean_cross_entropy};
use crate::error::PerceptionError;
use crate::frames::{self, Labelled};
use crate::lights::{CROP_PX, LightReader, SHAPE, STATES, SeenLight, crop};
use crate::soften::softened;

/// Families whose junctions have lights.
pub const FAMILIES: [Family; 1] = [Family::SignalisedCrossing];

/// A read light: how far away, what it shows, what was read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Distance, in metres.
    pub distance_m: f64,
    /// What it shows.
    pub truth: LightState,
    /// What was read.
    pub read: LightState,
}

/// A trained network with what it read on frames that it has not seen.
pub struct Trained {
    /// The averaged weights with the recipe in the metadata.
    pub file: WeightsFile,
    /// On held-out frames, half of them softened.
    pub readings: Vec<Reading>,
}

/// Trains the network; checkpoints go to a work folder if there is one. The same recipe gives the same weights.
///
/// # Errors
/// If frames cannot be rendered, a file cannot be used or the loss is not finite.
pub fn train(recipe: &Recipe, work: Option<&Path>, progress: &mut dyn Progress) -> Result<Trained, PerceptionError> {
    let settings = json!([recipe.seed, recipe.width_px, recipe.height_px, recipe.frames, recipe.lights]);
    let key = DigestWriter::new().text("lights 1").text(&settings.to_string()).finish();
    let path = work.map(|folder| folder.join("lights.checkpoint.safetensors"));
    let mut run = Run::open(path, &key, recipe.lights.schedule(), &SHAPE.declare())?;
    if run.unfinished() {
        progress.note("rendering frames");
        let frames = frames::render(&recipe.training(&FAMILIES, recipe.lights.scenarios))?;
        let seen: Vec<(&Labelled, &SeenLight)> =
            frames.iter().flat_map(|frame| frame.lights.iter().map(move |light| (frame, light))).collect();
        progress.note(&format!("{} frames rendered, with {} lights", frames.len(), seen.len()));
        while run.unfinished() && !seen.is_empty() {
            let (mut values, mut states) = (Vec::new(), Vec::new());
            for slot in 0..recipe.lights.batch {
                let draws = Draws::new(&key, "lights batch", &[u64::from(run.step), slot]);
                let (frame, light) = seen[draws.below(1_000, seen.len() as u64) as usize];
                let mut light = *light;
                light.centre_px += 0.3 * ds_space::DVec2::new(draws.normal(1_001), draws.normal(1_002));
                values.extend(crop(&softened(&frame.image, &draws), recipe.width_px as usize, &light));
                states.push(STATES.iter().position(|state| *state == light.state).unwrap_or(0));
            }
            let images = Array::new(&[states.len(), CROP_PX, CROP_PX, 3], values);
            let grade = |scores: &Array| mean_cross_entropy(scores, &states);
            let (loss, gradient) = classifier::gradient(&SHAPE, &run.weights, &images, grade)?;
            run.update(loss, &gradient)?;
            progress.step(run.step, recipe.lights.steps, loss);
        }
    }
    let readings = held_out(recipe, &LightReader::new(&run.average)?)?;
    let metadata = super::metadata("lights", recipe);
    Ok(Trained { file: WeightsFile { weights: run.average, metadata }, readings })
}

/// Reads the lights of held-out frames, each as rendered and softened.
///
/// # Errors
/// If frames cannot be rendered.
pub fn held_out(recipe: &Recipe, reader: &LightReader) -> Result<Vec<Reading>, PerceptionError> {
    let frames = frames::render(&recipe.held_out(&FAMILIES))?;
    let mut readings = Vec::new();
    for (index, frame) in (0..).zip(&frames) {
        let sharp: Vec<f32> = frame.image.values().collect();
        let soft = softened(&frame.image, &Draws::from_seed(index, "held-out softness"));
        for values in [sharp, soft] {
            let crops: Vec<Vec<f32>> =
                frame.lights.iter().map(|light| crop(&values, recipe.width_px as usize, light)).collect();
            let read = reader.read(&crops);
            readings.extend(frame.lights.iter().zip(read).map(|(light, read)| Reading {
                distance_m: light.distance_m,
                truth: light.state,
                read,
            }));
        }
    }
    Ok(readings)
}
