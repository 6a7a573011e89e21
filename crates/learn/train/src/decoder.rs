//! The guided decoder learns to draw from what the student generates, guided by the layouts.
//!
//! Encoder and student stay as they are. Some clips of a batch are latents of the student's own rollouts over training
//! clips, the rest are encoded frames. What the layout tells is to look as in the true frame; what stands beside the
//! road a rollout cannot know, and regression onto the true frame would make it mush: there the pixels of a rollout
//! count less, and a discriminator says what frames look like. Layouts are dropped now and then. Without rollouts there is
//! no need of a student: all clips are encoded frames then, the decoder is not guided, and what comes out is an autoencoder.
//!
//! A decoder that sees a carried frame sees its own in a rollout: all rollouts are decoded from their beginnings on, by the
//! average of the weights so far, whenever a checkpoint is due. Now and then it sees the true one there, so that it learns that carried
//! detail is worth keeping; in encoded clips it sees the true one, now and then none.

use std::sync::Arc;

use ds_clips::Clip;
use ds_nn::discriminator::DiscriminatorShape;
use ds_nn::optimiser::AdamWSettings;
use ds_nn::step::{Adversary, DecoderBatch, Step};
use ds_nn::tiny_ae::AeShape;
use ds_nn::tiny_ae::Memory;
use ds_nn::{Array, Weights};
use ds_raster::{Air, RgbImage};
use ds_space::{Digest, DigestWriter, Draws};
use ds_video::{Carry, Layout, Paint, Rollout, VideoModel, tokens};

use crate::autoencoder::unguided;
use crate::batch::{mean_step, mean_steps};
use crate::checkpoint::{Member, Run, Update};
use crate::condition::latent_steps;
use crate::config::{AdversarialConfig, DecoderConfig, TrainConfig};
use crate::emphasis::Emphasis;
use crate::error::TrainError;
use crate::frames::Frames;
use crate::sets::stored_autoencoder;
use crate::ship::{assembled, student_weights};
use crate::{Progress, Report, autoencoder, evaluate};

const NAME: &str = "decoder";
const LAYOUT_DROPOUT: f64 = 0.1;
/// The share of encoded clips in which no frame is carried, and of rollouts in which the true one is.
const CARRIED_ELSE: f64 = 0.25;
const DECODER: usize = 0;
const DISCRIMINATOR: usize = 1;

/// Trains the guided decoder to its configured number of steps.
///
/// # Errors
/// If autoencoder or student are not trained, a file cannot be used or the loss is not finite.
pub fn run(config: &TrainConfig, progress: &mut dyn Progress) -> Result<Report, TrainError> {
    let recipe = config.decoder.as_ref().ok_or_else(|| TrainError::no_stage(NAME))?;
    let model = config.model()?;
    let frames = Frames::open(config, &recipe.stage.sets)?;
    let seed = DigestWriter::new().text(NAME).u64(config.seed).finish();
    let shape = if recipe.rollouts > 0 { model.ae() } else { unguided(&model) };
    let member = Member::new("model", &shape.declare(), recipe.stage.optimiser(), &seed)
        .starting_from(&stored_autoencoder(config, "autoencoder")?)
        .grown_from(&config.initial("vae.")?);
    let against = recipe.adversarial.as_ref().map(|against| {
        // Without inertia: what is learned from changes with every update.
        let settings = AdamWSettings { beta1: 0.0, beta2: 0.99, ..recipe.stage.optimiser() };
        Member::new("discriminator", &against.shape().declare(), settings, &seed)
    });
    let mut run = Run::open(config, NAME, &recipe.stage, std::iter::once(member).chain(against).collect())?;
    let student = if recipe.rollouts > 0 { Some(student_weights(config)?) } else { None };
    if run.unfinished() {
        let unused = || Weights::initialised(&model.dit().declare(), &seed);
        let drawn = Arc::new(assembled(config, &student.clone().unwrap_or_else(unused), "autoencoder")?);
        let source = Source {
            config,
            recipe,
            frames,
            rolled: Vec::new(),
            shown: Vec::new(),
            model: drawn,
            shape: shape.clone(),
            seed,
        };
        let mut source = Source { rolled: source.roll(progress)?, ..source };
        let team = config.backend.team();
        while run.unfinished() {
            let (at, rate) = (run.step, recipe.stage.rate(run.step));
            if shape.carried && (source.shown.is_empty() || at.is_multiple_of(recipe.stage.checkpoint_every)) {
                source.shown = source.show(run.average())?;
            }
            let updates = if let Some(against) = &recipe.adversarial {
                let weights = [DECODER, DISCRIMINATOR].map(|member| &run.members[member].weights);
                let steps = mean_steps(&team, &recipe.stage, |clip| source.opposed(against, weights, at, clip))?;
                let rates = [rate, against.learning_rate];
                let updates = steps.into_iter().zip(rates).enumerate();
                updates.map(|(member, (step, rate))| Update { member, step, rate }).collect()
            } else {
                let step = mean_step(&team, &recipe.stage, |clip| {
                    Ok(config.backend.decoding(&shape, run.weights(), &source.batch(at, clip)?))
                })?;
                vec![Update { member: DECODER, step, rate }]
            };
            if !run.iterate(updates, progress)? {
                break;
            }
        }
    }
    let figures = match &student {
        Some(student) => evaluate::held_out(config, student, NAME, progress)?,
        None => autoencoder::held_out(config, &shape, run.average())?,
    };
    Ok(run.report(figures))
}

impl AdversarialConfig {
    /// Returns the sizes of the discriminator.
    pub(crate) fn shape(&self) -> DiscriminatorShape {
        DiscriminatorShape { widths: self.widths }
    }
}

struct Source<'a> {
    config: &'a TrainConfig,
    recipe: &'a DecoderConfig,
    frames: Frames,
    /// Clips and the student's latents for them.
    rolled: Vec<(Clip, Array)>,
    /// Their frames as the decoder shows them, where it is to see one again.
    shown: Vec<Vec<RgbImage>>,
    /// Draws the rollouts, unguided.
    model: Arc<VideoModel>,
    /// The guided autoencoder.
    shape: AeShape,
    seed: Digest,
}

impl Source<'_> {
    /// Latent frames of what windows are drawn from.
    fn latents(&self) -> usize {
        self.recipe.rollout.max(self.recipe.stage.latents)
    }

    fn length(&self) -> usize {
        1 + (self.latents() - 1) * self.model.config().vae.stride_t
    }

    /// Rolls the student out over drawn clips; latents [latents, h, w, z] as the decoder takes them.
    fn roll(&self, progress: &mut dyn Progress) -> Result<Vec<(Clip, Array)>, TrainError> {
        let team = self.config.backend.team();
        let indices: Vec<u64> = (0..self.recipe.rollouts).collect();
        let mut rolled = Vec::new();
        for part in indices.chunks(32) {
            for made in team.run(part.len(), |at| self.rollout(part[at])) {
                rolled.push(made?);
            }
            progress.note(&format!("rolled out {} of {} clips", rolled.len(), self.recipe.rollouts));
        }
        Ok(rolled)
    }

    fn rollout(&self, index: u64) -> Result<(Clip, Array), TrainError> {
        let config = self.model.config();
        let (h, w) = config.latent_size();
        let draws = Draws::from_seed(self.config.seed, "decoder-rollouts");
        let clip = self.frames.first(&Draws::from_seed(draws.u64(index), "clip"), self.length())?;
        let key = Digest::of(&index.to_le_bytes());
        let (first, layout) = (&clip.frames[0], &clip.layouts[0]);
        let (mut rollout, entry) = Rollout::new(Arc::clone(&self.model), key, "front", &clip.prompt, first, layout)?;
        let mut entries = vec![entry];
        entries.extend(rollout.generate(&clip.layouts[1..])?.committed);
        let frame = h * w * config.vae.z;
        let frames = entries.iter().flat_map(|entry| entry.clean.values.chunks_exact(frame));
        let values: Vec<f32> = frames.flat_map(|tokens| tokens::from_tokens(tokens, h, w)).collect();
        let latents = Array::new(&[values.len() / frame, h, w, config.vae.z], values);
        Ok((clip, self.model.denormalised(latents)))
    }

    /// Decodes all rollouts from their beginnings on, each chunk beside the last frame of the one before.
    fn show(&self, weights: &Weights) -> Result<Vec<Vec<RgbImage>>, TrainError> {
        let ae = self.config.backend.autoencoder(&self.shape, weights)?;
        let stride = self.model.config().vae.stride_t;
        let show = |at: usize| {
            let (clip, latents) = &self.rolled[at];
            let [count, h, w, z]: [usize; 4] = latents.shape().try_into().expect("latents have four axes");
            let paint = self.paint(clip);
            let (mut memory, mut frames) = (Memory::default(), vec![clip.frames[0].clone()]);
            for (step, values) in (0..count).zip(latents.values().chunks_exact(h * w * z)) {
                let ticks = ticks(step, stride);
                let guide = (step > 0).then(|| self.guide(clip, step, frames.last(), &paint));
                let decoded = ae.decode(&Array::new(&[1, h, w, z], values.to_vec()), guide.as_ref(), &mut memory);
                let images = decoded.values().chunks_exact(decoded.values().len() / stride).take(ticks.len());
                let image = |(values, tick)| {
                    evaluate::layout(clip, tick).calmed(&RgbImage::of_values(values, 8 * w as u32, 8 * h as u32))
                };
                frames.extend(images.zip(ticks).map(image).filter(|_| step > 0));
            }
            frames
        };
        Ok(self.config.backend.team().run(self.rolled.len(), show))
    }

    /// Returns the paint of the vehicles of a clip, if the model is told of it.
    fn paint(&self, clip: &Clip) -> Paint {
        if self.model.config().control.paints.is_empty() {
            return Paint::Untold;
        }
        let seen = clip.frames.iter().zip(clip.geometry.iter().map(|geometry| &**geometry));
        Paint::Told(Arc::new(ds_raster::paints(seen)))
    }

    /// Makes what guides the frames of a latent step of a clip, after a frame that is carried on.
    fn guide(&self, clip: &Clip, step: usize, before: Option<&RgbImage>, paint: &Paint) -> Array {
        let config = self.model.config();
        let ticks = ticks(step, config.vae.stride_t);
        let carry = before
            .filter(|_| step > 0)
            .map(|frame| Carry::of(frame, &evaluate::layout(clip, ticks.start - 1), Air::Clear).painted(paint.clone()));
        let layouts: Vec<Layout> = ticks.map(|tick| evaluate::layout(clip, tick)).collect();
        let missing = config.vae.stride_t - layouts.len();
        let layouts = std::iter::repeat_n(&layouts[0], missing).chain(&layouts).collect::<Vec<_>>();
        carry.unwrap_or_default().guide(&self.shape, config.video.width_px, config.video.height_px, &layouts)
    }

    /// Computes the steps of decoder and discriminator for one drawn clip.
    fn opposed(
        &self,
        against: &AdversarialConfig,
        [weights, judge]: [&Weights; 2],
        step: u32,
        clip: u64,
    ) -> Result<[Step; 2], TrainError> {
        let batch = self.batch(step, clip)?;
        let draws = Draws::new(&self.seed, "noise", &[u64::from(step), clip]);
        let count = batch.frames.values().len() as u64;
        #[expect(clippy::cast_possible_truncation, reason = "noise is single precision")]
        let noise = (0..count).map(|index| against.noise * draws.normal(index) as f32).collect();
        let adversary = Adversary {
            shape: against.shape(),
            weights: judge,
            noise: Array::new(batch.frames.shape(), noise),
            smoothness: against.smoothness,
            share: if step < against.after { 0.0 } else { against.share },
            features: against.features,
            colour: against.colour,
        };
        Ok(self.config.backend.adversarial(&self.shape, weights, &batch, &adversary))
    }

    /// Makes the batch of one drawn clip.
    fn batch(&self, step: u32, clip: u64) -> Result<DecoderBatch, TrainError> {
        let (shape, stride) = (unguided(self.model.config()), self.model.config().vae.stride_t);
        let draws = Draws::new(&self.seed, "batch", &[u64::from(step), clip]);
        let encoded = draws.uniform(2) >= self.recipe.rolled || self.rolled.is_empty();
        let at = draws.below(0, self.rolled.len().max(1) as u64) as usize;
        let (clip, latents) = if encoded {
            let clip = self.frames.first(&draws, self.length())?;
            let latents = autoencoder::encode(self.model.autoencoder(), &shape, &clip.frames);
            (clip, latents)
        } else {
            self.rolled[at].clone()
        };
        let usual = draws.uniform(7) >= CARRIED_ELSE;
        let own = match self.shown.get(at) {
            Some(shown) if usual && !encoded => Some(shown),
            _ => Some(&clip.frames).filter(|_| usual || !encoded),
        };
        let count = self.recipe.stage.latents.min(latents.shape()[0]);
        let from = draws.below(4, (latents.shape()[0] - count + 1) as u64) as usize;
        let seen = ticks(from, stride).start..ticks(from + count - 1, stride).end;
        let aim = (draws.uniform(8) < self.recipe.aimed)
            .then(|| aim(&clip.layouts[seen.start + draws.below(9, seen.len() as u64) as usize], &draws));
        let window = Window::drawn(self.recipe.crop_px, from..from + count, latents.shape(), aim.flatten(), &draws);
        let on = draws.uniform(3) >= LAYOUT_DROPOUT;
        let (mut guides, mut frames, mut weights) = (Vec::new(), Vec::new(), Vec::new());
        let all = Emphasis { markings: self.recipe.markings, ..Emphasis::of(self.config) };
        let emphasis = if encoded {
            all
        } else {
            let road_users = self.recipe.rolled_road_users.unwrap_or(all.road_users);
            Emphasis { road_users, untold: self.recipe.untold, structures: self.recipe.structures, ..all }
        };
        let paint = self.paint(&clip);
        let steps = latent_steps(&clip.frames, stride).into_iter().zip(latent_steps(&clip.layouts, stride));
        for (index, (step, layout)) in steps.enumerate().skip(from).take(count) {
            frames.extend(tokens::stacked(&step).into_values());
            weights.extend(emphasis.of_pixels(&layout));
            let before = own.map(|own| &own[ticks(index, stride).start.saturating_sub(1)]);
            guides.extend(self.guide(&clip, index, before, &paint).into_values());
        }
        if !on {
            guides.fill(0.0);
        }
        let [images, height, width] = [count * stride, 8 * latents.shape()[1], 8 * latents.shape()[2]];
        let pixels =
            |values: Vec<f32>, channels| window.pixels(&Array::new(&[images, height, width, channels], values));
        Ok(DecoderBatch {
            clips: 1,
            latents: window.latents(&latents),
            guide: pixels(guides, self.shape.guide_channels()),
            frames: pixels(frames, 3),
            told: encoded,
            emphasis: pixels(weights, 1),
            change: self.recipe.change,
            texture: self.recipe.texture,
        })
    }
}

/// Returns the ticks of a latent step.
fn ticks(step: usize, stride: usize) -> std::ops::Range<usize> {
    if step == 0 { 0..1 } else { 1 + (step - 1) * stride..1 + step * stride }
}

/// Draws the latent, row and column, of a pixel of a road user or of what blocks the way; none where a layout shows neither.
fn aim(layout: &RgbImage, draws: &Draws) -> Option<[usize; 2]> {
    let pixels = layout.rgb().as_chunks::<3>().0.iter().enumerate();
    let shown: Vec<usize> = pixels.filter(|(_, rgb)| Emphasis::is_in_the_way(**rgb)).map(|(at, _)| at).collect();
    let at = shown.get(draws.below(10, shown.len().max(1) as u64) as usize)?;
    let width = layout.width_px() as usize;
    Some([at / width / 8, at % width / 8])
}

/// A part of a clip: latent frames, rows and columns.
struct Window {
    frames: std::ops::Range<usize>,
    rows: std::ops::Range<usize>,
    columns: std::ops::Range<usize>,
}

impl Window {
    /// Draws rows and columns of latents [steps, h, w, z], around a latent if it is aimed at one (row, column).
    fn drawn(
        crop_px: Option<[usize; 2]>,
        frames: std::ops::Range<usize>,
        shape: &[usize],
        aim: Option<[usize; 2]>,
        draws: &Draws,
    ) -> Self {
        let [width, height] = crop_px.unwrap_or([8 * shape[2], 8 * shape[1]]).map(|px| px / 8);
        let place = |draw, whole: usize, part: usize, aim: Option<usize>| {
            let part = part.min(whole);
            let drawn = || draws.below(draw, (whole - part + 1) as u64) as usize;
            let first = aim.map_or_else(drawn, |aim| aim.saturating_sub(part / 2).min(whole - part));
            first..first + part
        };
        let [row, column] = [0, 1].map(|axis| aim.map(|aim| aim[axis]));
        Self { frames, rows: place(5, shape[1], height, row), columns: place(6, shape[2], width, column) }
    }

    fn latents(&self, latents: &Array) -> Array {
        self.cut(latents, self.frames.clone(), 1)
    }

    /// Cuts the window out of images, which begin with it.
    fn pixels(&self, images: &Array) -> Array {
        self.cut(images, 0..images.shape()[0], 8)
    }

    fn cut(&self, images: &Array, frames: std::ops::Range<usize>, scale: usize) -> Array {
        let [_, height, width, channels]: [usize; 4] = images.shape().try_into().expect("images have four axes");
        let [rows, columns] = [&self.rows, &self.columns].map(|range| scale * range.start..scale * range.end);
        let mut values = Vec::with_capacity(frames.len() * rows.len() * columns.len() * channels);
        for frame in frames.clone() {
            for row in rows.clone() {
                let line = (frame * height + row) * width;
                values.extend_from_slice(
                    &images.values()[(line + columns.start) * channels..(line + columns.end) * channels],
                );
            }
        }
        Array::new(&[frames.len(), rows.len(), columns.len(), channels], values)
    }
}
