//! The network that says what a whole image shows: one image to a vector of features, and to scores read from them.
//!
//! Squares of 2×2 pixels are folded level by level, each level adds a 3×3 convolution. Of the last level the mean and
//! the spread of every channel are taken in bands of rows, so that sky and ground stay apart; a hidden layer makes the
//! features of them, a linear one the scores. The loss lives with the caller, who is shown the scores and answers with
//! their gradient.

use burn::tensor::{Tensor, activation::relu};
use ds_nn::array::{Array, Declared, Weights, WeightsError};

use crate::graph::{Graph, Mode, array_of, fold};

/// Added to a variance, so that its root has a slope at zero.
const LEAST_VARIANCE: f32 = 1e-4;

/// The sizes that a caller chooses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ClassifierShape {
    /// Channels of each level.
    pub widths: &'static [usize],
    /// Bands of rows of the last level; its number of rows must be a multiple.
    pub bands: usize,
    /// Features.
    pub features: usize,
    /// Scores.
    pub scores: usize,
}

impl ClassifierShape {
    /// Returns of what both sides of an image must be multiples, in pixels; the height also of this times the bands.
    #[must_use]
    pub fn side_px(&self) -> usize {
        1 << self.widths.len()
    }

    /// Lists the weights.
    #[must_use]
    pub fn declare(&self) -> Vec<Declared> {
        let relu_gain = std::f32::consts::SQRT_2;
        let mut list = Vec::new();
        let mut inputs = 3;
        for (level, width) in self.widths.iter().enumerate() {
            Declared::linear(&mut list, &format!("level{level}.fold"), 4 * inputs, *width, relu_gain);
            Declared::linear(&mut list, &format!("level{level}.convolution"), 9 * width, *width, 1.0);
            inputs = *width;
        }
        Declared::linear(&mut list, "features", 2 * self.bands * inputs, self.features, relu_gain);
        Declared::linear(&mut list, "scores", self.features, self.scores, 0.5);
        list
    }
}

/// Features and scores of a batch of images.
#[derive(Debug, Clone, PartialEq)]
pub struct Answer {
    /// Features [N, features], none below zero.
    pub features: Array,
    /// Scores [N, scores].
    pub scores: Array,
}

/// The network with checked weights, ready to answer.
pub struct Classifier {
    graph: Graph,
    shape: ClassifierShape,
}

impl Classifier {
    /// Checks the weights and puts them on the device.
    ///
    /// # Errors
    /// [`WeightsError`] names the first weight that does not fit.
    pub fn new(shape: ClassifierShape, weights: &Weights) -> Result<Self, WeightsError> {
        weights.check(&shape.declare())?;
        Ok(Self { graph: Graph::new(weights, Mode::Infer), shape })
    }

    /// Answers for a batch of images [N, H, W, 3] of −1 to 1.
    ///
    /// # Panics
    /// If a side does not fit the shape.
    #[must_use]
    pub fn answer(&self, images: &Array) -> Answer {
        let (features, scores) = forward(&self.graph, &self.shape, images);
        Answer { features: array_of(features), scores: array_of(scores) }
    }

    /// Returns what each level makes of a batch of images, [N, h, w, channels] per level.
    ///
    /// # Panics
    /// If a side does not fit the shape.
    #[must_use]
    pub fn levels(&self, images: &Array) -> Vec<Array> {
        levels(&self.graph, &self.shape, images).into_iter().map(array_of).collect()
    }
}

/// Returns a loss and the gradient of every weight; `grade` is shown the scores and returns the loss and its gradient
/// by the scores.
///
/// # Errors
/// [`WeightsError`] names the first weight that does not fit.
///
/// # Panics
/// If a side of the images does not fit the shape.
pub fn gradient(
    shape: &ClassifierShape,
    weights: &Weights,
    images: &Array,
    grade: impl FnOnce(&Array) -> (f64, Array),
) -> Result<(f64, Weights), WeightsError> {
    weights.check(&shape.declare())?;
    let graph = Graph::new(weights, Mode::Train);
    let (_, scores) = forward(&graph, shape, images);
    let (loss, by_scores) = grade(&array_of(scores.clone()));
    let surrogate = (scores * graph.tensor::<2>(&by_scores)).sum();
    Ok((loss, graph.gradients(surrogate.backward())))
}

fn levels(graph: &Graph, shape: &ClassifierShape, images: &Array) -> Vec<Tensor<4>> {
    let [height, width] = [images.shape()[1], images.shape()[2]];
    let fits = width.is_multiple_of(shape.side_px()) && height.is_multiple_of(shape.side_px() * shape.bands);
    assert!(fits, "{width}x{height} does not fit {shape:?}");
    let mut x = graph.tensor::<4>(images);
    let mut levels = Vec::new();
    for level in 0..shape.widths.len() {
        x = relu(graph.linear(&format!("level{level}.fold")).apply(fold(x, 2)));
        x = x.clone() + relu(graph.linear(&format!("level{level}.convolution")).convolve(x));
        levels.push(x.clone());
    }
    levels
}

fn forward(graph: &Graph, shape: &ClassifierShape, images: &Array) -> (Tensor<2>, Tensor<2>) {
    let x = levels(graph, shape, images).pop().expect("a shape has levels");
    let [n, h, w, c] = x.dims();
    let bands = x.reshape([n * shape.bands, h / shape.bands * w, c]);
    let mean = bands.clone().mean_dim(1);
    let spread = ((bands - mean.clone()).powi_scalar(2).mean_dim(1) + LEAST_VARIANCE).sqrt();
    let pooled = Tensor::cat(vec![mean, spread], 2).reshape([n, shape.bands * 2 * c]);
    let features = relu(graph.linear("features").apply(pooled));
    let scores = graph.linear("scores").apply(features.clone());
    (features, scores)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ds_space::{Digest, Draws};

    const SHAPE: ClassifierShape = ClassifierShape { widths: &[6, 8], bands: 2, features: 5, scores: 3 };

    fn noise(shape: &[usize], seed: u64) -> Array {
        let draws = Draws::from_seed(seed, "classifier test");
        #[expect(clippy::cast_possible_truncation, reason = "inputs are single precision")]
        let values = (0..shape.iter().product::<usize>() as u64).map(|i| draws.normal(i) as f32).collect();
        Array::new(shape, values)
    }

    fn weights() -> Weights {
        Weights::initialised(&SHAPE.declare(), &Digest::of(b"classifier"))
    }

    #[test]
    fn an_image_answers_alike_in_any_batch() {
        let network = Classifier::new(SHAPE, &weights()).expect("the weights fit");
        let pair = noise(&[2, 16, 12, 3], 1);
        let both = network.answer(&pair);
        assert_eq!((both.features.shape(), both.scores.shape()), (&[2, 5][..], &[2, 3][..]));
        assert!(both.features.values().iter().all(|value| *value >= 0.0));
        let levels = network.levels(&pair);
        assert_eq!((levels[0].shape(), levels[1].shape()), (&[2, 8, 6, 6][..], &[2, 4, 3, 8][..]));
        let half = pair.values().len() / 2;
        let second = network.answer(&Array::new(&[1, 16, 12, 3], pair.values()[half..].to_vec()));
        let apart = second.scores.values().iter().zip(&both.scores.values()[3..]).map(|(a, b)| (a - b).abs());
        assert!(apart.fold(0.0, f32::max) < 1e-4);
    }

    #[test]
    fn bands_tell_above_from_below() {
        let network = Classifier::new(SHAPE, &weights()).expect("the weights fit");
        let mut image = Array::zeros(&[1, 16, 12, 3]);
        image.values_mut()[..8 * 12 * 3].fill(1.0);
        let mut turned = image.clone();
        turned.values_mut().reverse();
        assert_ne!(network.answer(&image).scores, network.answer(&turned).scores);
    }

    #[test]
    fn the_gradient_is_the_slope_of_the_loss() {
        let (weights, images) = (weights(), noise(&[2, 16, 16, 3], 3));
        let square = |scores: &Array| {
            let loss = scores.values().iter().map(|v| 0.5 * f64::from(*v).powi(2)).sum();
            (loss, scores.clone())
        };
        let (loss, gradient) = gradient(&SHAPE, &weights, &images, square).expect("the weights fit");
        for name in ["scores.weight", "features.bias", "level0.fold.weight", "level1.convolution.weight"] {
            let slope = gradient.get(name).expect("every weight has a gradient").clone();
            let norm2: f64 = slope.values().iter().map(|v| f64::from(*v).powi(2)).sum();
            let step = 1e-3 * loss / norm2.max(1e-12);
            let mut moved = weights.clone();
            let (_, array) = moved.iter_mut().find(|(found, _)| *found == name).expect("the weight exists");
            #[expect(clippy::cast_possible_truncation, reason = "weights are single precision")]
            array.values_mut().iter_mut().zip(slope.values()).for_each(|(w, g)| *w -= step as f32 * g);
            let scores = Classifier::new(SHAPE, &moved).expect("the weights fit").answer(&images).scores;
            let fell = (loss - square(&scores).0) / (step * norm2);
            assert!((fell - 1.0).abs() < 0.1, "{name}: the loss fell by {fell} of what its slope says");
        }
    }

    #[test]
    fn weights_that_do_not_fit_are_named() {
        let mut weights = weights();
        weights.insert("scores.bias", Array::zeros(&[7]));
        let error = Classifier::new(SHAPE, &weights).err().expect("the shape is wrong").to_string();
        assert!(error.contains("scores.bias") && error.contains("[7]"), "{error}");
    }
}
