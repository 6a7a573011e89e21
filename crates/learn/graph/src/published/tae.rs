//! The tiny autoencoder for latents of Wan2.1 (TAEW2.1): a network of single frames whose blocks remember one frame.
//!
//! It takes and gives *normalised* latents, as the transformer does, and frames of 0 to 1. The decoder gives four
//! frames per latent; the first three of a rollout are for the caller to drop. The encoder takes multiples of four
//! frames, not one more. Its memory belongs to the rollout.

use std::ops::Range;

use burn::tensor::{Tensor, activation, module, ops::ConvOptions};
use ds_nn::array::{Array, Declared, Initial, Weights, WeightsError};
use ds_nn::checkpoint::{CheckpointError, Finite, Fitted};

use crate::device::Precision;
use crate::graph::{Graph, Mode, array_of};

/// Latent channels.
pub const CHANNELS: usize = 16;
/// Frames per latent.
pub const STRIDE: usize = 4;
/// Frames at the start of a rollout that are no part of it.
pub const LEAD: usize = 3;

/// Width of every layer of the encoder.
const ENCODER_WIDTH: usize = 64;
/// Widths of the decoder's stages.
const WIDTHS: [usize; 4] = [256, 128, 64, 64];
/// Into how many frames each stage of the decoder grows one.
const GROWTH: [usize; 3] = [1, 2, 2];
/// How many frames each stage of the encoder pools.
const POOLS: [usize; 3] = [2, 2, 1];
/// Memory blocks of a stage.
const BLOCKS: usize = 3;
/// Half of the range to which latents are softly limited.
const LIMIT: f64 = 3.0;

/// A layer: its index in the published list and what it is.
#[derive(Debug, Clone, Copy)]
enum Part {
    Convolution { index: usize, inputs: usize, outputs: usize, stride: usize, bias: bool },
    Memory { index: usize, width: usize },
    Relu,
    Pool { index: usize, width: usize, frames: usize },
    Grow { index: usize, width: usize, frames: usize },
    Double,
}

fn encoder() -> Vec<Part> {
    let width = ENCODER_WIDTH;
    let mut parts = vec![Part::Convolution { index: 0, inputs: 3, outputs: width, stride: 1, bias: true }, Part::Relu];
    for (stage, frames) in POOLS.into_iter().enumerate() {
        let index = 2 + stage * (BLOCKS + 2);
        parts.push(Part::Pool { index, width, frames });
        parts.push(Part::Convolution { index: index + 1, inputs: width, outputs: width, stride: 2, bias: false });
        parts.extend((0..BLOCKS).map(|block| Part::Memory { index: index + 2 + block, width }));
    }
    let index = 2 + POOLS.len() * (BLOCKS + 2);
    parts.push(Part::Convolution { index, inputs: width, outputs: CHANNELS, stride: 1, bias: true });
    parts
}

fn decoder() -> Vec<Part> {
    let first = Part::Convolution { index: 1, inputs: CHANNELS, outputs: WIDTHS[0], stride: 1, bias: true };
    let mut parts = vec![first, Part::Relu];
    for (stage, frames) in GROWTH.into_iter().enumerate() {
        let (index, width) = (3 + stage * (BLOCKS + 3), WIDTHS[stage]);
        parts.extend((0..BLOCKS).map(|block| Part::Memory { index: index + block, width }));
        parts.push(Part::Double);
        parts.push(Part::Grow { index: index + BLOCKS + 1, width, frames });
        let outputs = WIDTHS[stage + 1];
        parts.push(Part::Convolution { index: index + BLOCKS + 2, inputs: width, outputs, stride: 1, bias: false });
    }
    parts.push(Part::Relu);
    let index = 4 + GROWTH.len() * (BLOCKS + 3);
    parts.push(Part::Convolution { index, inputs: WIDTHS[3], outputs: 3, stride: 1, bias: true });
    parts
}

/// Lists the weights of both halves.
#[must_use]
pub fn declare() -> Vec<Declared> {
    let mut list = Vec::new();
    let mut weight = |name: String, shape: [usize; 4], bias: bool| {
        let inputs: usize = shape[1..].iter().product();
        list.push(Declared::new(format!("{name}.weight"), &shape, Initial::Normal(1.0 / (inputs as f32).sqrt())));
        if bias {
            list.push(Declared::new(format!("{name}.bias"), &shape[..1], Initial::Constant(0.0)));
        }
    };
    for (half, parts) in [("encoder", encoder()), ("decoder", decoder())] {
        for part in parts {
            match part {
                Part::Convolution { index, inputs, outputs, bias, .. } => {
                    weight(format!("{half}.{index}"), [outputs, inputs, 3, 3], bias);
                }
                Part::Memory { index, width } => {
                    for (layer, inputs) in [(0, 2 * width), (2, width), (4, width)] {
                        weight(format!("{half}.{index}.conv.{layer}"), [width, inputs, 3, 3], true);
                    }
                }
                Part::Pool { index, width, frames } => {
                    weight(format!("{half}.{index}.conv"), [width, width * frames, 1, 1], false);
                }
                Part::Grow { index, width, frames } => {
                    weight(format!("{half}.{index}.conv"), [width * frames, width, 1, 1], false);
                }
                Part::Relu | Part::Double => {}
            }
        }
    }
    list
}

/// Counts decoding one latent of `h`×`w` pixels, two operations per multiply-add.
#[must_use]
pub fn decode_operations(h: usize, w: usize) -> f64 {
    let (mut pixels, mut total) = (h * w, 0);
    for part in decoder() {
        match part {
            Part::Convolution { inputs, outputs, .. } => total += pixels * 9 * inputs * outputs,
            Part::Memory { width, .. } => total += pixels * 9 * 4 * width * width,
            Part::Grow { width, frames, .. } => {
                total += pixels * width * width * frames;
                pixels *= frames;
            }
            Part::Double => pixels *= 4,
            Part::Relu | Part::Pool { .. } => {}
        }
    }
    2.0 * total as f64
}

struct Convolution {
    weight: Tensor<4>,
    bias: Option<Tensor<1>>,
    stride: usize,
}

impl Convolution {
    fn new(graph: &Graph, name: &str, shape: [usize; 4], stride: usize, bias: bool) -> Self {
        let bias = bias.then(|| graph.weight(&format!("{name}.bias"), [shape[0]]));
        Self { weight: graph.weight(&format!("{name}.weight"), shape), bias, stride }
    }

    fn apply(&self, x: Tensor<4>) -> Tensor<4> {
        let padding = self.weight.dims()[2] / 2;
        let options = ConvOptions::new([self.stride; 2], [padding; 2], [1; 2], 1);
        module::conv2d(x, self.weight.clone(), self.bias.clone(), options)
    }
}

#[expect(clippy::large_enum_variant, reason = "a network has a few dozen layers")]
enum Layer {
    Convolution(Convolution),
    Memory([Convolution; 3]),
    Relu,
    Pool(Convolution, usize),
    Grow(Convolution, usize),
    Double,
}

/// The last frame that each memory block of a half has seen; empty at the start of a rollout.
#[derive(Clone, Default)]
pub struct TaeMemory {
    frames: Vec<Option<Tensor<4>>>,
}

/// The autoencoder bound to the device.
pub struct Tae {
    graph: Graph,
    encoder: Vec<Layer>,
    decoder: Vec<Layer>,
}

impl Tae {
    /// Binds weights.
    ///
    /// # Errors
    /// If the weights do not fit [`declare`].
    pub fn new(weights: &Weights) -> Result<Self, WeightsError> {
        weights.check(&declare())?;
        Ok(Self::of(Graph::new(weights, Mode::Infer)))
    }

    /// Binds a checkpoint that was fitted to [`declare`].
    ///
    /// # Errors
    /// If a value is not finite and that is checked.
    pub fn load(fitted: &Fitted<'_>, finite: Finite) -> Result<Self, CheckpointError> {
        Ok(Self::of(Graph::new(&fitted.weights(finite)?, Mode::Infer)))
    }

    /// Binds drawn weights, for measurements.
    #[must_use]
    pub fn drawn() -> Self {
        let mut graph = Graph::empty(Mode::Infer, Precision::F32);
        graph.bind_drawn(&declare(), |_| Precision::F32);
        Self::of(graph)
    }

    fn of(graph: Graph) -> Self {
        let layers = |half: &str, parts: Vec<Part>| parts.iter().map(|part| layer(&graph, half, part)).collect();
        let (encoder, decoder) = (layers("encoder", encoder()), layers("decoder", decoder()));
        Self { graph, encoder, decoder }
    }

    /// Encodes frames [4·steps, rows, columns, 3] of 0 to 1 to normalised latents [steps, rows/8, columns/8, 16].
    ///
    /// # Panics
    /// If the frames do not fill whole steps.
    #[must_use]
    pub fn encode(&self, frames: &Array, memory: &mut TaeMemory) -> Array {
        assert!(frames.shape()[0].is_multiple_of(STRIDE), "{} frames do not fill whole steps", frames.shape()[0]);
        array_of(run(&self.encoder, self.graph.tensor::<4>(frames).permute([0, 3, 1, 2]), memory).permute([0, 2, 3, 1]))
    }

    /// Decodes normalised latents [steps, h, w, 16] to frames [4·steps, 8h, 8w, 3] of 0 to 1.
    #[must_use]
    pub fn decode(&self, latents: &Array, memory: &mut TaeMemory) -> Array {
        let x = self.graph.tensor::<4>(latents).permute([0, 3, 1, 2]);
        let x = (x / LIMIT).tanh() * LIMIT;
        array_of(run(&self.decoder, x, memory).clamp(0.0, 1.0).permute([0, 2, 3, 1]))
    }
}

fn layer(graph: &Graph, half: &str, part: &Part) -> Layer {
    match *part {
        Part::Convolution { index, inputs, outputs, stride, bias } => {
            let name = format!("{half}.{index}");
            Layer::Convolution(Convolution::new(graph, &name, [outputs, inputs, 3, 3], stride, bias))
        }
        Part::Memory { index, width } => {
            Layer::Memory([(0, 2 * width), (2, width), (4, width)].map(|(layer, inputs)| {
                Convolution::new(graph, &format!("{half}.{index}.conv.{layer}"), [width, inputs, 3, 3], 1, true)
            }))
        }
        Part::Relu => Layer::Relu,
        Part::Pool { index, width, frames } => {
            let name = format!("{half}.{index}.conv");
            Layer::Pool(Convolution::new(graph, &name, [width, width * frames, 1, 1], 1, false), frames)
        }
        Part::Grow { index, width, frames } => {
            let name = format!("{half}.{index}.conv");
            Layer::Grow(Convolution::new(graph, &name, [width * frames, width, 1, 1], 1, false), frames)
        }
        Part::Double => Layer::Double,
    }
}

/// Runs layers over frames [T, C, H, W].
fn run(layers: &[Layer], mut x: Tensor<4>, memory: &mut TaeMemory) -> Tensor<4> {
    let mut at = 0;
    for layer in layers {
        let [t, c, h, w] = x.dims();
        x = match layer {
            Layer::Convolution(convolution) => convolution.apply(x),
            Layer::Relu => activation::relu(x),
            Layer::Pool(convolution, frames) => convolution.apply(x.reshape([t / frames, frames * c, h, w])),
            Layer::Grow(convolution, frames) => convolution.apply(x).reshape([t * frames, c, h, w]),
            Layer::Double => {
                let x: Tensor<6> = x.reshape([t, c, h, 1, w, 1]).expand([t, c, h, 2, w, 2]);
                x.reshape([t, c, 2 * h, 2 * w])
            }
            Layer::Memory(convolutions) => {
                let part = |range: Range<usize>| x.clone().slice([range, 0..c, 0..h, 0..w]);
                if memory.frames.len() <= at {
                    memory.frames.resize(at + 1, None);
                }
                let before = memory.frames[at].replace(part(t - 1..t));
                at += 1;
                let mut past = vec![before.unwrap_or_else(|| Tensor::zeros([1, c, h, w], &x.device()))];
                if t > 1 {
                    past.push(part(0..t - 1));
                }
                let y = Tensor::cat(vec![x.clone(), Tensor::cat(past, 0)], 1);
                let y = activation::relu(convolutions[0].apply(y));
                let y = activation::relu(convolutions[1].apply(y));
                activation::relu(x + convolutions[2].apply(y))
            }
        };
    }
    x
}

#[cfg(test)]
mod tests {
    use ds_space::{Digest, Draws};

    use super::*;

    #[test]
    fn the_published_tensors_are_asked_for() {
        let declared = declare();
        let count = |half: &str| -> usize {
            let of = declared.iter().filter(|weight| weight.name.starts_with(half));
            of.map(|weight| weight.shape.iter().product::<usize>()).sum()
        };
        assert_eq!(declared.len(), 128);
        // In units of ten thousand, as the figures are published.
        assert_eq!((count("decoder.") + 5_000) / 10_000, 984);
        assert_eq!((count("") + 5_000) / 10_000, 1132);
        assert!((decode_operations(60, 104) / 0.544e12 - 1.0).abs() < 0.02, "{:e}", decode_operations(60, 104));
    }

    #[test]
    fn streaming_is_the_whole_clip() {
        let tae = Tae::new(&Weights::initialised(&declare(), &Digest::of(b"tae"))).expect("fits");
        let draws = Draws::from_seed(1, "latents");
        let latents: Vec<f32> = (0..3 * 2 * 2 * 16).map(|i| draws.normal(i) as f32).collect();
        let whole = tae.decode(&Array::new(&[3, 2, 2, 16], latents.clone()), &mut TaeMemory::default());
        assert_eq!(whole.shape(), [12, 16, 16, 3]);
        let mut memory = TaeMemory::default();
        let step = |step: &[f32]| tae.decode(&Array::new(&[1, 2, 2, 16], step.to_vec()), &mut memory).into_values();
        let streamed: Vec<f32> = latents.chunks(64).flat_map(step).collect();
        let far = whole.values().iter().zip(&streamed).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(far < 1e-5, "{far}");
        assert_eq!(tae.encode(&whole, &mut TaeMemory::default()).shape(), [3, 2, 2, 16]);
    }
}
