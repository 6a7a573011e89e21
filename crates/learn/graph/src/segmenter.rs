//! The network that names what each pixel shows: one image to a score per pixel and class.
//!
//! A pyramid in channels-last order: squares of 2×2 pixels are folded four times, each level adds a 3×3 convolution,
//! and the coarser levels are unfolded onto the finer ones. A head at full size sees the image once more beside the
//! finest level, so that edges and thin lines stay where they are. All layers are matrix products. It knows no place
//! in the image. The loss lives with the caller, who is shown the scores and answers with their gradient.

use burn::tensor::{Tensor, activation::relu};
use ds_nn::array::{Array, Declared, Weights, WeightsError};

use crate::graph::{Graph, Mode, array_of, fold, unfold};

/// Both sides of an image must be multiples of this, in pixels.
pub const SIDE_PX: usize = 16;

const WIDTHS: [usize; 4] = [24, 48, 96, 96];
/// Channels of the head at full size, the image's own three not counted.
const HEAD: usize = 12;

/// Lists the weights of a network for a number of classes.
#[must_use]
pub fn declare(classes: usize) -> Vec<Declared> {
    let relu_gain = std::f32::consts::SQRT_2;
    let mut list = Vec::new();
    let mut inputs = 3;
    for (level, width) in WIDTHS.into_iter().enumerate() {
        Declared::linear(&mut list, &format!("level{level}.fold"), 4 * inputs, width, relu_gain);
        Declared::linear(&mut list, &format!("level{level}.convolution"), 9 * width, width, 1.0);
        inputs = width;
    }
    for level in (0..WIDTHS.len() - 1).rev() {
        Declared::linear(&mut list, &format!("level{level}.unfold"), WIDTHS[level + 1], 4 * WIDTHS[level], 1.0);
        Declared::linear(&mut list, &format!("level{level}.detail"), 9 * WIDTHS[level], WIDTHS[level], 1.0);
    }
    Declared::linear(&mut list, "head.unfold", WIDTHS[0], 4 * HEAD, 1.0);
    Declared::linear(&mut list, "head.convolution", 9 * (HEAD + 3), HEAD, relu_gain);
    Declared::linear(&mut list, "scores", HEAD, classes, 0.5);
    list
}

/// The network with checked weights, ready to answer.
pub struct Segmenter {
    graph: Graph,
}

impl Segmenter {
    /// Checks the weights and puts them on the device.
    ///
    /// # Errors
    /// [`WeightsError`] names the first weight that does not fit.
    pub fn new(classes: usize, weights: &Weights) -> Result<Self, WeightsError> {
        weights.check(&declare(classes))?;
        Ok(Self { graph: Graph::new(weights, Mode::Infer) })
    }

    /// Scores a batch: images [N, H, W, 3] of −1 to 1 to scores [N, H, W, classes].
    ///
    /// # Panics
    /// If a side is no multiple of [`SIDE_PX`].
    #[must_use]
    pub fn scores(&self, images: &Array) -> Array {
        array_of(forward(&self.graph, images))
    }
}

/// Returns a loss and the gradient of every weight; `grade` is shown the scores and returns the loss and its gradient
/// by the scores.
///
/// # Errors
/// [`WeightsError`] names the first weight that does not fit.
///
/// # Panics
/// If a side is no multiple of [`SIDE_PX`].
pub fn gradient(
    classes: usize,
    weights: &Weights,
    images: &Array,
    grade: impl FnOnce(&Array) -> (f64, Array),
) -> Result<(f64, Weights), WeightsError> {
    weights.check(&declare(classes))?;
    let graph = Graph::new(weights, Mode::Train);
    let scores = forward(&graph, images);
    let (loss, by_scores) = grade(&array_of(scores.clone()));
    let surrogate = (scores * graph.tensor::<4>(&by_scores)).sum();
    Ok((loss, graph.gradients(surrogate.backward())))
}

fn forward(graph: &Graph, images: &Array) -> Tensor<4> {
    let sides = &images.shape()[1..3];
    assert!(sides.iter().all(|side| side.is_multiple_of(SIDE_PX)), "sides {sides:?} are no multiples of {SIDE_PX}");
    let convolved = |name: &str, x: Tensor<4>| x.clone() + relu(graph.linear(name).convolve(x));
    let images = graph.tensor::<4>(images);
    let mut levels: Vec<Tensor<4>> = Vec::new();
    let mut x = images.clone();
    for level in 0..WIDTHS.len() {
        x = relu(graph.linear(&format!("level{level}.fold")).apply(fold(x, 2)));
        x = convolved(&format!("level{level}.convolution"), x);
        levels.push(x.clone());
    }
    for level in (0..WIDTHS.len() - 1).rev() {
        let coarser = graph.linear(&format!("level{level}.unfold")).apply(x);
        x = relu(levels[level].clone() + unfold(coarser, 2));
        x = convolved(&format!("level{level}.detail"), x);
    }
    let x = unfold(graph.linear("head.unfold").apply(x), 2);
    let x = relu(graph.linear("head.convolution").convolve(Tensor::cat(vec![x, images], 3)));
    graph.linear("scores").apply(x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ds_space::{Digest, Draws};

    const CLASSES: usize = 6;

    fn noise(shape: &[usize], seed: u64) -> Array {
        let draws = Draws::from_seed(seed, "segmenter test");
        #[expect(clippy::cast_possible_truncation, reason = "inputs are single precision")]
        let values = (0..shape.iter().product::<usize>() as u64).map(|i| draws.normal(i) as f32).collect();
        Array::new(shape, values)
    }

    fn weights() -> Weights {
        Weights::initialised(&declare(CLASSES), &Digest::of(b"segmenter"))
    }

    #[test]
    fn the_network_stays_small() {
        assert!(weights().parameters() <= 500_000, "{}", weights().parameters());
    }

    #[test]
    fn every_pixel_has_a_score_per_class_whatever_the_batch() {
        let network = Segmenter::new(CLASSES, &weights()).expect("the weights fit");
        let pair = noise(&[2, 16, 32, 3], 1);
        let both = network.scores(&pair);
        assert_eq!(both.shape(), [2, 16, 32, CLASSES]);
        let half = pair.values().len() / 2;
        let second = network.scores(&Array::new(&[1, 16, 32, 3], pair.values()[half..].to_vec()));
        let expected = &both.values()[both.values().len() / 2..];
        let apart = second.values().iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(apart < 1e-4, "{apart}");
    }

    #[test]
    fn a_pixel_far_away_changes_nothing() {
        let network = Segmenter::new(CLASSES, &weights()).expect("the weights fit");
        let image = noise(&[1, 16, 320, 3], 2);
        let mut other = image.clone();
        other.values_mut()[0] += 3.0;
        let (a, b) = (network.scores(&image), network.scores(&other));
        let at = |column: usize| column * CLASSES..(column + 1) * CLASSES;
        assert_ne!(a.values()[at(0)], b.values()[at(0)]);
        assert_eq!(a.values()[at(319)], b.values()[at(319)]);
    }

    #[test]
    fn the_gradient_is_the_slope_of_the_loss() {
        let (weights, images) = (weights(), noise(&[1, 16, 16, 3], 3));
        let square = |scores: &Array| {
            let loss = scores.values().iter().map(|v| 0.5 * f64::from(*v).powi(2)).sum();
            (loss, scores.clone())
        };
        let (loss, gradient) = gradient(CLASSES, &weights, &images, square).expect("the weights fit");
        for name in [
            "scores.weight",
            "level0.fold.weight",
            "level3.convolution.weight",
            "level1.unfold.bias",
            "head.convolution.weight",
        ] {
            let slope = gradient.get(name).expect("every weight has a gradient").clone();
            let norm2: f64 = slope.values().iter().map(|v| f64::from(*v).powi(2)).sum();
            let step = 1e-3 * loss / norm2.max(1e-12);
            let mut moved = weights.clone();
            let (_, array) = moved.iter_mut().find(|(found, _)| *found == name).expect("the weight exists");
            #[expect(clippy::cast_possible_truncation, reason = "weights are single precision")]
            array.values_mut().iter_mut().zip(slope.values()).for_each(|(w, g)| *w -= step as f32 * g);
            let scores = Segmenter::new(CLASSES, &moved).expect("the weights fit").scores(&images);
            let fell = (loss - square(&scores).0) / (step * norm2);
            assert!((fell - 1.0).abs() < 0.1, "{name}: the loss fell by {fell} of what its slope says");
        }
    }

    #[test]
    fn weights_that_do_not_fit_are_named() {
        let mut weights = weights();
        weights.insert("level0.detail.bias", Array::zeros(&[7]));
        let error = Segmenter::new(CLASSES, &weights).err().expect("the shape is wrong").to_string();
        assert!(error.contains("level0.detail.bias") && error.contains("[7]"), "{error}");
    }
}
