//! Floating-point operations of the networks, counted as two per multiply-add of products, attention and
//! convolutions; padding, norms and activations are not counted.

use crate::discriminator::DiscriminatorShape;
use crate::dit::{CLIP_STATES, DitShape};
use crate::tiny_ae::{AeShape, EncoderStage};

/// Counts denoising a chunk of `frames` frames against `cached` frames, without the control latent.
#[must_use]
pub fn denoise(shape: &DitShape, frames: usize, cached: usize) -> f64 {
    let (d, rows) = (shape.dim as f64, (frames * shape.tokens()) as f64);
    let keys = ((frames + cached) * shape.tokens()) as f64;
    let image = if shape.image_context { shape.tokens() } else { 0 };
    let states = if shape.clip_dim > 0 { CLIP_STATES } else { 0 };
    let context = (shape.text_len + image + states) as f64;
    let mut total = 2.0 * rows * 4.0 * d * (shape.in_dim() + shape.latent_channels) as f64;
    for layer in 0..shape.layers {
        total += 2.0 * rows * (4.0 * d * d + 2.0 * d * shape.ffn as f64) + 4.0 * rows * keys * d;
        if shape.crosses(layer) {
            total += 2.0 * rows * 2.0 * d * d + 4.0 * rows * context * d;
        }
    }
    total
}

/// Counts a training step over a sequence of `rows` rows, `layout_frames` of whose frames have layouts of their own, and
/// that attends to `pairs` pairs of query and key rows: forward once, and twice that backward.
#[must_use]
pub fn train(shape: &DitShape, [rows, layout_frames, pairs]: [usize; 3]) -> f64 {
    let tokens = shape.tokens();
    let dense = denoise(shape, 1, 0) - 4.0 * (tokens * tokens * shape.dim * shape.layers) as f64;
    let attention = 4.0 * (pairs * shape.dim * shape.layers) as f64;
    3.0 * (dense * rows as f64 / tokens as f64 + attention + control(shape, layout_frames))
}

/// Counts the control latent of `frames` frames.
#[must_use]
pub fn control(shape: &DitShape, frames: usize) -> f64 {
    2.0 * (frames * shape.tokens() * 4 * shape.control_inputs * shape.control_channels) as f64
}

/// Counts encoding `steps` latent frames of `h`×`w` pixels.
#[must_use]
pub fn encode(shape: &AeShape, steps: usize, h: usize, w: usize) -> f64 {
    let stages = shape.encoder();
    let stage = |stage: &EncoderStage| {
        stage.scale * stage.scale * stage.width * (stage.inputs + stage.blocks * 9 * 3 * stage.width)
    };
    let head = stages.last().map_or(0, |last| 9 * last.width * shape.z);
    2.0 * (steps * h * w * (stages.iter().map(stage).sum::<usize>() + shape.inputs() * shape.z + head)) as f64
}

/// Counts decoding `steps` latent frames of `h`×`w` pixels.
#[must_use]
pub fn decode(shape: &AeShape, steps: usize, h: usize, w: usize) -> f64 {
    let [growth, last] = shape.growth();
    let frames = [1, growth, growth * last];
    let skip = if shape.decoder_skip { shape.z * shape.inputs() } else { 0 };
    let (widths, mut total) = (shape.decoder_widths, 9 * shape.z * shape.decoder_widths[0] + skip);
    for stage in 0..3 {
        let pixels = frames[stage] << (2 * stage);
        total += pixels * shape.decoder_blocks[stage] * 9 * 3 * widths[stage] * widths[stage];
        if stage < 2 {
            total += pixels * widths[stage] * shape.growth()[stage] * 4 * widths[stage + 1];
        }
    }
    let guide = shape.guides * (widths[2] + shape.seen()) * widths[2];
    let blend = if shape.carried { 4 } else { 0 };
    total += (frames[2] << 4) * 9 * (guide + widths[2] * (12 + blend));
    let sketch = shape.sketch();
    for (index, level) in sketch.iter().enumerate() {
        let grow = sketch.get(index + 1).map_or(0, |next| level.width * 4 * next.width);
        total += (frames[2] << (2 * index)) * (9 * (level.grown + level.layout) * level.width + grow);
    }
    2.0 * (steps * h * w * total) as f64
}

/// Counts the verdict of a discriminator on `frames` frames of 8h×8w pixels.
#[must_use]
pub fn judge(shape: &DiscriminatorShape, frames: usize, h: usize, w: usize) -> f64 {
    let outputs = shape.widths.into_iter().chain([1]);
    let layers = shape.inputs().into_iter().zip(outputs).zip([16, 4, 1, 1]);
    let total: usize = layers.map(|((inputs, outputs), pixels)| 9 * inputs * outputs * pixels).sum();
    2.0 * (frames * h * w * total) as f64
}
