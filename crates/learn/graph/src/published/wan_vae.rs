//! Wan's causal video autoencoders: streaming encoder and decoder over the published weights, by their names.
//!
//! Frames are [frames, rows, columns, 3] of −1 to 1; latents [steps, h, w, z] as the encoder gives them, that is means,
//! not normalised. The first frame of a rollout is a step of its own, each later step stands for four frames. The
//! memory belongs to the rollout; pieces give the same as the whole clip at once.

use burn::tensor::Tensor;
use ds_nn::array::{Array, Weights, WeightsError};
use ds_nn::checkpoint::{CheckpointError, Finite, Fitted};
use ds_space::{Digest, DigestWriter};

use crate::device::{Precision, convolution_precision};
use crate::graph::{Graph, Mode, array_of};

mod layers;
mod shape;
#[cfg(test)]
mod tests;
mod work;

use layers::{Layer, Slot, Walk, run};
pub use shape::WanVaeShape;

/// Frames that a step after the first stands for.
const STEP: usize = 4;

/// What the layers of one half remember of a rollout; empty at its start. A clone shares all tensors.
#[derive(Clone, Default)]
pub struct WanMemory {
    slots: Vec<Slot>,
    begun: bool,
}

impl WanMemory {
    /// Returns the digest of what is remembered.
    #[must_use]
    pub fn digest(&self) -> Digest {
        let mut writer = DigestWriter::new();
        writer.bool(self.begun);
        for slot in &self.slots {
            match slot {
                Slot::Empty => writer.u64(0),
                Slot::First => writer.u64(1),
                Slot::Frames(frames) => {
                    writer.u64(2);
                    array_of(frames.clone()).digest_into(&mut writer);
                    &mut writer
                }
            };
        }
        writer.finish()
    }
}

/// An autoencoder bound to the device.
pub struct WanVae {
    shape: WanVaeShape,
    graph: Graph,
    encoder: Vec<Layer>,
    decoder: Vec<Layer>,
}

impl WanVae {
    /// Binds weights.
    ///
    /// # Errors
    /// If the weights do not fit the shape.
    pub fn new(shape: &WanVaeShape, weights: &Weights) -> Result<Self, WeightsError> {
        weights.check(&shape.declare())?;
        Ok(Self::of(shape, Graph::new(weights, Mode::Infer)))
    }

    /// Binds a checkpoint that was fitted to [`WanVaeShape::declare`]. The encoder stays in f32 whatever the precision:
    /// in 16 bits it changes a rollout visibly, the decoder does not.
    ///
    /// # Errors
    /// If a value is not finite and that is checked.
    pub fn load(
        shape: &WanVaeShape,
        fitted: &Fitted<'_>,
        finite: Finite,
        decoder: Precision,
    ) -> Result<Self, CheckpointError> {
        let decoder = convolution_precision(decoder);
        let mut graph = Graph::empty(Mode::Infer, decoder);
        fitted.each(finite, |name, array| graph.bind(name, &array, format(name, array.shape(), decoder)))?;
        Ok(Self::of(shape, graph))
    }

    /// Binds drawn weights, for measurements.
    #[must_use]
    pub fn drawn(shape: &WanVaeShape, decoder: Precision) -> Self {
        let decoder = convolution_precision(decoder);
        let mut graph = Graph::empty(Mode::Infer, decoder);
        graph.bind_drawn(&shape.declare(), |weight| format(&weight.name, &weight.shape, decoder));
        Self::of(shape, graph)
    }

    fn of(shape: &WanVaeShape, mut graph: Graph) -> Self {
        let layers = |parts: Vec<shape::Part>| parts.iter().map(|part| Layer::new(&graph, part)).collect();
        let (encoder, decoder) = (layers(shape.encoder()), layers(shape.decoder()));
        graph.forget();
        Self { shape: *shape, encoder, decoder, graph }
    }

    /// Returns the sizes.
    #[must_use]
    pub fn shape(&self) -> &WanVaeShape {
        &self.shape
    }

    /// Encodes frames that follow those already in `memory`; at the start of a rollout one frame alone or followed by
    /// multiples of four, later multiples of four.
    ///
    /// # Panics
    /// If the frames do not fill whole steps.
    #[must_use]
    pub fn encode(&self, frames: &Array, memory: &mut WanMemory) -> Array {
        let [count, rows, columns, _]: [usize; 4] = frames.shape().try_into().expect("frames have four axes");
        let lead = usize::from(!memory.begun);
        assert!(count >= lead && (count - lead).is_multiple_of(STEP), "{count} frames do not fill whole steps");
        let s = self.shape.fold();
        let x: Tensor<7> = self.graph.tensor::<4>(frames).reshape([1, count, rows / s, s, columns / s, s, 3]);
        // Channels are ordered (colour, column, row) of a folded square.
        let x = x.permute([0, 6, 5, 3, 1, 2, 4]).reshape([1, 3 * s * s, count, rows / s, columns / s]);
        let y = pass(&self.encoder, x, memory);
        let [_, _, t, h, w] = y.dims();
        let means = y.slice([0..1, 0..self.shape.z, 0..t, 0..h, 0..w]);
        array_of(means.permute([0, 2, 3, 4, 1]).reshape([t, h, w, self.shape.z]))
    }

    /// Decodes latents that follow those already in `memory`: one frame for the first of a rollout, four for each
    /// other, values limited to −1 to 1.
    #[must_use]
    pub fn decode(&self, latents: &Array, memory: &mut WanMemory) -> Array {
        let [count, h, w, z]: [usize; 4] = latents.shape().try_into().expect("latents have four axes");
        let x = self.graph.tensor::<4>(latents).reshape([1, count, h, w, z]).permute([0, 4, 1, 2, 3]);
        let y = pass(&self.decoder, x, memory).clamp(-1.0, 1.0);
        let (s, [_, _, t, rows, columns]) = (self.shape.fold(), y.dims());
        let y: Tensor<7> = y.reshape([1, 3, s, s, t, rows, columns]);
        array_of(y.permute([0, 4, 5, 3, 6, 2, 1]).reshape([t, rows * s, columns * s, 3]))
    }
}

/// Returns the number format of a weight: the decoder's convolutions are lowered, all else stays f32.
fn format(name: &str, shape: &[usize], decoder: Precision) -> Precision {
    let convolution = name.starts_with("decoder.") && shape.len() > 3 && name.ends_with(".weight");
    if convolution { decoder } else { Precision::F32 }
}

/// Runs a half over a piece [1, C, T, H, W]; the first frame of a rollout goes through alone.
fn pass(layers: &[Layer], x: Tensor<5>, memory: &mut WanMemory) -> Tensor<5> {
    let mut outputs = Vec::new();
    let [b, c, t, h, w] = x.dims();
    let mut piece = |range: std::ops::Range<usize>, first: bool| {
        let x = x.clone().slice([0..b, 0..c, range, 0..h, 0..w]);
        outputs.push(run(layers, x, &mut Walk { slots: &mut memory.slots, at: 0, first }));
    };
    let lead = usize::from(!memory.begun);
    if lead == 1 {
        piece(0..1, true);
    }
    if t > lead {
        piece(lead..t, false);
    }
    memory.begun = true;
    Tensor::cat(outputs, 2)
}
