//! The network of the camera policy: one image and a few numbers of state to a vector of outputs.
//!
//! Patches of 4×4 pixels become tokens; three stages of 24×40, 12×20 and 6×10 tokens each add a 3×3 convolution and
//! fold 2×2 tokens into one; the last is flattened, so that place in the image counts, and read by two hidden layers
//! together with the state. All layers are matrix products. The loss lives with the caller, who is shown the outputs
//! and answers with their gradient.

use burn::tensor::{Tensor, activation::relu};
use ds_nn::array::{Array, Declared, Weights, WeightsError};
use ds_space::{CameraId, CameraModel, DVec3, Intrinsics};

use crate::graph::{Graph, Mode, array_of, fold};

/// Width of the image, in pixels.
pub const WIDTH_PX: usize = 160;
/// Height of the image, in pixels.
pub const HEIGHT_PX: usize = 96;

const PATCH_PX: usize = 4;
const WIDTHS: [usize; 3] = [32, 64, 96];
const SQUEEZED: usize = 24;
const HIDDEN: usize = 192;
const LAST: [usize; 2] = [HEIGHT_PX / 16, WIDTH_PX / 16];

/// Rows, columns and channels of what the network knows of an image before state and command enter.
pub const CONTEXT: [usize; 3] = [LAST[0], LAST[1], SQUEEZED];

/// Returns the camera whose frames the camera policy and the panel know: 70° across, 1.6 m above the road, 1.5 m before the rear
/// axle, 0.05 rad down.
///
/// # Panics
/// Never: its name is a fixed plain word.
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "the sides are small constants")]
pub fn known_camera() -> CameraModel {
    let id = CameraId::new("front").expect("a plain word is an id");
    let intrinsics = Intrinsics::centred(WIDTH_PX as u32, HEIGHT_PX as u32, 70f64.to_radians());
    CameraModel::mounted(id, intrinsics, DVec3::new(1.5, 0.0, 1.6), 0.0, 0.05)
}

/// The sizes that a caller chooses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PlannerSize {
    /// Numbers of state.
    pub state: usize,
    /// Numbers of output.
    pub outputs: usize,
}

impl PlannerSize {
    /// Lists the weights of a network of this size.
    #[must_use]
    pub fn declared(self) -> Vec<Declared> {
        let relu_gain = std::f32::consts::SQRT_2;
        let mut list = Vec::new();
        let mut inputs = PATCH_PX * PATCH_PX * 3;
        for (stage, width) in WIDTHS.into_iter().enumerate() {
            Declared::linear(&mut list, &format!("stage{stage}.fold"), inputs, width, relu_gain);
            Declared::linear(&mut list, &format!("stage{stage}.convolution"), 9 * width, width, relu_gain);
            inputs = 4 * width;
        }
        Declared::linear(&mut list, "squeeze", WIDTHS[2], SQUEEZED, relu_gain);
        Declared::linear(&mut list, "hidden0", SQUEEZED * LAST[0] * LAST[1] + self.state, HIDDEN, relu_gain);
        Declared::linear(&mut list, "hidden1", HIDDEN, HIDDEN, relu_gain);
        Declared::linear(&mut list, "outputs", HIDDEN, self.outputs, 0.2);
        list
    }
}

/// The network with checked weights, ready to answer.
pub struct Planner {
    graph: Graph,
}

impl Planner {
    /// Checks the weights and puts them on the device.
    ///
    /// # Errors
    /// [`WeightsError`] names the first weight that does not fit.
    pub fn new(size: PlannerSize, weights: &Weights) -> Result<Self, WeightsError> {
        weights.check(&size.declared())?;
        Ok(Self { graph: Graph::new(weights, Mode::Infer) })
    }

    /// Returns what the network knows of images [N, 96, 160, 3] before any state enters: [N, rows × columns, channels],
    /// places row by row, see [`CONTEXT`].
    #[must_use]
    pub fn context(&self, images: &Array) -> Array {
        let x = look(&self.graph, images);
        let [batch, height, width, channels] = x.dims();
        array_of(x.reshape([batch, height * width, channels]))
    }

    /// Answers a batch: images [N, 96, 160, 3], state [N, S] to outputs [N, O].
    #[must_use]
    pub fn answer(&self, images: &Array, state: &Array) -> Array {
        array_of(forward(&self.graph, images, state))
    }
}

/// Returns a loss and the gradient of every weight; `grade` is shown the outputs and returns the loss and its gradient
/// by the outputs.
///
/// # Errors
/// [`WeightsError`] names the first weight that does not fit.
pub fn gradient(
    size: PlannerSize,
    weights: &Weights,
    images: &Array,
    state: &Array,
    grade: impl FnOnce(&Array) -> (f64, Array),
) -> Result<(f64, Weights), WeightsError> {
    weights.check(&size.declared())?;
    let graph = Graph::new(weights, Mode::Train);
    let outputs = forward(&graph, images, state);
    let (loss, by_outputs) = grade(&array_of(outputs.clone()));
    let surrogate = (outputs * graph.tensor::<2>(&by_outputs)).sum();
    Ok((loss, graph.gradients(surrogate.backward())))
}

/// The image alone, to the places that the hidden layers read.
fn look(graph: &Graph, images: &Array) -> Tensor<4> {
    let mut x = fold(graph.tensor::<4>(images), PATCH_PX);
    for stage in 0..WIDTHS.len() {
        if stage > 0 {
            x = fold(x, 2);
        }
        x = relu(graph.linear(&format!("stage{stage}.fold")).apply(x));
        x = x.clone() + relu(graph.linear(&format!("stage{stage}.convolution")).convolve(x));
    }
    relu(graph.linear("squeeze").apply(x))
}

fn forward(graph: &Graph, images: &Array, state: &Array) -> Tensor<2> {
    let x = look(graph, images);
    let [batch, height, width, channels] = x.dims();
    let x = Tensor::cat(vec![x.reshape([batch, height * width * channels]), graph.tensor::<2>(state)], 1);
    let x = relu(graph.linear("hidden0").apply(x));
    let x = relu(graph.linear("hidden1").apply(x));
    graph.linear("outputs").apply(x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ds_space::{Digest, Draws};

    const SIZE: PlannerSize = PlannerSize { state: 2, outputs: 3 };

    fn noise(shape: &[usize], seed: u64) -> Array {
        let draws = Draws::from_seed(seed, "planner test");
        #[expect(clippy::cast_possible_truncation, reason = "inputs are single precision")]
        let values = (0..shape.iter().product::<usize>() as u64).map(|i| draws.normal(i) as f32).collect();
        Array::new(shape, values)
    }

    #[test]
    fn the_gradient_is_the_slope_of_the_loss() {
        let weights = Weights::initialised(&SIZE.declared(), &Digest::of(b"planner"));
        let (images, state) = (noise(&[2, HEIGHT_PX, WIDTH_PX, 3], 1), noise(&[2, 2], 2));
        let square = |outputs: &Array| {
            let loss = outputs.values().iter().map(|v| 0.5 * f64::from(*v).powi(2)).sum();
            (loss, outputs.clone())
        };
        let (loss, gradient) = gradient(SIZE, &weights, &images, &state, square).expect("the weights fit");
        let answer = Planner::new(SIZE, &weights).expect("the weights fit").answer(&images, &state);
        assert!((square(&answer).0 - loss).abs() < 1e-4 * loss.max(1.0));
        for name in ["outputs.weight", "stage0.convolution.weight", "hidden0.bias"] {
            let mut moved = weights.clone();
            let slope = gradient.get(name).expect("every weight has a gradient").clone();
            let norm2: f64 = slope.values().iter().map(|v| f64::from(*v).powi(2)).sum();
            let step = 1e-3 * loss / norm2.max(1e-12);
            for (array_name, array) in moved.iter_mut() {
                if array_name == name {
                    #[expect(clippy::cast_possible_truncation, reason = "weights are single precision")]
                    array.values_mut().iter_mut().zip(slope.values()).for_each(|(w, g)| *w -= step as f32 * g);
                }
            }
            let answer = Planner::new(SIZE, &moved).expect("the weights fit").answer(&images, &state);
            let fell = (loss - square(&answer).0) / (step * norm2);
            assert!((fell - 1.0).abs() < 0.1, "{name}: the loss fell by {fell} of what its slope says");
        }
    }

    #[test]
    fn weights_that_do_not_fit_are_named() {
        let mut weights = Weights::initialised(&SIZE.declared(), &Digest::of(b"planner"));
        weights.insert("squeeze.bias", Array::zeros(&[7]));
        let error = Planner::new(SIZE, &weights).err().expect("the shape is wrong").to_string();
        assert!(error.contains("squeeze.bias") && error.contains("[7]"), "{error}");
    }
}
