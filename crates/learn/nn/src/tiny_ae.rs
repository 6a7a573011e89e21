//! The tiny causal video autoencoder as values: its sizes, the weights that they ask for, and the memory of a rollout.
//!
//! A latent step stands for `stride_t` frames. The encoder takes space-to-depth frames [steps, h, w, stride_t·192]
//! (frame, row, column, colour inside an 8×8 block, values −1 to 1) and gives [steps, h, w, z]. It works at 1/8
//! resolution alone, or in stages: at 1/2 resolution, where detail still is, then folded to 1/4 and 1/8. The decoder
//! grows space three times and time twice: the last stage runs at half resolution and ends in a pixel shuffle. Beside
//! the encoder runs a linear map from block to latent pixel, so that training begins at principal components; beside
//! the decoder one back, where it is asked for: it paints blocks, whose borders show. The first
//! stride_t − 1 frames of a rollout are for the caller to drop.
//!
//! Beside what folds two by two pixels between the stages of an encoder, and beside what grows them in its decoder,
//! runs a shortcut without weights that averages or copies channels (DC-AE, arXiv 2410.10733). Both are linear in the
//! same values, so that their sum is one layer, which begins at the shortcut.
//!
//! Guides are convolutions behind the decoder's last stage that see the layout of each frame beside what is there. What they see may be
//! a sketch: features of the layout that begin at 1/8 resolution, where a convolution spans a whole vehicle, and grow twice, seeing the
//! layout again at 1/4 and 1/2. Nothing of it is remembered, so that memories do not depend on layouts. Where frames are carried, guides
//! also see, at 1/2 resolution, a frame from before as it would look from here, and how much of it may be kept; a last convolution tells
//! for each pixel which share of it is carried and not painted.

use std::any::Any;

use ds_space::{Digest, DigestWriter};

use crate::array::{Declared, Initial};

/// Side of the pixel block that a latent pixel stands for.
pub const BLOCK_PX: usize = 8;

/// Sizes of the autoencoder.
#[derive(Debug, Clone, PartialEq)]
pub struct AeShape {
    /// Latent channels.
    pub z: usize,
    /// Frames per latent step: 1, 2 or 4.
    pub stride_t: usize,
    /// Widths of the encoder's stages, one or three, of which the last is at 1/8 resolution.
    pub encoder_widths: Vec<usize>,
    /// Memory blocks of each stage.
    pub encoder_blocks: Vec<usize>,
    /// Widths of the decoder's three stages (1/8, 1/4 and 1/2 resolution).
    pub decoder_widths: [usize; 3],
    /// Memory blocks of each stage.
    pub decoder_blocks: [usize; 3],
    /// Whether a linear map from latent pixel to block runs beside the decoder.
    pub decoder_skip: bool,
    /// Convolutions after the decoder's last stage that also see the layout of each frame; 0 for none.
    pub guides: usize,
    /// Widths at 1/8, 1/4 and 1/2 resolution of the sketch that the guides see; without it they see the layout itself.
    pub sketch_widths: Option<[usize; 3]>,
    /// Whether the guides also see a carried frame.
    pub carried: bool,
}

/// Gain of what is drawn beside a shortcut.
const SHORTCUT_GAIN: f32 = 0.5;

/// Channels of a layout at 1/2 resolution: two by two pixels of three colours.
pub const LAYOUT_CHANNELS: usize = 12;

/// Channels of a carried frame at 1/2 resolution: two by two pixels of three colours and of whether there is one.
pub const CARRIED_CHANNELS: usize = 16;

/// A stage of the encoder: a linear layer to `width` channels, and memory blocks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EncoderStage {
    /// What the names of its layers begin with.
    pub name: String,
    /// Values that its linear layer sees: a block of the frames, or two by two pixels of the stage before.
    pub inputs: usize,
    /// Channels.
    pub width: usize,
    /// Memory blocks.
    pub blocks: usize,
    /// Its pixels for each side of a latent pixel: 4, 2 or 1.
    pub scale: usize,
}

/// A level of the sketch: what goes in and comes out of its convolution.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SketchLevel {
    /// Channels that grew from the level above; 0 for the first.
    pub grown: usize,
    /// Channels of the layout, folded.
    pub layout: usize,
    /// Channels that come out.
    pub width: usize,
}

impl AeShape {
    /// Returns the input values of a latent pixel.
    #[must_use]
    pub fn inputs(&self) -> usize {
        self.stride_t * BLOCK_PX * BLOCK_PX * 3
    }

    /// Returns the stages of the encoder, in order.
    #[must_use]
    pub fn encoder(&self) -> Vec<EncoderStage> {
        let last = self.encoder_widths.len() - 1;
        let stage = |(index, (width, blocks)): (usize, (&usize, &usize))| EncoderStage {
            name: if last == 0 { "encoder".to_owned() } else { format!("encoder.stage.{index}") },
            inputs: if index == 0 { self.inputs() >> (2 * last) } else { 4 * self.encoder_widths[index - 1] },
            width: *width,
            blocks: *blocks,
            scale: 1 << (last - index),
        };
        self.encoder_widths.iter().zip(&self.encoder_blocks).enumerate().map(stage).collect()
    }

    /// Cuts the 8×8 blocks of latent pixels, `w` to a row, into the smaller blocks that the encoder's first stage takes:
    /// [steps, h, w, inputs] to [steps, s·h, s·w, inputs / s²], each (frame, row, column, colour).
    #[must_use]
    pub fn cut(&self, blocks: &[f32], w: usize) -> Vec<f32> {
        let (cuts, inputs) = (1 << (self.encoder_widths.len() - 1), self.inputs());
        let side = BLOCK_PX / cuts;
        let (run, small) = (3 * side, inputs / (cuts * cuts));
        let mut out = vec![0.0; blocks.len()];
        for (at, part) in blocks.chunks_exact(run).enumerate() {
            let (cut_x, y, frame) = (at % cuts, at / cuts % BLOCK_PX, at / cuts / BLOCK_PX % self.stride_t);
            let pixel = at * run / inputs;
            let (line, x) = (pixel / w * cuts + y / side, pixel % w * cuts + cut_x);
            let to = (line * w * cuts + x) * small + (frame * side + y % side) * run;
            out[to..to + run].copy_from_slice(part);
        }
        out
    }

    /// Returns by how much each of the two growing steps multiplies frames.
    #[must_use]
    pub fn growth(&self) -> [usize; 2] {
        [if self.stride_t == 4 { 2 } else { 1 }, if self.stride_t >= 2 { 2 } else { 1 }]
    }

    /// Returns the levels of the sketch, from 1/8 to 1/2 resolution; none where the guides see the layout itself.
    #[must_use]
    pub fn sketch(&self) -> Vec<SketchLevel> {
        let widths = self.sketch_widths.filter(|_| self.guides > 0);
        let level = |(index, width)| SketchLevel {
            grown: if index == 0 { 0 } else { width },
            layout: LAYOUT_CHANNELS << (2 * (2 - index)),
            width,
        };
        widths.into_iter().flatten().enumerate().map(level).collect()
    }

    /// Returns the channels of a pixel of what guides a frame: three of its layout, and of a carried frame three and a fourth: how
    /// much of it may be kept, 0 where there is none.
    #[must_use]
    pub fn guide_channels(&self) -> usize {
        if self.carried { 7 } else { 3 }
    }

    /// Returns the channels of sketch or layout that a guide sees.
    #[must_use]
    pub fn drawn(&self) -> usize {
        self.sketch().last().map_or(LAYOUT_CHANNELS, |level| level.width)
    }

    /// Returns the channels that a guide sees beside the image: sketch or layout, then the carried frame.
    #[must_use]
    pub fn seen(&self) -> usize {
        self.drawn() + if self.carried { CARRIED_CHANNELS } else { 0 }
    }

    /// Lists the convolutions that see layouts themselves, or frames carried by their geometry, with how many of their last input
    /// channels are of these.
    #[must_use]
    pub fn layout_inputs(&self) -> Vec<(String, usize)> {
        let sketch = self.sketch();
        let level = |(index, level): (usize, &SketchLevel)| (format!("decoder.guide.sketch.{index}"), level.layout);
        let direct = self.seen() - if sketch.is_empty() { 0 } else { self.drawn() };
        let guides = (0..self.guides).map(|index| (format!("decoder.guide.{index}"), direct));
        sketch.iter().enumerate().map(level).chain(guides.filter(|_| direct > 0)).collect()
    }

    /// Lists the weights, under `encoder.` and `decoder.`.
    #[must_use]
    pub fn declare(&self) -> Vec<Declared> {
        let mut list = Vec::new();
        let convolution = Declared::convolution;
        let block = |list: &mut Vec<Declared>, name: &str, width: usize| {
            convolution(list, &format!("{name}.conv.0"), 2 * width, width, 1.4);
            convolution(list, &format!("{name}.conv.2"), width, width, 0.7);
        };
        let encoder = self.encoder();
        for (index, stage) in encoder.iter().enumerate() {
            let std = |gain: f32| gain / (stage.inputs as f32).sqrt();
            let initial = if index == 0 { Initial::Normal(std(1.4)) } else { Initial::Folded(std(SHORTCUT_GAIN)) };
            Declared::layer(&mut list, &format!("{}.fold", stage.name), [stage.width, stage.inputs], initial);
            for index in 0..stage.blocks {
                block(&mut list, &format!("{}.block.{index}", stage.name), stage.width);
            }
        }
        convolution(&mut list, "encoder.head", self.encoder_widths[encoder.len() - 1], self.z, 0.3);
        Declared::linear(&mut list, "encoder.skip", self.inputs(), self.z, 1.0);
        let widths = self.decoder_widths;
        convolution(&mut list, "decoder.stem", self.z, widths[0], 1.4);
        for stage in 0..3 {
            for index in 0..self.decoder_blocks[stage] {
                block(&mut list, &format!("decoder.stage.{stage}.block.{index}"), widths[stage]);
            }
            if stage < 2 {
                let (frames, inputs) = (self.growth()[stage], widths[stage]);
                let std = |gain: f32| gain / (inputs as f32).sqrt();
                let grown = Initial::Grown { frames, std: std(SHORTCUT_GAIN) };
                let initial = if encoder.len() == 1 { Initial::Normal(std(1.4)) } else { grown };
                let name = format!("decoder.stage.{stage}.grow");
                Declared::layer(&mut list, &name, [frames * 4 * widths[stage + 1], inputs], initial);
            }
        }
        let sketch = self.sketch();
        for (index, level) in sketch.iter().enumerate() {
            let name = format!("decoder.guide.sketch.{index}");
            convolution(&mut list, &name, level.grown + level.layout, level.width, 1.4);
            if let Some(next) = sketch.get(index + 1) {
                Declared::linear(&mut list, &format!("{name}.grow"), level.width, 4 * next.width, 1.4);
            }
        }
        for index in 0..self.guides {
            convolution(&mut list, &format!("decoder.guide.{index}"), widths[2] + self.seen(), widths[2], 0.5);
        }
        convolution(&mut list, "decoder.head", widths[2], LAYOUT_CHANNELS, 0.1);
        if self.carried {
            convolution(&mut list, "decoder.guide.blend", widths[2], 4, 0.1);
        }
        if self.decoder_skip {
            Declared::linear(&mut list, "decoder.skip", self.z, self.inputs(), 0.5);
        }
        list
    }
}

/// What a body remembers of a rollout.
pub trait Remembered: Any + Send + Sync {
    /// Adds all frames to a digest.
    fn digest_into(&self, writer: &mut DigestWriter);

    /// Returns a copy that shares the frames.
    fn snapshot(&self) -> Box<dyn Remembered>;
}

/// The memories of all blocks of an encoder or decoder: one frame each, absent at the start of a rollout. It belongs to
/// the body that first filled it.
#[derive(Default)]
pub struct Memory(Option<Box<dyn Remembered>>);

impl Clone for Memory {
    fn clone(&self) -> Self {
        Self(self.0.as_deref().map(Remembered::snapshot))
    }
}

impl Memory {
    /// Returns the digest of the memorised frames.
    #[must_use]
    pub fn digest(&self) -> Digest {
        let mut writer = DigestWriter::new();
        if let Some(held) = &self.0 {
            held.digest_into(&mut writer);
        }
        writer.finish()
    }

    /// Returns what the body remembers.
    ///
    /// # Panics
    /// If another body filled the memory.
    pub fn of<T: Remembered + Default>(&mut self) -> &mut T {
        let held: &mut dyn Any = &mut **self.0.get_or_insert_with(|| Box::new(T::default()));
        held.downcast_mut().expect("a memory belongs to the body that filled it")
    }
}
