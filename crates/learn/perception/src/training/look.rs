//! Training of the network that says what a frame looks like, on frames of drawn conditions.
//!
//! Tasks, alike in weight: the value on each axis, how much the frame was softened, the labels in each cell. Snow and sand
//! hide nothing here: the truth is the condition that was rendered.

use std::path::Path;

use ds_graph::classifier;
use ds_nn::Array;
use ds_nn::safetensors::WeightsFile;
use ds_raster::RgbImage;
use ds_scenario::Family;
use ds_space::{DigestWriter, Draws};
use serde_json::json;

use super::run::Run;
use super::{Progress, Recipe, cross_entropy, mirror};
use crate::error::PerceptionError;
use crate::frames::{self, Labelled, Looks};
use crate::label::Label;
use crate::look::{AXES, CELLS, LookReader, SHAPE, SIZE_PX, SOFTNESS, indices, shares};
use crate::soften::softened;

/// Weight of the labels of all cells together, that of an axis being 1.
const CELLS_WEIGHT: f32 = 1.0;

/// A trained network with the shares of held-out frames whose value on each axis it names.
pub struct Trained {
    /// The averaged weights with the recipe in the metadata.
    pub file: WeightsFile,
    /// On frames as rendered: lighting, weather, road surface.
    pub sharp: [f64; 3],
    /// On the same frames, softened as in training.
    pub soft: [f64; 3],
}

/// What the network is to say of an image.
struct Task {
    axes: [usize; 3],
    softness: usize,
    shares: Vec<f32>,
}

/// Trains the network; checkpoints go to a work folder if there is one. The same recipe gives the same weights.
///
/// # Errors
/// If frames cannot be rendered, a file cannot be used or the loss is not finite.
pub fn train(recipe: &Recipe, work: Option<&Path>, progress: &mut dyn Progress) -> Result<Trained, PerceptionError> {
    let settings = json!([recipe.seed, recipe.frames, recipe.look]);
    let key = DigestWriter::new().text("look 1").text(&settings.to_string()).finish();
    let path = work.map(|folder| folder.join("look.checkpoint.safetensors"));
    let mut run = Run::open(path, &key, recipe.look.schedule(), &SHAPE.declare())?;
    if run.unfinished() {
        progress.note("rendering frames");
        let take = recipe.training(&Family::ALL, recipe.look.scenarios);
        let frames = frames::render(&frames::Take { looks: Looks::Conditions, size_px: SIZE_PX, ..take })?;
        progress.note(&format!("{} frames rendered", frames.len()));
        while run.unfinished() {
            let (mut values, mut tasks) = (Vec::new(), Vec::new());
            for slot in 0..recipe.look.batch {
                let draws = Draws::new(&key, "look batch", &[u64::from(run.step), slot]);
                let frame = &frames[draws.below(1_000, frames.len() as u64) as usize];
                let (image, task) = example(frame, &draws);
                values.extend(image);
                tasks.push(task);
            }
            let images = Array::new(&[tasks.len(), SIZE_PX.1 as usize, SIZE_PX.0 as usize, 3], values);
            let (loss, gradient) =
                classifier::gradient(&SHAPE, &run.weights, &images, |scores: &Array| loss(scores, &tasks))?;
            run.update(loss, &gradient)?;
            progress.step(run.step, recipe.look.steps, loss);
        }
    }
    let (sharp, soft) = held_out(recipe, &LookReader::new(&run.average)?)?;
    let metadata = super::metadata("look", recipe);
    Ok(Trained { file: WeightsFile { weights: run.average, metadata }, sharp, soft })
}

/// Returns the share of held-out frames whose value is named on each axis: as rendered, and softened.
///
/// # Errors
/// If frames cannot be rendered.
pub fn held_out(recipe: &Recipe, reader: &LookReader) -> Result<([f64; 3], [f64; 3]), PerceptionError> {
    let take = frames::Take { looks: Looks::Conditions, size_px: SIZE_PX, ..recipe.held_out(&Family::ALL) };
    let frames = frames::render(&take)?;
    let (mut sharp, mut soft) = ([0.0; 3], [0.0; 3]);
    for (index, frame) in (0..).zip(&frames) {
        let truth = truth(frame);
        let values = softened(&frame.image, &Draws::from_seed(index, "held-out softness"));
        let image = RgbImage::of_values(&values, SIZE_PX.0, SIZE_PX.1);
        for (right, image) in [(&mut sharp, &frame.image), (&mut soft, &image)] {
            let look = reader.read(image);
            for (axis, right) in right.iter_mut().enumerate() {
                *right += f64::from(u8::from(look.likeliest(axis) == truth[axis])) / frames.len() as f64;
            }
        }
    }
    Ok((sharp, soft))
}

fn truth(frame: &Labelled) -> [usize; 3] {
    indices(frame.look.condition.unwrap_or(ds_camera::Condition::DAY))
}

/// Draws how soft a frame is shown, mirrored or not.
fn example(frame: &Labelled, draws: &Draws) -> (Vec<f32>, Task) {
    let (width, softness) = (SIZE_PX.0 as usize, draws.below(1_001, SOFTNESS as u64));
    let mut labels = frame.labels.clone();
    let mut image = match softness {
        0 => frame.image.values().collect(),
        1 => softened(&frame.image, draws),
        _ => {
            let once = RgbImage::of_values(&softened(&frame.image, draws), SIZE_PX.0, SIZE_PX.1);
            softened(&once, &Draws::from_seed(draws.u64(1_002), "softened twice"))
        }
    };
    if draws.uniform(1_003) < 0.5 {
        mirror(&mut image, width * 3, 3);
        mirror(&mut labels, width, 1);
    }
    (image, Task { axes: truth(frame), softness: softness as usize, shares: shares(&labels, width) })
}

/// Returns the mean loss over images, and its gradient by the scores.
fn loss(scores: &Array, tasks: &[Task]) -> (f64, Array) {
    let mut gradient = scores.clone();
    let weight = 1.0 / tasks.len() as f32;
    let mut loss = 0.0;
    for (row, task) in gradient.values_mut().chunks_exact_mut(SHAPE.scores).zip(tasks) {
        let (axes, rest) = row.split_at_mut(AXES.iter().sum());
        let (softness, cells) = rest.split_at_mut(SOFTNESS);
        let mut from = 0;
        for (count, class) in AXES.into_iter().zip(task.axes) {
            loss += cross_entropy(&mut axes[from..from + count], class, weight);
            from += count;
        }
        loss += cross_entropy(softness, task.softness, weight);
        let weight = weight * CELLS_WEIGHT / (CELLS[0] * CELLS[1]) as f32;
        let pairs = cells.chunks_exact_mut(Label::COUNT).zip(task.shares.chunks_exact(Label::COUNT));
        for (row, shares) in pairs {
            loss += against_shares(row, shares, weight);
        }
    }
    (loss, gradient)
}

/// Adds the cross-entropy of one row of scores against shares, times a weight; the row becomes the gradient.
fn against_shares(row: &mut [f32], shares: &[f32], weight: f32) -> f64 {
    let top = row.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    row.iter_mut().for_each(|value| *value = (*value - top).exp());
    let sum: f32 = row.iter().sum();
    let mut loss = 0.0;
    for (value, share) in row.iter_mut().zip(shares) {
        let p = *value / sum;
        loss -= f64::from(weight * share) * f64::from(p.max(1e-12).ln());
        *value = weight * (p - share);
    }
    loss
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_loss_has_the_slope_that_it_says() {
        let draws = Draws::from_seed(1, "look loss");
        #[expect(clippy::cast_possible_truncation, reason = "scores are single precision")]
        let values = (0..2 * SHAPE.scores as u64).map(|i| draws.normal(i) as f32).collect();
        let scores = Array::new(&[2, SHAPE.scores], values);
        let task = |axes, softness, label| Task { axes, softness, shares: shares(&[label; 12], 6) };
        let tasks = [task([0, 4, 3], 0, Label::Road), task([6, 0, 1], 2, Label::Sky)];
        let (_, gradient) = loss(&scores, &tasks);
        for index in 0..scores.values().len() {
            let moved = |by: f32| {
                let mut moved = scores.clone();
                moved.values_mut()[index] += by;
                loss(&moved, &tasks).0
            };
            let slope = (moved(1e-2) - moved(-1e-2)) / 2e-2;
            assert!((slope - f64::from(gradient.values()[index])).abs() < 1e-3, "{index}: {slope}");
        }
    }
}
