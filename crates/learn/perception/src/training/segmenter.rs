//! Training of the segmenter on labelled frames of the reference camera, rare labels shown and counted more.
//!
//! A batch takes its frames in turn from those with many pixels of a pedestrian, a vehicle, a crosswalk, and from all.
//! The loss is weighted cross-entropy plus 1 − IoU of the rare labels, computed from the probabilities of the batch.
//! Paint under snow or sand counts in neither.

use std::path::Path;

use ds_graph::segmenter;
use ds_nn::Array;
use ds_nn::safetensors::WeightsFile;
use ds_raster::RgbImage;
use ds_scenario::Family;
use ds_space::{Digest, DigestWriter, Draws};
use serde_json::json;

use super::run::Run;
use super::{Progress, Recipe, cross_entropy, mirror};
use crate::error::PerceptionError;
use crate::frames::{self, Labelled};
use crate::label::Label;
use crate::overlap::Overlaps;
use crate::segmenter::Segmenter;
use crate::soften::softened;

/// How much a pixel of each label counts in the cross-entropy.
const LABEL_WEIGHTS: [f32; Label::COUNT] = [0.8, 2.0, 1.5, 2.5, 5.0, 0.8, 0.5];
/// Labels whose IoU is part of the loss.
const SMALL: [Label; 4] = [Label::Lane, Label::Crosswalk, Label::Vehicle, Label::Pedestrian];
/// Weight of their mean 1 − IoU.
const IOU_WEIGHT: f32 = 0.5;
/// Pixels of a label that make a frame one of it.
const MANY: [(Label, usize); 3] = [(Label::Pedestrian, 16), (Label::Vehicle, 60), (Label::Crosswalk, 60)];
/// A label index that counts nothing.
const IGNORED: u8 = u8::MAX;

/// A trained network with what it scored on frames that it has not seen.
pub struct Trained {
    /// The averaged weights with the recipe in the metadata.
    pub file: WeightsFile,
    /// On held-out frames as rendered.
    pub sharp: Overlaps,
    /// On the same frames, softened as in training.
    pub soft: Overlaps,
}

/// Trains the segmenter; checkpoints go to a work folder if there is one. The same recipe gives the same weights.
///
/// # Errors
/// If frames cannot be rendered, a file cannot be used or the loss is not finite.
pub fn train(recipe: &Recipe, work: Option<&Path>, progress: &mut dyn Progress) -> Result<Trained, PerceptionError> {
    let settings = json!([recipe.seed, recipe.width_px, recipe.height_px, recipe.frames, recipe.segmenter]);
    let key = DigestWriter::new().text("segmenter 2").text(&settings.to_string()).finish();
    let path = work.map(|folder| folder.join("segmenter.checkpoint.safetensors"));
    let mut run = Run::open(path, &key, recipe.segmenter.schedule(), &segmenter::declare(Label::COUNT))?;
    if run.unfinished() {
        progress.note("rendering frames");
        let frames = frames::render(&recipe.training(&Family::ALL, recipe.segmenter.scenarios))?;
        let shelves = Shelves::of(&frames);
        progress.note(&format!("{} frames rendered, {}", frames.len(), shelves.describe()));
        while run.unfinished() {
            let (images, labels) = batch(recipe, &frames, &shelves, run.step, &key);
            let grade = |scores: &Array| loss(scores, &labels);
            let (loss, gradient) = segmenter::gradient(Label::COUNT, &run.weights, &images, grade)?;
            run.update(loss, &gradient)?;
            progress.step(run.step, recipe.segmenter.steps, loss);
        }
    }
    let (sharp, soft) = held_out(recipe, &Segmenter::new(&run.average)?)?;
    let metadata = super::metadata("segmenter", recipe);
    Ok(Trained { file: WeightsFile { weights: run.average, metadata }, sharp, soft })
}

/// Measures a segmenter on held-out frames: as rendered, and softened.
///
/// # Errors
/// If frames cannot be rendered.
pub fn held_out(recipe: &Recipe, segmenter: &Segmenter) -> Result<(Overlaps, Overlaps), PerceptionError> {
    let (mut sharp, mut soft) = (Overlaps::default(), Overlaps::default());
    let frames = frames::render(&recipe.held_out(&Family::ALL))?;
    for (index, frame) in (0..).zip(&frames) {
        if covered(frame) {
            continue;
        }
        sharp.add(&frame.labels, &segmenter.labels(&frame.image));
        let (width, height) = (frame.image.width_px(), frame.image.height_px());
        let values = softened(&frame.image, &Draws::from_seed(index, "held-out softness"));
        soft.add(&frame.labels, &segmenter.labels(&RgbImage::of_values(&values, width, height)));
    }
    Ok((sharp, soft))
}

/// Says whether something lies on the road that hides its paint.
fn covered(frame: &Labelled) -> bool {
    frame.look.cover > 0.0 && frame.look.wetness <= 0.0
}

/// Indices of frames with many pixels of a rare label.
struct Shelves(Vec<Vec<usize>>);

impl Shelves {
    fn of(frames: &[Labelled]) -> Self {
        let shelf = |(label, least): (Label, usize)| {
            let many = |frame: &Labelled| frame.labels.iter().filter(|found| **found == label).count() >= least;
            (0..frames.len()).filter(|index| many(&frames[*index])).collect()
        };
        let all = (0..frames.len()).collect();
        Self(MANY.into_iter().map(shelf).chain([all]).filter(|shelf: &Vec<usize>| !shelf.is_empty()).collect())
    }

    fn draw(&self, slot: u64, draws: &Draws) -> usize {
        let shelf = &self.0[(slot % self.0.len() as u64) as usize];
        shelf[draws.below(1_000, shelf.len() as u64) as usize]
    }

    fn describe(&self) -> String {
        let counts: Vec<String> = self.0.iter().map(|shelf| shelf.len().to_string()).collect();
        format!("{} of them with rare labels or any", counts.join(", "))
    }
}

/// Draws a batch: images [N, H, W, 3] and the index of the label of every pixel.
fn batch(recipe: &Recipe, frames: &[Labelled], shelves: &Shelves, step: u32, key: &Digest) -> (Array, Vec<u8>) {
    let (width, height) = (recipe.width_px as usize, recipe.height_px as usize);
    let (mut values, mut labels) = (Vec::new(), Vec::new());
    for slot in 0..recipe.segmenter.batch {
        let draws = Draws::new(key, "segmenter batch", &[u64::from(step), slot]);
        let frame = &frames[shelves.draw(slot, &draws)];
        let hidden = covered(frame);
        let index = |label: &Label| match label {
            Label::Lane | Label::Crosswalk if hidden => IGNORED,
            label => *label as u8,
        };
        let (mut image, mut found): (_, Vec<u8>) =
            (softened(&frame.image, &draws), frame.labels.iter().map(index).collect());
        if draws.uniform(1_001) < 0.5 {
            mirror(&mut image, width * 3, 3);
            mirror(&mut found, width, 1);
        }
        values.extend(image);
        labels.extend(found);
    }
    (Array::new(&[recipe.segmenter.batch as usize, height, width, 3], values), labels)
}

/// Returns the loss and its gradient by the scores.
fn loss(scores: &Array, labels: &[u8]) -> (f64, Array) {
    let counted = |label: &&u8| **label != IGNORED;
    let total: f32 = labels.iter().filter(counted).map(|label| LABEL_WEIGHTS[usize::from(*label)]).sum();
    let mut probabilities = scores.clone();
    let mut gradient = Array::zeros(scores.shape());
    let mut loss = 0.0;
    let mut sums = [[0.0f64; 3]; SMALL.len()];
    let rows = probabilities.values_mut().chunks_exact_mut(Label::COUNT);
    for ((row, by_score), label) in rows.zip(gradient.values_mut().chunks_exact_mut(Label::COUNT)).zip(labels) {
        if *label == IGNORED {
            row.fill(0.0);
            continue;
        }
        let label = usize::from(*label);
        let weight = LABEL_WEIGHTS[label] / total;
        by_score.copy_from_slice(row);
        loss += cross_entropy(by_score, label, weight);
        row.iter_mut().zip(by_score.iter()).for_each(|(p, g)| *p = g / weight);
        row[label] += 1.0;
        for (sum, small) in sums.iter_mut().zip(SMALL) {
            let (p, y) = (f64::from(row[small as usize]), f64::from(u8::from(small as usize == label)));
            sum[0] += p * y;
            sum[1] += p + y - p * y;
            sum[2] += y;
        }
    }
    for (small, [both, either, present]) in SMALL.into_iter().zip(sums) {
        if present == 0.0 {
            continue;
        }
        let share = f64::from(IOU_WEIGHT) / SMALL.len() as f64;
        loss += share * (1.0 - both / either);
        let rows = probabilities.values().chunks_exact(Label::COUNT);
        for ((row, by_score), label) in rows.zip(gradient.values_mut().chunks_exact_mut(Label::COUNT)).zip(labels) {
            if *label == IGNORED {
                continue;
            }
            let y = usize::from(*label) == small as usize;
            let slope = if y { -1.0 / either } else { both / (either * either) };
            let p = row[small as usize];
            #[expect(clippy::cast_possible_truncation, reason = "gradients are single precision")]
            let scaled = (share * slope) as f32 * p;
            by_score.iter_mut().zip(row).for_each(|(g, other)| *g -= scaled * other);
            by_score[small as usize] += scaled;
        }
    }
    (loss, gradient)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_loss_has_the_slope_that_it_says() {
        let draws = Draws::from_seed(1, "loss");
        #[expect(clippy::cast_possible_truncation, reason = "scores are single precision")]
        let values = (0..12 * Label::COUNT as u64).map(|i| draws.normal(i) as f32).collect();
        let scores = Array::new(&[1, 3, 4, Label::COUNT], values);
        let labels = [0, 1, 2, 3, 4, 5, 6, 3, 3, 1, IGNORED, 4];
        let (_, gradient) = loss(&scores, &labels);
        for index in 0..scores.values().len() {
            let moved = |by: f32| {
                let mut moved = scores.clone();
                moved.values_mut()[index] += by;
                loss(&moved, &labels).0
            };
            let slope = (moved(1e-2) - moved(-1e-2)) / 2e-2;
            assert!((slope - f64::from(gradient.values()[index])).abs() < 1e-3, "{index}: {slope}");
        }
        assert!(gradient.values()[10 * Label::COUNT..11 * Label::COUNT].iter().all(|value| *value == 0.0));
    }

    #[test]
    fn right_scores_cost_nothing() {
        let labels = [0, 1, 2, 3, 4, 5, 6];
        let mut scores = Array::zeros(&[1, 1, 7, Label::COUNT]);
        for (pixel, label) in labels.iter().enumerate() {
            scores.values_mut()[pixel * Label::COUNT + usize::from(*label)] = 40.0;
        }
        assert!(loss(&scores, &labels).0 < 1e-6);
    }
}
