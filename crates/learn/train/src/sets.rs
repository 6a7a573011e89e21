//! Clip sets as the transformer sees them: normalised latents in memory, layouts read when needed.
//!
//! Latents of a set are computed once per autoencoder and kept in the work folder (`latents-SET-KEY.bin`, f32, clip
//! after clip); the key is the digest of set and autoencoder.

use std::path::{Path, PathBuf};

use ds_clips::{Clip, ClipSet};
use ds_nn::body::Autoencoder;
use ds_nn::step::ClipBatch;
use ds_nn::tiny_ae::AeShape;
use ds_nn::{Array, Weights};
use ds_raster::RgbImage;
use ds_space::{Digest, DigestWriter, Draws};
use ds_video::{ModelConfig, tokens};

use crate::Progress;
use crate::autoencoder::{self, unguided};
use crate::condition::{Condition, latent_steps};
use crate::config::TrainConfig;
use crate::emphasis::Emphasis;
use crate::error::TrainError;
use crate::frames::pick;
use crate::guidance::Guidance;

/// The autoencoder as its stage left it, with the statistics of its latents.
pub(crate) struct Encoder {
    ae: Box<dyn Autoencoder>,
    shape: AeShape,
    mean: Vec<f32>,
    std: Vec<f32>,
    digest: Digest,
}

impl Encoder {
    pub(crate) fn load(config: &TrainConfig) -> Result<Self, TrainError> {
        let shape = unguided(&config.model()?);
        let mut weights = config.weights_of("autoencoder")?;
        let digest = weights.digest();
        let mut statistic = |name: &str| weights.remove(name).map(Array::into_values).unwrap_or_default();
        let (mean, std) = (statistic("latent.mean"), statistic("latent.std"));
        if mean.len() != shape.z || std.len() != shape.z {
            let path = config.finished("autoencoder.safetensors").display().to_string();
            let reason = "it has no latent statistics: its stage did not end".to_owned();
            return Err(TrainError::Checkpoint { path, reason });
        }
        Ok(Self { ae: config.backend.for_single_clips().autoencoder(&shape, &weights)?, shape, mean, std, digest })
    }

    /// Encodes frames that begin a drive: [latents, tokens, 4, z], normalised.
    pub(crate) fn encode(&self, frames: &[RgbImage]) -> Vec<f32> {
        let encoded = autoencoder::encode(self.ae.as_ref(), &self.shape, frames);
        let (h, w) = (encoded.shape()[1], encoded.shape()[2]);
        let mut values = encoded.into_values();
        for pixel in values.chunks_exact_mut(self.shape.z) {
            let statistics = self.mean.iter().zip(&self.std);
            pixel.iter_mut().zip(statistics).for_each(|(value, (mean, std))| *value = (*value - mean) / std);
        }
        values.chunks_exact(h * w * self.shape.z).flat_map(|frame| tokens::to_tokens(frame, h, w)).collect()
    }

    /// Decodes the latents of a whole drive, as [`Self::encode`] gives them.
    pub(crate) fn decode(&self, latents: &[f32], (h, w): (usize, usize)) -> Vec<RgbImage> {
        let z = self.shape.z;
        let frames = latents.chunks_exact(h * w * z);
        let mut values: Vec<f32> = frames.flat_map(|frame| tokens::from_tokens(frame, h, w)).collect();
        for pixel in values.chunks_exact_mut(z) {
            let statistics = self.mean.iter().zip(&self.std);
            pixel.iter_mut().zip(statistics).for_each(|(value, (mean, std))| *value = *value * std + mean);
        }
        let latents = Array::new(&[values.len() / (h * w * z), h, w, z], values);
        autoencoder::decode(self.ae.as_ref(), &self.shape, &latents, None)
    }
}

/// One set and its latents.
struct Encoded {
    clips: ClipSet,
    /// Per clip [latents, tokens, 4, z].
    latents: Vec<Vec<f32>>,
}

/// The sets of a stage.
pub(crate) struct Sets {
    model: ModelConfig,
    emphasis: Emphasis,
    sets: Vec<Encoded>,
}

/// A clip of one of the sets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ClipRef {
    /// Which set, in the order given.
    pub(crate) set: usize,
    /// Which clip of it.
    pub(crate) clip: usize,
}

/// Latent frames of a clip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Span {
    /// The first one.
    pub(crate) from: usize,
    /// How many.
    pub(crate) count: usize,
}

impl Sets {
    /// Opens sets by name and encodes what was not encoded before.
    pub(crate) fn open(
        config: &TrainConfig,
        names: &[String],
        progress: &mut dyn Progress,
    ) -> Result<Self, TrainError> {
        let (model, encoder) = (config.model()?, Encoder::load(config)?);
        let mut sets = Vec::new();
        for name in names {
            let clips = ClipSet::open(config.set(name)?)?;
            let latents = encoded(config, &encoder, name, &clips, progress)?;
            sets.push(Encoded { clips, latents });
        }
        Ok(Self { emphasis: Emphasis::of(config), model, sets })
    }

    /// Draws a clip, each of all sets alike.
    pub(crate) fn draw(&self, draws: &Draws) -> Result<ClipRef, TrainError> {
        let (set, clip) = pick(self.sets.iter().map(|set| set.latents.len()), draws)?;
        Ok(ClipRef { set, clip })
    }

    /// Returns the number of clips of a set.
    pub(crate) fn count(&self, set: usize) -> usize {
        self.sets[set].latents.len()
    }

    /// Returns how many latent frames the layouts of a clip are for; an edited clip has a latent for the first alone.
    pub(crate) fn latents(&self, at: ClipRef) -> usize {
        1 + (self.sets[at.set].clips.info(at.clip).ticks - 1) / self.model.vae.stride_t
    }

    /// Says whether a clip is an edited first frame over the layouts of a drive that looked otherwise.
    pub(crate) fn edited(&self, at: ClipRef) -> bool {
        self.sets[at.set].clips.info(at.clip).frames == 1
    }

    /// Returns the guidance of a clip by a weight.
    pub(crate) fn guidance(&self, config: &TrainConfig, weight: f32, at: ClipRef) -> Guidance {
        Guidance { weight, keep_look: config.keep_look && self.edited(at), levels: config.guide_levels }
    }

    /// Reads the pictures of a clip's first latent frames.
    pub(crate) fn pictures(&self, at: ClipRef, latents: usize) -> Result<Clip, TrainError> {
        Ok(self.sets[at.set].clips.read(at.clip, 0, 1 + (latents - 1) * self.model.vae.stride_t)?)
    }

    /// Values of a latent frame.
    pub(crate) fn frame(&self) -> usize {
        self.model.dit().tokens() * 4 * self.model.vae.z
    }

    /// Draws a span of `count` latent frames of a clip, or the whole clip if it is shorter.
    pub(crate) fn span(&self, at: ClipRef, count: usize, draws: &Draws) -> Span {
        let all = self.latents(at);
        let count = count.min(all);
        Span { from: draws.below(1, (all - count + 1) as u64) as usize, count }
    }

    /// Makes a batch of one clip: latents (zeros where the clip has no frames), layouts, prompt; the start latent is
    /// that of the clip's first frame.
    pub(crate) fn batch(&self, at: ClipRef, span: Span) -> Result<ClipBatch, TrainError> {
        let set = &self.sets[at.set];
        let latents = &set.latents[at.clip];
        let frame = self.frame();
        let stride = self.model.vae.stride_t;
        let first = if span.from == 0 { 0 } else { 1 + (span.from - 1) * stride };
        let end = 1 + (span.from + span.count - 1) * stride;
        let clip = set.clips.layouts(at.clip, first, end - first)?;
        let steps = if span.from == 0 {
            latent_steps(&clip.layouts, stride)
        } else {
            clip.layouts.chunks_exact(stride).map(|step| step.iter().collect()).collect()
        };
        let (h, w) = self.model.latent_size();
        let emphasis = steps.iter().flat_map(|step| tokens::to_tokens(&self.emphasis.of_latents(step), h, w));
        let emphasis: Vec<f32> = emphasis.collect();
        let known =
            &latents[(span.from * frame).min(latents.len())..((span.from + span.count) * frame).min(latents.len())];
        let condition = Condition {
            start: &latents[..frame],
            clean: known,
            layouts: &steps,
            layout_on: true,
            prompt: &clip.prompt,
        };
        let mut batch = condition.batch(&self.model);
        batch.emphasis = Array::new(batch.emphasis.shape(), emphasis);
        Ok(batch)
    }
}

fn encoded(
    config: &TrainConfig,
    encoder: &Encoder,
    name: &str,
    clips: &ClipSet,
    progress: &mut dyn Progress,
) -> Result<Vec<Vec<f32>>, TrainError> {
    let key = DigestWriter::new().digest(&encoder.digest).text(&clips.index().recipe).finish().to_string();
    let path = config.folder.join(format!("latents-{name}-{}.bin", &key[..12]));
    if let Some(known) = known(&path, clips.len()) {
        return Ok(known);
    }
    std::fs::create_dir_all(&config.folder).map_err(TrainError::io("work folder", &config.folder))?;
    let team = config.backend.for_single_clips().team();
    let mut latents = Vec::new();
    let indices: Vec<usize> = (0..clips.len()).collect();
    for part in indices.chunks(64) {
        let job =
            |at: usize| clips.read(part[at], 0, clips.info(part[at]).frames).map(|clip| encoder.encode(&clip.frames));
        for encoded in team.run(part.len(), job) {
            latents.push(encoded?);
        }
        progress.note(&format!("encoded {} of {} clips of {name}", latents.len(), clips.len()));
    }
    store(&path, &latents)?;
    Ok(latents)
}

/// Reads latents back: a count of values per clip, then the values.
fn known(path: &Path, clips: usize) -> Option<Vec<Vec<f32>>> {
    let bytes = std::fs::read(path).ok()?;
    let mut rest = bytes.as_slice();
    let mut take = |count: usize| -> Option<&[u8]> {
        let (head, tail) = rest.split_at_checked(count)?;
        rest = tail;
        Some(head)
    };
    let mut latents = Vec::new();
    for _ in 0..clips {
        let count = u32::from_le_bytes(take(4)?.try_into().ok()?) as usize;
        let values =
            take(4 * count)?.chunks_exact(4).map(|value| f32::from_le_bytes([value[0], value[1], value[2], value[3]]));
        latents.push(values.collect());
    }
    rest.is_empty().then_some(latents)
}

fn store(path: &PathBuf, latents: &[Vec<f32>]) -> Result<(), TrainError> {
    let mut bytes = Vec::new();
    for clip in latents {
        bytes.extend((clip.len() as u32).to_le_bytes());
        bytes.extend(clip.iter().flat_map(|value| value.to_le_bytes()));
    }
    let temporary = path.with_extension("partial");
    std::fs::write(&temporary, bytes)
        .and_then(|()| std::fs::rename(&temporary, path))
        .map_err(TrainError::io("latents", path))
}

/// Returns the statistics-free weights of the autoencoder and, apart, mean and deviation of its latents.
pub(crate) fn stored_autoencoder(config: &TrainConfig, stage: &str) -> Result<Weights, TrainError> {
    let (mut weights, own) = (config.weights_of(stage)?, config.weights_of("autoencoder")?);
    for name in ["latent.mean", "latent.std"] {
        if let Some(array) = own.get(name) {
            weights.insert(name, array.clone());
        }
    }
    Ok(weights)
}
