//! The adversarial step of a decoder, equal to `ds_graph::step::adversarial`: how it is to draw so that a discriminator takes its frames for true ones, and how
//! the discriminator is to tell them apart.
//!
//! Losses are hinges over patches; the discriminator is kept smooth around true frames by a penalty on what a little
//! noise changes (approximate R1, arXiv 2501.08316). The decoder also meets the discriminator's features of the true
//! frames where these are the target (feature matching, arXiv 1711.11585). The adversarial gradient is brought to a set
//! share of the reconstruction's at the frames: too weak a one leaves blur, too strong a one noise.

use ds_nn::array::Weights;
use ds_nn::discriminator::{DiscriminatorShape, SEEN};
use ds_nn::step::{Adversary, DecoderBatch, Step};
use ds_nn::tiny_ae::AeShape;

use super::autoencoder::Network;
use super::convolution::Layer;
use super::images::{copied, filled, folded, shuffled, sized, unfolded, unshuffled};
use super::pixels::reconstruction;
use crate::arch::Arch;
use crate::image::Image;
use crate::product::Finish;

/// What is left of negative values.
const LEAK: f32 = 0.2;

/// The discriminator's layers with their weights packed.
struct Discriminator {
    arch: Arch,
    layers: Vec<Layer>,
}

/// What its backward pass needs: what each layer takes in, and what comes out; the last are the verdicts.
struct Pass {
    inputs: Vec<Image>,
    outputs: Vec<Image>,
}

impl Pass {
    fn verdicts(&self) -> Vec<f32> {
        self.outputs[self.outputs.len() - 1].dense().to_vec()
    }
}

impl Discriminator {
    fn new(shape: DiscriminatorShape, weights: &Weights) -> Self {
        let layer = |(index, inputs)| Layer::new(weights, format!("layer.{index}"), &[inputs], 1);
        Self { arch: Arch::new(), layers: shape.inputs().into_iter().enumerate().map(layer).collect() }
    }

    /// Looks at pairs of neighbouring frames with their layouts.
    fn look(&self, frames: &[f32], batch: &DecoderBatch) -> Pass {
        let (mut inputs, mut outputs) = (vec![joined(frames, batch)], Vec::<Image>::new());
        for (index, layer) in self.layers.iter().enumerate() {
            if let Some(below) = outputs.last().filter(|_| index > 0) {
                inputs.push(if self.folds(index) { folded(below) } else { copied(below) });
            }
            let x = &inputs[index];
            let mut out = sized([x.frames, x.h, x.w, layer.outputs()]);
            layer.forward(self.arch, |frame| [x.frame(frame), &[]], &mut out, |_, _| Finish::Plain);
            if index + 1 < self.layers.len() {
                out.values_mut().iter_mut().for_each(|value| *value = value.max(LEAK * *value));
            }
            outputs.push(out);
        }
        Pass { inputs, outputs }
    }

    /// Says whether a layer takes in what the layer before gives at half the resolution.
    fn folds(&self, index: usize) -> bool {
        index + 1 < self.layers.len()
    }

    /// Takes gradients of the outputs of all layers to the weights, where they learn, or else to what the first takes in.
    fn back(&self, pass: &Pass, mut d: Vec<Image>, mut gradient: Option<&mut Weights>) -> Image {
        for (index, layer) in self.layers.iter().enumerate().rev() {
            let (below, own) = d.split_at_mut(index);
            let own = &mut own[0];
            if index + 1 < self.layers.len() {
                let slopes = own.values_mut().iter_mut().zip(pass.outputs[index].values());
                slopes.for_each(|(d, out)| *d *= if *out > 0.0 { 1.0 } else { LEAK });
            }
            let (own, x): (&Image, &Image) = (own, &pass.inputs[index]);
            if let Some(gradient) = gradient.as_deref_mut() {
                layer.learn(self.arch, own, |frame| [x.frame(frame), &[]], gradient);
                if index == 0 {
                    break;
                }
            }
            let mut dx = sized(x.size());
            layer.back(self.arch, 0, |frame| own.frame(frame), &mut dx, false);
            let Some(below) = below.last_mut() else { return dx };
            let dx = if self.folds(index) { unfolded(&dx) } else { dx };
            below.values_mut().iter_mut().zip(dx.values()).for_each(|(sum, value)| *sum += value);
        }
        Image::default()
    }

    /// Returns gradients of the outputs of a pass where only the verdicts have one.
    fn of_verdicts(pass: &Pass, d: &[f32]) -> Vec<Image> {
        let mut all: Vec<Image> = pass.outputs.iter().map(|out| sized(out.size())).collect();
        if let Some(last) = all.last_mut() {
            last.fill(d);
        }
        all
    }
}

/// Computes the decoder's step against a discriminator, and the discriminator's against the decoder.
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "sums are taken in double precision")]
pub fn adversarial(shape: &AeShape, weights: &Weights, batch: &DecoderBatch, against: &Adversary<'_>) -> [Step; 2] {
    let (network, mut gradient) = (Network::new(shape, weights), weights.zeros_like());
    let [steps, h, w, _]: [usize; 4] = batch.latents.shape().try_into().expect("latents have four axes");
    let (size, guide) = ([steps, h, w], (shape.guides > 0).then(|| batch.guide.values()));
    let mut decoded = network.decode(batch.latents.values(), guide, size, batch.clips);
    let mut frames = std::mem::take(&mut decoded.frames);
    let discriminator = Discriminator::new(against.shape, against.weights);
    let (fake, real) = (discriminator.look(&frames, batch), discriminator.look(batch.frames.values(), batch));
    let (told, mut pull) = fooling(&discriminator, &fake, &real, batch, against);
    greyed(&mut pull, batch, against);
    let judged = telling_apart(&discriminator, [&fake, &real], batch, against);
    let (loss, mut parts) = reconstruction(&mut frames, &batch.frames, &batch.emphasis, Some(batch));
    let size_of = |values: &[f32]| values.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>().sqrt();
    let share = (f64::from(against.share) * size_of(&frames) / size_of(&pull).max(1e-30)) as f32;
    pull.iter_mut().for_each(|d| *d *= share);
    frames.iter_mut().zip(&pull).for_each(|(d, pull)| *d += pull);
    network.decode_back(&decoded, size, batch.clips, &mut frames, &mut gradient);
    for name in weights.iter().map(|(name, _)| name).filter(|name| name.starts_with("encoder.")) {
        gradient.remove(name);
    }
    parts.extend(told);
    [Step { loss, parts, gradient }, judged]
}

/// Takes colour from the gradient of pixels that count less than 1: specks of colour please a discriminator sooner than they please an eye.
fn greyed(pull: &mut [f32], batch: &DecoderBatch, against: &Adversary<'_>) {
    for (pixel, _) in pull.chunks_exact_mut(3).zip(batch.emphasis.values()).filter(|(_, weight)| **weight < 1.0) {
        let grey = pixel.iter().sum::<f32>() / 3.0;
        pixel.iter_mut().for_each(|d| *d = grey + against.colour * (*d - grey));
    }
}

/// Returns what a pass tells of the decoder, and the gradient of the frames that makes them look truer.
#[expect(clippy::cast_possible_truncation, reason = "sums are taken in double precision")]
fn fooling(
    discriminator: &Discriminator,
    fake: &Pass,
    real: &Pass,
    batch: &DecoderBatch,
    against: &Adversary<'_>,
) -> (Vec<(&'static str, f32)>, Vec<f32>) {
    let verdicts = fake.verdicts();
    let each = -1.0 / verdicts.len() as f32;
    let mut d = Discriminator::of_verdicts(fake, &vec![each; verdicts.len()]);
    let mut distance = 0.0;
    if batch.told {
        for ((d, fake), real) in d.iter_mut().zip(&fake.outputs).zip(&real.outputs).take(fake.outputs.len() - 1) {
            let size: f64 = real.values().iter().map(|value| f64::from(value.abs())).sum::<f64>().max(1e-12);
            let weight = (f64::from(against.features) / size) as f32;
            for ((d, fake), real) in d.values_mut().iter_mut().zip(fake.values()).zip(real.values()) {
                let error = fake - real;
                distance += f64::from(error.abs()) / size;
                *d += if error == 0.0 { 0.0 } else { weight.copysign(error) };
            }
        }
    }
    let mean = f64::from(verdicts.iter().sum::<f32>()) / verdicts.len() as f64;
    let pull = parted(&discriminator.back(fake, d, None), batch);
    (vec![("fake", mean as f32), ("features", distance as f32)], pull)
}

/// Computes the discriminator's step.
#[expect(clippy::cast_possible_truncation, reason = "sums are taken in double precision")]
fn telling_apart(
    discriminator: &Discriminator,
    [fake, real]: [&Pass; 2],
    batch: &DecoderBatch,
    against: &Adversary<'_>,
) -> Step {
    let mut gradient = against.weights.zeros_like();
    let noisy: Vec<f32> = batch.frames.values().iter().zip(against.noise.values()).map(|(a, b)| a + b).collect();
    let noisy = discriminator.look(&noisy, batch);
    let [of_fake, of_real, of_noisy] = [fake, real, &noisy].map(Pass::verdicts);
    let count = of_real.len() as f64;
    let hinge = |verdict: f32, sign: f32| (1.0 - sign * verdict).max(0.0);
    let slope = |verdict: f32, sign: f32| if sign * verdict < 1.0 { -sign / count as f32 } else { 0.0 };
    let penalty = 2.0 * against.smoothness / count as f32;
    let (mut d_real, mut d_noisy, mut loss) = (Vec::new(), Vec::new(), 0.0);
    for ((fake, real), noisy) in of_fake.iter().zip(&of_real).zip(&of_noisy) {
        loss += f64::from(hinge(*fake, -1.0) + hinge(*real, 1.0) + against.smoothness * (real - noisy).powi(2)) / count;
        d_real.push(slope(*real, 1.0) + penalty * (real - noisy));
        d_noisy.push(penalty * (noisy - real));
    }
    let d_fake: Vec<f32> = of_fake.iter().map(|verdict| slope(*verdict, -1.0)).collect();
    for (pass, d) in [(fake, d_fake), (real, d_real), (&noisy, d_noisy)] {
        discriminator.back(pass, Discriminator::of_verdicts(pass, &d), Some(&mut gradient));
    }
    let mean = of_real.iter().map(|verdict| f64::from(*verdict)).sum::<f64>() / count;
    Step { loss: loss as f32, parts: vec![("real", mean as f32)], gradient }
}

/// Returns frames, height, width and the frames of a clip.
fn sizes(batch: &DecoderBatch) -> [usize; 4] {
    let [frames, height, width, _]: [usize; 4] = batch.frames.shape().try_into().expect("frames have four axes");
    [frames, height, width, frames / batch.clips]
}

/// Lists the frames that have one before them in their clip.
fn followers(batch: &DecoderBatch) -> impl Iterator<Item = usize> {
    let [frames, _, _, clip] = sizes(batch);
    (0..frames).filter(move |frame| frame % clip > 0)
}

/// Joins each frame with the one before and its layout, at half the resolution.
fn joined(frames: &[f32], batch: &DecoderBatch) -> Image {
    let [_, height, width, _] = sizes(batch);
    let (size, guide) = (height * width * 3, batch.guide.shape()[3]);
    let mut values = Vec::new();
    for frame in followers(batch) {
        let pixels = frames[frame * size..].chunks_exact(3).zip(frames[(frame - 1) * size..].chunks_exact(3));
        let guides = batch.guide.values()[frame * height * width * guide..].chunks_exact(guide);
        let pixels = pixels.zip(guides).take(height * width);
        pixels.for_each(|((now, before), guide)| values.extend([now, before, &guide[..3]].into_iter().flatten()));
    }
    let count = values.len() / (SEEN * height * width);
    let small = sized([count, height / 2, width / 2, 4 * SEEN]);
    let folded = unshuffled(&values, &small, 1);
    filled(small.size(), &folded)
}

/// Takes the gradient of what was joined apart into that of the frames.
fn parted(d: &Image, batch: &DecoderBatch) -> Vec<f32> {
    let [frames, height, width, _] = sizes(batch);
    let size = height * width * 3;
    let (whole, mut parts) = (shuffled(&d.dense(), d, 1).dense(), vec![0.0; frames * size]);
    for (frame, pixels) in followers(batch).zip(whole.chunks_exact(height * width * SEEN)) {
        for (at, pixel) in pixels.chunks_exact(SEEN).enumerate() {
            for channel in 0..3 {
                parts[frame * size + at * 3 + channel] += pixel[channel];
                parts[(frame - 1) * size + at * 3 + channel] += pixel[3 + channel];
            }
        }
    }
    parts
}
