//! The tiny autoencoder on padded images: the counterpart of `ds_graph::tiny_ae::TinyAe`, one rollout at a time.
//!
//! A memory is the last input frame of a block with its border.

use std::sync::Arc;

use ds_nn::array::{Array, Weights, WeightsError, digest_values};
use ds_nn::body::Autoencoder;
use ds_nn::tiny_ae::{AeShape, BLOCK_PX, Memory, Remembered};
use ds_space::DigestWriter;
use rayon::prelude::*;

use super::Buffer;
use super::arch::Arch;
use super::blend;
use super::buffer::Pool;
use super::convolution::Convolution;
use super::growth::{Growth, folded};
use super::guide::{Guides, Seen};
use super::image::Image;
use super::network::Named;
use super::panels::Packed;
use super::product::{Finish, Source, Target, product};

/// The memories of all blocks.
#[derive(Clone, Default)]
struct Frames(Vec<Option<Arc<Buffer>>>);

impl Remembered for Frames {
    fn digest_into(&self, writer: &mut DigestWriter) {
        for frame in &self.0 {
            writer.bool(frame.is_some());
            if let Some(frame) = frame {
                digest_values(writer, frame);
            }
        }
    }

    fn snapshot(&self) -> Box<dyn Remembered> {
        Box::new(self.clone())
    }
}

struct MemoryBlock {
    first: Convolution,
    second: Convolution,
}

/// A stage of the encoder: what folds into it, and its blocks.
struct Folding {
    layer: Packed,
    blocks: Vec<MemoryBlock>,
}

struct Stage {
    blocks: Vec<MemoryBlock>,
    grow: Option<Growth>,
}

/// Buffers of one encoding or decoding.
#[derive(Default)]
struct Scratch {
    /// Input, inner and output images of each stage.
    stages: [[Image; 3]; 3],
    latent: Image,
    seen: Seen,
    told: Image,
    skip: Buffer,
}

/// The autoencoder with packed weights.
pub struct FastAe {
    shape: AeShape,
    arch: Arch,
    encoder: Vec<Folding>,
    encoder_head: Convolution,
    encoder_skip: Packed,
    stem: Convolution,
    stages: Vec<Stage>,
    guides: Guides,
    decoder_head: Convolution,
    blend: Option<Convolution>,
    decoder_skip: Option<Packed>,
    scratch: Arc<Pool<Scratch>>,
}

impl FastAe {
    /// Packs weights.
    ///
    /// # Errors
    /// If the weights do not fit the shape.
    pub fn new(shape: &AeShape, weights: &Weights) -> Result<Self, WeightsError> {
        weights.check(&shape.declare())?;
        let named = Named(weights);
        let linear = |name: &str| named.linear(&[name.to_owned()]);
        let convolution = |name: &str, inputs: &[usize]| named.convolution(name, inputs);
        let blocks = |name: &str, count: usize, width: usize| -> Vec<MemoryBlock> {
            let block = |index: usize| MemoryBlock {
                first: convolution(&format!("{name}.block.{index}.conv.0"), &[width, width]),
                second: convolution(&format!("{name}.block.{index}.conv.2"), &[width]),
            };
            (0..count).map(block).collect()
        };
        let widths = shape.decoder_widths;
        let stage = |stage: usize| {
            let name = format!("decoder.stage.{stage}");
            let grow = |next: &usize| Growth::new(&named, &format!("{name}.grow"), widths[stage], *next);
            Stage {
                blocks: blocks(&name, shape.decoder_blocks[stage], widths[stage]),
                grow: widths.get(stage + 1).map(grow),
            }
        };
        Ok(Self {
            arch: Arch::new(),
            encoder_head: convolution("encoder.head", &shape.encoder_widths[shape.encoder_widths.len() - 1..]),
            encoder: shape
                .encoder()
                .iter()
                .map(|stage| Folding {
                    layer: linear(&format!("{}.fold", stage.name)),
                    blocks: blocks(&stage.name, stage.blocks, stage.width),
                })
                .collect(),
            encoder_skip: linear("encoder.skip"),
            stem: convolution("decoder.stem", &[shape.z]),
            stages: (0..3).map(stage).collect(),
            guides: Guides::new(shape, &named),
            decoder_head: convolution("decoder.head", &[widths[2]]),
            blend: shape.carried.then(|| convolution("decoder.guide.blend", &[widths[2]])),
            decoder_skip: shape.decoder_skip.then(|| linear("decoder.skip")),
            scratch: Arc::default(),
            shape: shape.clone(),
        })
    }

    /// Runs the blocks of a stage; the result lies in the first image.
    fn blocks(&self, blocks: &[MemoryBlock], images: &mut [Image; 3], memory: &mut Frames, at: &mut usize) {
        for block in blocks {
            let [x, inner, out] = images;
            if memory.0.len() <= *at {
                memory.0.resize(*at + 1, None);
            }
            let kept = memory.0[*at].get_or_insert_with(|| Arc::new(Buffer::zeros(x.frame(0).len())));
            inner.reset(x.size());
            out.reset(x.size());
            let (input, before): (&Image, &[f32]) = (x, kept);
            let pair = |frame: usize| [input.frame(frame), if frame == 0 { before } else { input.frame(frame - 1) }];
            block.first.apply(self.arch, pair, inner, |_, _| Finish::Relu);
            let inner: &Image = inner;
            let other = |frame, y| Finish::ReluOfSum(input.row(frame, y));
            block.second.apply(self.arch, |frame| [inner.frame(frame), &[]], out, other);
            let last = input.frame(input.frames - 1);
            match Arc::get_mut(kept) {
                Some(kept) => kept.copy_from_slice(last),
                None => *kept = Arc::new(Buffer::of(last)),
            }
            images.swap(0, 2);
            *at += 1;
        }
    }

    /// Applies a linear layer to pixels, in parallel.
    fn pixels(&self, packed: &Packed, x: &[f32], y: &mut [f32]) {
        const PIXELS: usize = 64;
        let parts = x.par_chunks(PIXELS * packed.depth).zip(y.par_chunks_mut(PIXELS * packed.columns));
        parts.for_each(|(x, y)| {
            let source = Source::rows(x, packed.depth);
            let rows = x.len() / packed.depth;
            product(self.arch, rows, &[source], packed, Target::rows(y, packed.columns), Finish::Plain);
        });
    }

    /// Writes frames of 8h×8w pixels: the head's shuffled pixels plus the linear map of the latents, if there is one.
    fn paint(&self, x: &Image, skip: Option<&[f32]>) -> Array {
        let (w, inputs, strides) = (x.w, self.shape.inputs(), self.shape.stride_t);
        let mut frames = Array::zeros(&[x.frames, 2 * x.h, 2 * w, 3]);
        let (columns, rows) = (2 * w / BLOCK_PX, 2 * x.h / BLOCK_PX);
        let lines = frames.values_mut().par_chunks_mut(2 * 2 * w * 3).enumerate().with_min_len(2);
        lines.for_each_init(Vec::new, |shuffled: &mut Vec<f32>, (index, lines)| {
            let (frame, y) = (index / x.h, index % x.h);
            shuffled.resize(w * 12, 0.0);
            let target = Target::rows(shuffled, 12);
            self.decoder_head.row(self.arch, &[x.frame(frame)], y, w, target, Finish::Plain);
            for (dy, line) in lines.chunks_exact_mut(2 * w * 3).enumerate() {
                for (pair, head) in line.chunks_exact_mut(6).zip(shuffled.chunks_exact(12)) {
                    pair.copy_from_slice(&head[dy * 6..][..6]);
                }
                let Some(skip) = skip else { continue };
                let pixel_y = 2 * y + dy;
                let first = (frame / strides * rows + pixel_y / BLOCK_PX) * columns;
                let inside = (frame % strides * BLOCK_PX + pixel_y % BLOCK_PX) * BLOCK_PX * 3;
                for (at, pair) in line.chunks_exact_mut(6).enumerate() {
                    let skip = &skip[(first + 2 * at / BLOCK_PX) * inputs + inside + 2 * at % BLOCK_PX * 3..][..6];
                    pair.iter_mut().zip(skip).for_each(|(to, value)| *to += value);
                }
            }
        });
        frames
    }
}

impl Autoencoder for FastAe {
    fn encode(&self, steps: &Array, memory: &mut Memory) -> Array {
        let [frames, h, w, inputs]: [usize; 4] = steps.shape().try_into().expect("steps have four axes");
        let mut scratch = self.scratch.take(Scratch::default);
        let Scratch { stages, latent, skip, .. } = &mut *scratch;
        let (memory, mut at, last) = (memory.of(), 0, self.encoder.len() - 1);
        latent.reset([frames, h << last, w << last, inputs >> (2 * last)]);
        latent.fill(&self.shape.cut(steps.values(), w));
        // The images of the finest stage come last, as in the decoder.
        for (index, stage) in self.encoder.iter().enumerate() {
            let (coarse, fine) = stages.split_at_mut(last - index + 1);
            let now = &mut coarse[last - index];
            match fine.first().filter(|_| index > 0) {
                Some([below, ..]) => folded(self.arch, &stage.layer, 2, below, &mut now[0]),
                None => folded(self.arch, &stage.layer, 1, latent, &mut now[0]),
            }
            self.blocks(&stage.blocks, now, memory, &mut at);
        }
        skip.resize(frames * h * w * self.shape.z);
        self.pixels(&self.encoder_skip, steps.values(), skip);
        let (x, z) = (&stages[0][0], self.shape.z);
        let mut latents = Array::new(&[frames, h, w, z], skip.to_vec());
        latents.values_mut().par_chunks_mut(w * z).enumerate().for_each(|(index, row)| {
            let image = x.frame(index / h);
            self.encoder_head.row(self.arch, &[image], index % h, w, Target::rows(row, z), Finish::Add);
        });
        latents
    }

    fn decode(&self, latents: &Array, guide: Option<&Array>, memory: &mut Memory) -> Array {
        let [frames, h, w, z]: [usize; 4] = latents.shape().try_into().expect("latents have four axes");
        let memory = memory.of::<Frames>();
        let mut scratch = self.scratch.take(Scratch::default);
        let Scratch { stages, latent, seen, told, skip } = &mut *scratch;
        if let Some(packed) = &self.decoder_skip {
            skip.resize(frames * h * w * self.shape.inputs());
            self.pixels(packed, latents.values(), skip);
        }
        latent.reset([frames, h, w, z]);
        latent.fill(latents.values());
        stages[0][0].reset([frames, h, w, self.stem.outputs()]);
        let latent: &Image = latent;
        self.stem.apply(self.arch, |frame| [latent.frame(frame), &[]], &mut stages[0][0], |_, _| Finish::Relu);
        let mut at = 0;
        for (index, stage) in self.stages.iter().enumerate() {
            self.blocks(&stage.blocks, &mut stages[index], memory, &mut at);
            if let ([now, next, ..], Some(grow)) = (&mut stages[index..], &stage.grow) {
                grow.apply(self.arch, self.shape.growth()[index], &now[0], &mut next[0]);
            }
        }
        let [x, _, out] = &mut stages[2];
        self.guides.apply(self.arch, guide, [x, out], seen);
        let mut frames = self.paint(x, self.decoder_skip.is_some().then_some(&**skip));
        let carried = guide.filter(|guide| guide.shape()[3] == self.shape.guide_channels());
        if let Some((blend, guide)) = self.blend.as_ref().zip(carried) {
            let x: &Image = x;
            told.reset([x.frames, x.h, x.w, blend.outputs()]);
            blend.apply(self.arch, |frame| [x.frame(frame), &[]], told, |_, _| Finish::Plain);
            blend::mix(frames.values_mut(), told, guide.values());
        }
        frames
    }
}
