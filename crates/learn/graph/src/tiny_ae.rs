//! The tiny causal video autoencoder on the framework's graph: blocks with a memory of one frame, so that streaming
//! equals whole-clip work. What goes in and comes out, and the sizes, are those of [`AeShape`].

use burn::tensor::{Tensor, activation};
use ds_nn::array::{Array, Weights, WeightsError};
use ds_nn::body::Autoencoder;
use ds_nn::tiny_ae::{AeShape, BLOCK_PX, Memory, Remembered};
use ds_space::DigestWriter;

use crate::graph::{Graph, Linear, Mode, array_of, channels, fold};

/// The memories of all blocks.
#[derive(Clone, Default)]
struct Frames(Vec<Option<Tensor<4>>>);

impl Remembered for Frames {
    fn digest_into(&self, writer: &mut DigestWriter) {
        for frame in &self.0 {
            writer.bool(frame.is_some());
            if let Some(frame) = frame {
                array_of(frame.clone()).digest_into(writer);
            }
        }
    }

    fn snapshot(&self) -> Box<dyn Remembered> {
        Box::new(self.clone())
    }
}

struct Walk<'a> {
    memory: &'a mut Frames,
    at: usize,
    batch: usize,
}

impl Walk<'_> {
    /// Returns, for each frame of x [B·T, h, w, c], the frame before, and remembers the last one.
    fn previous(&mut self, x: &Tensor<4>) -> Tensor<4> {
        let [rows, h, w, c] = x.dims();
        let t = rows / self.batch;
        if self.memory.0.len() <= self.at {
            self.memory.0.resize(self.at + 1, None);
        }
        let clip = x.clone().reshape([self.batch, t, h, w, c]);
        let pick = |range: std::ops::Range<usize>| clip.clone().slice([0..self.batch, range, 0..h, 0..w, 0..c]);
        let last = pick(t - 1..t).reshape([self.batch, h, w, c]);
        let first = self.memory.0[self.at].replace(last);
        let first = first.unwrap_or_else(|| Tensor::zeros([self.batch, h, w, c], &x.device()));
        self.at += 1;
        if t == 1 {
            return first;
        }
        let first = first.reshape([self.batch, 1, h, w, c]);
        Tensor::cat(vec![first, pick(0..t - 1)], 1).reshape([rows, h, w, c])
    }
}

struct MemoryBlock {
    first: Linear,
    second: Linear,
}

impl MemoryBlock {
    fn new(graph: &Graph, name: &str) -> Self {
        Self { first: graph.linear(&format!("{name}.conv.0")), second: graph.linear(&format!("{name}.conv.2")) }
    }

    fn apply(&self, x: Tensor<4>, walk: &mut Walk<'_>) -> Tensor<4> {
        let both = Tensor::cat(vec![x.clone(), walk.previous(&x)], 3);
        let y = self.second.convolve(activation::relu(self.first.convolve(both)));
        activation::relu(x + y)
    }
}

/// The autoencoder bound to the device.
pub struct TinyAe {
    shape: AeShape,
    pub(crate) graph: Graph,
    /// The stages of the encoder: what folds into each, and its blocks.
    encoder: Vec<(Linear, Vec<MemoryBlock>)>,
    encoder_head: Linear,
    encoder_skip: Linear,
    stem: Linear,
    stages: Vec<(Vec<MemoryBlock>, Option<Linear>)>,
    /// Convolutions of the sketch's levels, each with what grows from it into the next.
    sketch: Vec<(Linear, Option<Linear>)>,
    guides: Vec<Linear>,
    decoder_head: Linear,
    blend: Option<Linear>,
    decoder_skip: Option<Linear>,
}

impl TinyAe {
    /// Binds weights for inference.
    ///
    /// # Errors
    /// If the weights do not fit the shape.
    pub fn new(shape: &AeShape, weights: &Weights) -> Result<Self, WeightsError> {
        weights.check(&shape.declare())?;
        Ok(Self::bind(shape, weights, Mode::Infer))
    }

    pub(crate) fn bind(shape: &AeShape, weights: &Weights, mode: Mode) -> Self {
        let graph = Graph::new(weights, mode);
        let blocks = |name: &str, count: usize| {
            (0..count).map(|index| MemoryBlock::new(&graph, &format!("{name}.block.{index}"))).collect()
        };
        let stage = |stage: usize| {
            let name = format!("decoder.stage.{stage}");
            (blocks(&name, shape.decoder_blocks[stage]), (stage < 2).then(|| graph.linear(&format!("{name}.grow"))))
        };
        Self {
            encoder: shape
                .encoder()
                .iter()
                .map(|stage| (graph.linear(&format!("{}.fold", stage.name)), blocks(&stage.name, stage.blocks)))
                .collect(),
            encoder_head: graph.linear("encoder.head"),
            encoder_skip: graph.linear("encoder.skip"),
            stem: graph.linear("decoder.stem"),
            stages: (0..3).map(stage).collect(),
            sketch: (0..shape.sketch().len())
                .map(|index| {
                    let name = format!("decoder.guide.sketch.{index}");
                    (graph.linear(&name), (index < 2).then(|| graph.linear(&format!("{name}.grow"))))
                })
                .collect(),
            guides: (0..shape.guides).map(|index| graph.linear(&format!("decoder.guide.{index}"))).collect(),
            decoder_head: graph.linear("decoder.head"),
            blend: shape.carried.then(|| graph.linear("decoder.guide.blend")),
            decoder_skip: shape.decoder_skip.then(|| graph.linear("decoder.skip")),
            shape: shape.clone(),
            graph,
        }
    }

    /// Encodes latent steps [steps, h, w, inputs] that follow those already in `memory`.
    #[must_use]
    pub fn encode(&self, steps: &Array, memory: &mut Memory) -> Array {
        array_of(self.encode_tensor(self.graph.tensor(steps), 1, memory))
    }

    /// Decodes latents [steps, h, w, z] that follow those already in `memory` to [steps·stride_t, 8h, 8w, 3].
    ///
    /// A guided decoder also takes what guides each pixel of the frames, [`AeShape::guide_channels`] of values −1 to 1, or none for
    /// "no layout". The memory does not depend on it.
    #[must_use]
    pub fn decode(&self, latents: &Array, guide: Option<&Array>, memory: &mut Memory) -> Array {
        let guide = guide.map(|guide| self.graph.tensor(guide));
        array_of(self.decode_tensor(self.graph.tensor(latents), guide, 1, memory))
    }

    pub(crate) fn encode_tensor(&self, x: Tensor<4>, batch: usize, memory: &mut Memory) -> Tensor<4> {
        let mut walk = Walk { memory: memory.of(), at: 0, batch };
        let skip = self.encoder_skip.apply(x.clone());
        let mut x = cut(x, self.shape.stride_t, 1 << (self.encoder.len() - 1));
        for (index, (layer, blocks)) in self.encoder.iter().enumerate() {
            x = activation::relu(layer.apply(if index == 0 { x } else { fold(x, 2) }));
            for block in blocks {
                x = block.apply(x, &mut walk);
            }
        }
        self.encoder_head.convolve(x) + skip
    }

    pub(crate) fn decode_tensor(
        &self,
        z: Tensor<4>,
        guide: Option<Tensor<4>>,
        batch: usize,
        memory: &mut Memory,
    ) -> Tensor<4> {
        let mut walk = Walk { memory: memory.of(), at: 0, batch };
        let skip = self.decoder_skip.as_ref().map(|skip| unfold(skip.apply(z.clone()), self.shape.stride_t));
        let mut x = activation::relu(self.stem.convolve(z));
        for (stage, (blocks, grow)) in self.stages.iter().enumerate() {
            for block in blocks {
                x = block.apply(x, &mut walk);
            }
            if let Some(grow) = grow {
                x = activation::relu(shuffle(grow.apply(x), self.shape.growth()[stage]));
            }
        }
        let [n, h, w, _] = x.dims();
        let none = || Tensor::zeros([n, 2 * h, 2 * w, self.shape.guide_channels()], &x.device());
        let guide = guide.unwrap_or_else(&none);
        let layouts = fold(channels(&guide, 0..3), 2);
        let mut seen = if self.sketch.is_empty() { layouts } else { self.sketched(layouts) };
        let carried = self.shape.carried.then(|| match guide.dims()[3] {
            3 => channels(&none(), 3..7),
            _ => channels(&guide, 3..7),
        });
        if let Some(carried) = &carried {
            seen = Tensor::cat(vec![seen, fold(carried.clone(), 2)], 3);
        }
        for guide in &self.guides {
            x = x.clone() + activation::relu(guide.convolve(Tensor::cat(vec![x, seen.clone()], 3)));
        }
        let painted = shuffle(self.decoder_head.convolve(x.clone()), 1);
        let painted = match skip {
            Some(skip) => painted + skip,
            None => painted,
        };
        let Some((blend, carried)) = self.blend.as_ref().zip(carried) else { return painted };
        let share = activation::sigmoid(shuffle(blend.convolve(x), 1)) * channels(&carried, 3..4);
        painted.clone() + share * (channels(&carried, 0..3) - painted)
    }

    /// Makes a sketch of layouts at 1/2 resolution.
    fn sketched(&self, layouts: Tensor<4>) -> Tensor<4> {
        let quarter = fold(layouts.clone(), 2);
        let mut grown: Option<Tensor<4>> = None;
        for ((level, grow), layout) in self.sketch.iter().zip([fold(quarter.clone(), 2), quarter, layouts.clone()]) {
            let seen = match grown {
                Some(grown) => Tensor::cat(vec![grown, layout], 3),
                None => layout,
            };
            let drawn = activation::relu(level.convolve(seen));
            grown = Some(match grow {
                Some(grow) => activation::relu(shuffle(grow.apply(drawn), 1)),
                None => drawn,
            });
        }
        grown.unwrap_or(layouts)
    }
}

/// Unfolds channels (frame, row, column, channel) of [N, h, w, g·4·c] into [N·g, 2h, 2w, c].
fn shuffle(x: Tensor<4>, frames: usize) -> Tensor<4> {
    let [n, h, w, channels] = x.dims();
    let c = channels / (4 * frames);
    let x: Tensor<7> = x.reshape([n, h, w, frames, 2, 2, c]);
    x.permute([0, 3, 1, 4, 2, 5, 6]).reshape([n * frames, 2 * h, 2 * w, c])
}

/// Cuts blocks (frame, row, column, colour) of [N, h, w, frames·192] into smaller ones, `cuts` times as many in rows and columns.
fn cut(x: Tensor<4>, frames: usize, cuts: usize) -> Tensor<4> {
    let [n, h, w, inputs] = x.dims();
    let side = BLOCK_PX / cuts;
    let x: Tensor<7> = x.reshape([n * h, w, frames, cuts, side, cuts, side * 3]);
    x.permute([0, 3, 1, 5, 2, 4, 6]).reshape([n, h * cuts, w * cuts, inputs / (cuts * cuts)])
}

/// Unfolds blocks (frame, row, column, colour) of [N, h, w, frames·192] into [N·frames, 8h, 8w, 3].
fn unfold(x: Tensor<4>, frames: usize) -> Tensor<4> {
    let [n, h, w, _] = x.dims();
    let x: Tensor<7> = x.reshape([n, h, w, frames, BLOCK_PX, BLOCK_PX, 3]);
    x.permute([0, 3, 1, 4, 2, 5, 6]).reshape([n * frames, h * BLOCK_PX, w * BLOCK_PX, 3])
}

impl Autoencoder for TinyAe {
    fn encode(&self, steps: &Array, memory: &mut Memory) -> Array {
        Self::encode(self, steps, memory)
    }

    fn decode(&self, latents: &Array, guide: Option<&Array>, memory: &mut Memory) -> Array {
        Self::decode(self, latents, guide, memory)
    }
}
