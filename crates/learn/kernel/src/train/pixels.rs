//! Steps of the autoencoder and of the guided decoder: equal to `ds_graph::step::autoencoder` and
//! `ds_graph::step::decoder`.

use ds_nn::array::{Array, Weights};
use ds_nn::step::{AeBatch, DecoderBatch, Step};
use ds_nn::tiny_ae::{AeShape, BLOCK_PX};

use super::autoencoder::Network;

/// How much the error of the image gradients counts beside that of the values.
const GRADIENTS: f64 = 0.1;

/// Computes a reconstruction step.
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "sums are taken in double precision")]
pub fn autoencoder(shape: &AeShape, weights: &Weights, batch: &AeBatch) -> Step {
    let (network, mut gradient) = (Network::new(shape, weights), weights.zeros_like());
    let [steps, h, w, _]: [usize; 4] = batch.folded.shape().try_into().expect("folded frames have four axes");
    let size = [steps, h, w];
    let encoded = network.encode(batch.folded.values(), size, batch.clips);
    let count = encoded.latents.len() as f64;
    let square = encoded.latents.iter().map(|z| f64::from(*z).powi(2)).sum::<f64>() / count;
    let rms = square.sqrt() as f32;
    let noisy: Vec<f32> = encoded.latents.iter().zip(batch.noise.values()).map(|(z, noise)| z + noise * rms).collect();
    // A guided decoder is not guided here, as in the framework's step.
    let none = (shape.guides > 0).then(|| vec![0.0; batch.frames.values().len() / 3 * shape.guide_channels()]);
    let mut decoded = network.decode(&noisy, none.as_deref(), size, batch.clips);
    let mut frames = std::mem::take(&mut decoded.frames);
    let (loss, mut parts) = reconstruction(&mut frames, &batch.frames, &batch.emphasis, None);
    let mut d = network.decode_back(&decoded, size, batch.clips, &mut frames, &mut gradient);
    let penalty = 2.0 * batch.latent_penalty / count as f32;
    d.iter_mut().zip(&encoded.latents).for_each(|(d, z)| *d += penalty * z);
    network.encode_back(&encoded, size, batch.clips, &d, &mut gradient);
    parts.push(("z2", square as f32));
    Step { loss: loss + square as f32 * batch.latent_penalty, parts, gradient }
}

/// Computes a decoder step: gradients for the decoder's weights alone.
#[must_use]
pub fn decoder(shape: &AeShape, weights: &Weights, batch: &DecoderBatch) -> Step {
    let (network, mut gradient) = (Network::new(shape, weights), weights.zeros_like());
    let [steps, h, w, _]: [usize; 4] = batch.latents.shape().try_into().expect("latents have four axes");
    let (size, guide) = ([steps, h, w], (shape.guides > 0).then(|| batch.guide.values()));
    let mut decoded = network.decode(batch.latents.values(), guide, size, batch.clips);
    let mut frames = std::mem::take(&mut decoded.frames);
    let (loss, parts) = reconstruction(&mut frames, &batch.frames, &batch.emphasis, Some(batch));
    network.decode_back(&decoded, size, batch.clips, &mut frames, &mut gradient);
    for name in weights.iter().map(|(name, _)| name).filter(|name| name.starts_with("encoder.")) {
        gradient.remove(name);
    }
    Step { loss, parts, gradient }
}

/// Turns frames into the gradient of the reconstruction loss, and returns the loss with its parts; change and texture count as a
/// decoder's batch asks for.
#[expect(clippy::cast_possible_truncation, reason = "sums are taken in double precision")]
pub(super) fn reconstruction(
    frames: &mut [f32],
    target: &Array,
    emphasis: &Array,
    batch: Option<&DecoderBatch>,
) -> (f32, Vec<(&'static str, f32)>) {
    let [images, h, w, c]: [usize; 4] = target.shape().try_into().expect("frames have four axes");
    let error: Vec<f32> = frames.iter().zip(target.values()).map(|(found, wanted)| found - wanted).collect();
    let weight = emphasis.values();
    let clip = batch.map_or(images, |batch| images / batch.clips);
    let textured = batch.filter(|batch| batch.texture > 0.0).map(|batch| texture(frames, target, batch.texture));
    // The pixel a difference is taken to, counted back, the first column, row and frame that have one, and how much it counts.
    let mut terms = vec![(0, [0, 0, 0], 1.0), (1, [1, 0, 0], GRADIENTS), (w, [0, 1, 0], GRADIENTS)];
    let change = batch.map(|batch| f64::from(batch.change)).filter(|change| *change > 0.0);
    terms.extend(change.map(|change| (h * w, [0, 0, 1], change)));
    let mut losses = vec![0.0; terms.len()];
    frames.fill(0.0);
    for ((back, [left, top, first], share), loss) in terms.into_iter().zip(&mut losses) {
        let pixels = || {
            let inside = move |at: &usize| at % w >= left && at / w % h >= top && at / (w * h) % clip >= first;
            (0..images * h * w).filter(inside)
        };
        let total = c as f64 * pixels().map(|at| f64::from(weight[at])).sum::<f64>();
        let mut sum = 0.0;
        for at in pixels() {
            let slope = (share * f64::from(weight[at]) / total) as f32;
            for channel in at * c..at * c + c {
                let other = if back == 0 { 0.0 } else { error[channel - back * c] };
                let difference = error[channel] - other;
                sum += f64::from(difference.abs()) * f64::from(weight[at]);
                let slope = if difference == 0.0 { 0.0 } else { slope.copysign(difference) };
                frames[channel] += slope;
                if back > 0 {
                    frames[channel - back * c] -= slope;
                }
            }
        }
        *loss = share * sum / total;
    }
    let mse = error.iter().map(|error| f64::from(*error).powi(2)).sum::<f64>() / error.len() as f64;
    // The peak-to-peak range is 2.
    let parts = vec![("l1", losses[0] as f32), ("psnr_db", (10.0 * (4.0 / mse).log10()) as f32)];
    if let Some((loss, gradient)) = textured {
        losses.push(loss);
        frames.iter_mut().zip(&gradient).for_each(|(d, more)| *d += more);
    }
    (losses.iter().sum::<f64>() as f32, parts)
}

/// Returns how far the mean differences of neighbours within blocks are from those of the target, so often, and the gradient.
#[expect(clippy::cast_possible_truncation, reason = "sums are taken in double precision")]
fn texture(frames: &[f32], target: &Array, weight: f32) -> (f64, Vec<f32>) {
    let [images, h, w, c]: [usize; 4] = target.shape().try_into().expect("frames have four axes");
    // A value and the next in its row and column, within a block.
    let inner = |at: usize| at % BLOCK_PX + 1 < BLOCK_PX;
    let pairs = |block: [usize; 3]| {
        let [image, top, left] = block;
        let pixels = (0..BLOCK_PX * BLOCK_PX).map(move |at| (at / BLOCK_PX, at % BLOCK_PX));
        pixels.flat_map(move |(y, x)| {
            let pixel = (image * h + top * BLOCK_PX + y) * w + left * BLOCK_PX + x;
            let steps = [(inner(x), 1), (inner(y), w)].into_iter().filter(|(inside, _)| *inside);
            steps.flat_map(move |(_, step)| {
                (0..c).map(move |channel| (pixel * c + channel, (pixel + step) * c + channel))
            })
        })
    };
    let sum = |values: &[f32], block| {
        pairs(block).map(|(from, to)| f64::from((values[to] - values[from]).abs())).sum::<f64>()
    };
    let (rows, columns) = (h / BLOCK_PX, w / BLOCK_PX);
    let each = f64::from(weight) / (images * rows * columns * 2 * BLOCK_PX * (BLOCK_PX - 1) * c) as f64;
    let (mut loss, mut gradient) = (0.0, vec![0.0; frames.len()]);
    for at in 0..images * rows * columns {
        let block = [at / (rows * columns), at / columns % rows, at % columns];
        let excess = sum(frames, block) - sum(target.values(), block);
        loss += each * excess.abs();
        let slope = if excess == 0.0 { 0.0 } else { each.copysign(excess) as f32 };
        for (from, to) in pairs(block) {
            let difference = frames[to] - frames[from];
            let slope = if difference == 0.0 { 0.0 } else { slope * difference.signum() };
            gradient[to] += slope;
            gradient[from] -= slope;
        }
    }
    (loss, gradient)
}
