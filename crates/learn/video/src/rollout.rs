//! A rollout: one camera of one episode, from its first frame on.
//!
//! Tick 0 is the first frame o_0 itself; `generate` gives ticks 1, 2, … A chunk holds chunk·stride_t ticks. Complete
//! chunks are committed to cache and decoder. Layouts that do not fill a chunk are padded with the newest one and
//! decoded from a copy of the state; the chunk is made again with the same noise once its layouts are known, and only
//! ticks not yet published come out.

use std::sync::Arc;

use ds_nn::Array;
use ds_nn::body::{ChunkKv, Context, Control, Window};
use ds_nn::cache::KvCache;
use ds_raster::{Air, Fall, RgbImage, cleared};
use ds_space::{Digest, DigestWriter, Tick};
use ds_topic::Cache;
use ds_topic::body::Tensor;

use crate::codec::{DecoderMemory, LayoutMemory};
use crate::config::StartConfig;
use crate::entry;
use crate::error::VideoError;
use crate::layout::{Carry, Layout, Paint};
use crate::model::VideoModel;
use crate::sampling::{self, Sampled, Sampling};
use crate::{sampler, tokens};

/// What a call of [`Rollout::generate`] gives.
#[derive(Debug, Clone)]
pub struct Generated {
    /// One frame per layout, in tick order.
    pub frames: Vec<RgbImage>,
    /// Chunks that were committed by this call.
    pub committed: Vec<Cache>,
    /// Mean absolute difference, 0 to 255, between the frames of the last partial chunk and the same ticks made again
    /// with their true layouts; 0 where no chunk was made again.
    pub seam: f32,
}

/// The state of one camera of one episode. A clone is a snapshot: it shares tensors and costs little.
#[derive(Clone)]
pub struct Rollout {
    model: Arc<VideoModel>,
    first_frame: Arc<RgbImage>,
    draw_key: Digest,
    camera: String,
    context: Context,
    /// What falls, by the prompt: before all frames and in none that is carried on.
    fall: Option<Fall>,
    /// The paint of vehicles that come into view.
    paint: Paint,
    /// The start latent of chunks after the first frame.
    start: Array,
    conditioning: Digest,
    encoder_digest: Digest,
    cache: KvCache,
    decoder: DecoderMemory,
    /// What the encoder remembers of the committed layouts.
    remembered: LayoutMemory,
    /// The next chunk; 0 is the first frame.
    chunk: u32,
    /// The last frame before the chunk under way.
    carry: Carry,
    /// Layouts of the chunk under way, oldest first.
    pending: Vec<Layout>,
    /// Frames of the chunk under way as last made: one per pending layout.
    provisional: Vec<RgbImage>,
}

/// What a rollout is rebuilt from.
pub struct Replay<'a> {
    /// The model.
    pub model: Arc<VideoModel>,
    /// The draw key of the episode.
    pub draw_key: Digest,
    /// The camera.
    pub camera: &'a str,
    /// The prompt.
    pub prompt: &'a str,
    /// The first frame, as given to [`Rollout::new`].
    pub first_frame: &'a RgbImage,
    /// The cache log from entry 0 on.
    pub entries: &'a [Cache],
    /// The layouts before those, oldest first, that [`ModelConfig::layout_memory_ticks`] asks for: of the last committed
    /// tick and that many before it, or of all ticks from 0 on if there are fewer. More may be given.
    ///
    /// [`ModelConfig::layout_memory_ticks`]: crate::ModelConfig::layout_memory_ticks
    pub past: &'a [Layout],
    /// The layouts received since the last commit, fewer than a chunk's.
    pub layouts: &'a [Layout],
}

impl Rollout {
    /// Starts at the first frame, which is resized to the model's video size if needed, and caches it at t = 0.
    /// Returns the rollout and entry 0 of its cache log.
    ///
    /// # Errors
    /// If the prompt cannot be encoded or the model gives values that are not finite.
    pub fn new(
        model: Arc<VideoModel>,
        draw_key: Digest,
        camera: &str,
        prompt: &str,
        first_frame: &RgbImage,
        first_layout: impl Into<Layout>,
    ) -> Result<(Self, Cache), VideoError> {
        let (mut rollout, clean) = Self::prepare(model, draw_key, camera, prompt, first_frame)?;
        let first_layout = [first_layout.into()];
        let (control, remembered) = rollout.control(&first_layout);
        rollout.remembered = remembered;
        rollout.take_along(&rollout.without_fall(&first_layout[0]), &first_layout[0]);
        rollout.begin(clean, &control)
    }

    /// Encodes the first frame; nothing is cached yet. Returns the rollout and the first frame's clean latent.
    fn prepare(
        model: Arc<VideoModel>,
        draw_key: Digest,
        camera: &str,
        prompt: &str,
        first_frame: &RgbImage,
    ) -> Result<(Self, Array), VideoError> {
        let config = model.config();
        let first_frame = first_frame.resized(config.video.width_px, config.video.height_px);
        let (n, z) = (config.dit().tokens(), config.vae.z);
        let (latent, encoder_digest) = model.codec.encode_first(config, &first_frame);
        let clean = tokens::latents_to_tokens(&latent);
        let start = match config.model.start {
            StartConfig::First | StartConfig::None => Array::zeros(&[config.causal.chunk, n, 4, z]),
            StartConfig::Every => {
                Array::new(&[config.causal.chunk, n, 4, z], clean.values().repeat(config.causal.chunk))
            }
        };
        let context = model.conditions.context(&*model.dit, &config.model, prompt, &first_frame, &clean)?;
        let mut conditioning = DigestWriter::new();
        conditioning.digest(&model.digest()).digest(&draw_key).text(camera).text(prompt);
        clean.digest_into(&mut conditioning);
        let rollout = Self {
            first_frame: Arc::new(first_frame),
            draw_key,
            camera: camera.to_owned(),
            context,
            fall: config
                .control
                .falls
                .as_ref()
                .and_then(|falls| falls.said(prompt, DigestWriter::new().digest(&draw_key).text(camera).finish())),
            paint: Paint::drawn(&config.control.paints, draw_key),
            start,
            conditioning: conditioning.finish(),
            encoder_digest,
            cache: KvCache::new(config.cache()),
            decoder: DecoderMemory::default(),
            remembered: LayoutMemory::default(),
            chunk: 0,
            carry: Carry::default(),
            pending: Vec::new(),
            provisional: Vec::new(),
            model,
        };
        Ok((rollout, clean))
    }

    /// Prepares frames of which none knows another.
    pub(crate) fn remembering_nothing(
        model: Arc<VideoModel>,
        draw_key: Digest,
        camera: &str,
        prompt: &str,
        first_frame: &RgbImage,
    ) -> Result<Self, VideoError> {
        Ok(Self::prepare(model, draw_key, camera, prompt, first_frame)?.0)
    }

    /// Makes the frame of a tick with what was prepared alone: the last one of a chunk that shows its layout throughout.
    pub(crate) fn alone(&self, tick: Tick, layout: &RgbImage) -> Result<RgbImage, VideoError> {
        let layouts = vec![Layout::from(layout); self.model.config().frames_per_chunk()];
        let mut alone = Self { chunk: tick.0, ..self.clone() };
        let made = alone.make(&alone.control(&layouts).0)?;
        let mut frames = alone.decode(&made.clean, &layouts)?;
        Ok(frames.pop().expect("a chunk holds at least one frame"))
    }

    /// Caches the first frame and moves the decoder past it.
    fn begin(mut self, clean: Array, control: &Control) -> Result<(Self, Cache), VideoError> {
        let pass = self.write(&clean, &clean, control, 0.0);
        self.decode(&clean, &[])?;
        let made = Sampled { entered: Array::default(), cached: clean.clone(), clean, pass };
        let entry = self.commit(made, control);
        Ok((self, entry))
    }

    /// Returns the frame of tick 0: the given first frame at the model's video size.
    #[must_use]
    pub fn first_frame(&self) -> &RgbImage {
        &self.first_frame
    }

    /// Generates the frames of the next ticks, one per layout.
    ///
    /// # Errors
    /// If there is no layout or the model gives values that are not finite.
    pub fn generate<'a, L>(&mut self, layouts: &'a [L]) -> Result<Generated, VideoError>
    where
        Layout: From<&'a L>,
    {
        if layouts.is_empty() {
            return Err(VideoError::NoLayouts);
        }
        let mut generated = Generated { frames: Vec::new(), committed: Vec::new(), seam: 0.0 };
        let per_chunk = self.model.config().frames_per_chunk();
        let mut left = layouts;
        while !left.is_empty() {
            let (now, later) = left.split_at(left.len().min(per_chunk - self.pending.len()));
            left = later;
            let published = self.pending.len();
            self.pending.extend(now.iter().map(Layout::from));
            if self.pending.len() < per_chunk {
                self.provisional = self.attempt()?;
                generated.frames.extend(self.fallen(&self.provisional, published));
                break;
            }
            let (control, remembered) = self.control(&self.pending);
            let made = self.make(&control)?;
            let layouts = self.pending.clone();
            let frames = self.decode(&made.clean, &layouts)?;
            if !self.provisional.is_empty() {
                generated.seam = mean_difference(&self.provisional, &frames);
            }
            generated.frames.extend(self.fallen(&frames, published));
            self.remembered = remembered;
            if let (Some(frame), Some(layout)) = (frames.last(), layouts.last()) {
                self.take_along(frame, layout);
            }
            generated.committed.push(self.commit(made, &control));
        }
        Ok(generated)
    }

    /// Rebuilds a rollout from its cache log and the layouts received since the last commit, comparing digests.
    ///
    /// # Errors
    /// [`VideoError::Entry`] for an entry that cannot belong here, [`VideoError::RecoveryMismatch`] for a difference.
    pub fn replay(replay: Replay<'_>) -> Result<Self, VideoError> {
        let Replay { model, draw_key, camera, prompt, first_frame, entries, past, layouts } = replay;
        let Some((first, rest)) = entries.split_first() else {
            let reason = "has no entry 0".to_owned();
            return Err(VideoError::Entry { chunk: 0, field: "entries", reason });
        };
        let (rollout, clean) = Self::prepare(model, draw_key, camera, prompt, first_frame)?;
        let control = entry::checked(&first.control, &rollout.control_shape(1));
        let control = control.map_err(|reason| VideoError::Entry { chunk: 0, field: "control", reason })?;
        let control = rollout.model.dit.control_of(&control);
        let (mut rollout, begun) = rollout.begin(clean, &control)?;
        compare(first, &begun)?;
        for entry in rest {
            let refuse = |field| move |reason| VideoError::Entry { chunk: entry.chunk, field, reason };
            if entry.chunk != rollout.chunk {
                return Err(refuse("chunk")(format!("is {}, {} expected", entry.chunk, rollout.chunk)));
            }
            let shape = rollout.latent_shape();
            let cached_input = entry::checked(&entry.cached_input, &shape).map_err(refuse("cached_input"))?;
            let clean = entry::checked(&entry.clean, &shape).map_err(refuse("clean"))?;
            let control =
                entry::checked(&entry.control, &rollout.control_shape(shape[0])).map_err(refuse("control"))?;
            let control = rollout.model.dit.control_of(&control);
            let level = sampling::cache_level(rollout.model.config());
            let pass = rollout.write(&cached_input, &rollout.start, &control, level);
            // Frames are not wanted here, only the decoder's memory, which layouts do not touch.
            rollout.decode(&clean, &[])?;
            let made = Sampled { entered: Array::default(), clean, cached: cached_input, pass };
            let remade = rollout.commit(made, &control);
            compare(entry, &remade)?;
        }
        if layouts.len() >= rollout.model.config().frames_per_chunk() {
            let reason = format!("are {}, a whole chunk or more", layouts.len());
            return Err(VideoError::Entry { chunk: rollout.chunk, field: "layouts", reason });
        }
        let newest = rest.last().unwrap_or(first);
        rollout.remember(past, newest)?;
        if let (Some(frame), Some(layout)) = (&newest.frame, past.last()) {
            rollout.take_along(frame, layout);
        }
        if !layouts.is_empty() {
            rollout.pending = layouts.to_vec();
            rollout.provisional = rollout.attempt()?;
        }
        Ok(rollout)
    }

    /// Brings the memory of layouts to the last commit, whose control latent must come out again.
    fn remember(&mut self, past: &[Layout], logged: &Cache) -> Result<(), VideoError> {
        let config = self.model.config();
        let (chunk, memory) = (config.frames_per_chunk(), config.layout_memory_ticks());
        if memory == 0 {
            return Ok(());
        }
        let expected = 1 + memory.min((self.chunk as usize - 1) * chunk);
        let Some(from) = past.len().checked_sub(expected) else {
            return Err(VideoError::Remembered { found: past.len(), expected });
        };
        let (begin, rest) = past[from..].split_at(1);
        let mut newest = Tensor::default();
        for layouts in std::iter::once(begin).chain(rest.chunks(chunk)) {
            let (control, remembered) = self.control(layouts);
            self.remembered = remembered;
            newest = self.logged(&control, layouts.len().div_ceil(self.model.config().vae.stride_t));
        }
        let [expected, found] = [&logged.control, &newest].map(entry::digest);
        if expected == found {
            return Ok(());
        }
        Err(VideoError::RecoveryMismatch { chunk: logged.chunk, what: "control", expected, found })
    }

    /// Returns the number of ticks generated so far.
    #[must_use]
    pub fn ticks(&self) -> u32 {
        (self.chunk - 1) * self.model.config().frames_per_chunk() as u32 + self.pending.len() as u32
    }

    /// Returns the digest of all that coming frames depend on.
    #[must_use]
    pub fn state_digest(&self) -> Digest {
        let mut writer = DigestWriter::new();
        let decoder = self.model.codec.decoder_digest(&self.decoder);
        writer.digest(&self.conditioning).digest(&self.cache.digest()).digest(&decoder);
        writer.u32(self.chunk).u64(self.pending.len() as u64);
        for layout in &self.pending {
            layout.image.digest_into(&mut writer);
        }
        self.carry.digest_into(&mut writer);
        writer.finish()
    }

    /// Takes the last frame of what was committed along, if the decoder is to see it again.
    fn take_along(&mut self, frame: &RgbImage, layout: &Layout) {
        if self.model.config().control.carried {
            let air = if self.fall.is_some() { Air::Hazy } else { Air::Clear };
            self.carry = Carry::of(frame, layout, air).painted(self.paint.clone());
        }
    }

    /// Returns the first frame without what falls, at the tick of a layout.
    fn without_fall(&self, layout: &Layout) -> RgbImage {
        let frame = &*self.first_frame;
        match self.fall {
            Some(_) => cleared(frame, &layout.image.resized(frame.width_px(), frame.height_px())),
            None => frame.clone(),
        }
    }

    /// Returns the frames of the chunk under way from one on, with what falls before each.
    fn fallen(&self, frames: &[RgbImage], from: usize) -> Vec<RgbImage> {
        let ticks = (self.first_tick()..).map(Tick);
        let all = frames.iter().zip(&self.pending).zip(ticks).skip(from);
        let carried = self.model.config().control.carried;
        all.map(|((frame, layout), tick)| layout.shown(frame, carried, self.fall, tick)).collect()
    }

    /// Returns the first tick of the chunk under way.
    fn first_tick(&self) -> u32 {
        if self.chunk == 0 { 0 } else { 1 + (self.chunk - 1) * self.model.config().frames_per_chunk() as u32 }
    }

    fn latent_shape(&self) -> [usize; 4] {
        let config = self.model.config();
        [config.causal.chunk, config.dit().tokens(), 4, config.vae.z]
    }

    fn control_shape(&self, frames: usize) -> [usize; 4] {
        let config = self.model.config();
        [frames, config.dit().tokens(), 4, config.control.channels]
    }

    /// Makes the chunk under way with its newest layout repeated; changes nothing.
    fn attempt(&self) -> Result<Vec<RgbImage>, VideoError> {
        let mut padded = self.pending.clone();
        if let Some(newest) = self.pending.last() {
            padded.resize(self.model.config().frames_per_chunk(), newest.clone());
        }
        let made = self.make(&self.control(&padded).0)?;
        let mut frames = self.clone().decode(&made.clean, &padded)?;
        frames.truncate(self.pending.len());
        Ok(frames)
    }

    /// Computes the control latent of the layouts of whole latent frames, a single one for the first, and what is then
    /// remembered of layouts.
    fn control(&self, layouts: &[Layout]) -> (Control, LayoutMemory) {
        let config = self.model.config();
        let video = &config.video;
        let layouts: Vec<RgbImage> =
            layouts.iter().map(|layout| layout.image.resized(video.width_px, video.height_px)).collect();
        let mut remembered = self.remembered.clone();
        let layouts: Vec<&RgbImage> = layouts.iter().collect();
        let control = self.model.codec.control(&*self.model.dit, config, &layouts, &mut remembered);
        (control, remembered)
    }

    /// Reads a control latent of some latent frames back for the log.
    fn logged(&self, control: &Control, frames: usize) -> Tensor {
        let values = self.model.dit.control_values(control).into_values();
        entry::tensor(&Array::new(&self.control_shape(frames), values))
    }

    /// Denoises the chunk under way.
    fn make(&self, control: &Control) -> Result<Sampled, VideoError> {
        let (config, shape) = (self.model.config(), self.latent_shape());
        let noise = |step: usize| sampler::noise(&self.draw_key, &self.camera, self.chunk, step, &shape);
        let window = self.cache.window(&*self.model.dit, config.causal.chunk);
        let made = self.sampling(&self.start, control, &window).chunk(config.sampler.steps, noise);
        if made.clean.is_finite() { Ok(made) } else { Err(VideoError::NotFinite { chunk: self.chunk }) }
    }

    fn sampling<'a>(&'a self, start: &'a Array, control: &'a Control, window: &'a Window) -> Sampling<'a> {
        let (config, dit) = (self.model.config(), &*self.model.dit);
        Sampling { config, dit, start, control, window, context: &self.context }
    }

    /// Runs the forward pass whose keys and values are cached.
    fn write(&self, input: &Array, start: &Array, control: &Control, level: f32) -> (Array, ChunkKv) {
        let window = self.cache.window(&*self.model.dit, input.shape()[0]);
        self.sampling(start, control, &window).pass(input, level)
    }

    /// Decodes a chunk, guided by its layouts if there are any, and moves the decoder on.
    fn decode(&mut self, clean: &Array, layouts: &[Layout]) -> Result<Vec<RgbImage>, VideoError> {
        let config = self.model.config();
        let (h, w) = config.latent_size();
        let (width, height) = (config.video.width_px, config.video.height_px);
        let guide = (config.control.decoder_layers > 0 && !layouts.is_empty()).then(|| {
            let seen: Vec<&Layout> = layouts.iter().collect();
            self.carry.guide(&config.ae(), width, height, &seen)
        });
        let latents = tokens::tokens_to_latents(clean, h, w);
        let decoded = self.model.codec.decode(latents, guide.as_ref(), &mut self.decoder);
        if !decoded.is_finite() {
            return Err(VideoError::NotFinite { chunk: self.chunk });
        }
        let images = decoded.values().chunks_exact(width as usize * height as usize * 3);
        let mut images: Vec<RgbImage> = images.map(|values| RgbImage::of_values(values, width, height)).collect();
        for (image, layout) in images.iter_mut().zip(layouts).filter(|_| config.control.carried) {
            *image = layout.calmed(image);
        }
        Ok(images)
    }

    fn commit(&mut self, made: Sampled, control: &Control) -> Cache {
        let config = self.model.config();
        let per_chunk = config.frames_per_chunk() as u32;
        let frames = made.clean.shape()[0];
        let (output, kv) = &made.pass;
        if config.is_published() {
            self.cache.commit_by(kv, output)
        } else {
            self.cache.commit(kv)
        }
        let entry = Cache {
            chunk: self.chunk,
            first: Tick(self.first_tick()),
            ticks: if self.chunk == 0 { 1 } else { per_chunk },
            cached_input: entry::tensor(&made.cached),
            clean: entry::tensor(&made.clean),
            control: self.logged(control, frames),
            conditioning: self.conditioning,
            cache_digest: self.cache.digest(),
            encoder_digest: self.encoder_digest,
            decoder_digest: self.model.codec.decoder_digest(&self.decoder),
            frame: self.carry.frame().cloned(),
        };
        self.chunk += 1;
        self.pending.clear();
        self.provisional.clear();
        entry
    }
}

/// Compares the digests of a log entry with those of the replay.
fn compare(logged: &Cache, remade: &Cache) -> Result<(), VideoError> {
    let pairs = [
        ("conditioning", logged.conditioning, remade.conditioning),
        ("cache_digest", logged.cache_digest, remade.cache_digest),
        ("encoder_digest", logged.encoder_digest, remade.encoder_digest),
        ("decoder_digest", logged.decoder_digest, remade.decoder_digest),
    ];
    match pairs.into_iter().find(|(_, expected, found)| expected != found) {
        Some((what, expected, found)) => {
            Err(VideoError::RecoveryMismatch { chunk: logged.chunk, what, expected, found })
        }
        None => Ok(()),
    }
}

fn mean_difference(a: &[RgbImage], b: &[RgbImage]) -> f32 {
    let pairs = a.iter().zip(b).flat_map(|(a, b)| a.rgb().iter().zip(b.rgb()));
    let (sum, count) = pairs.fold((0u64, 0u64), |(sum, n), (a, b)| (sum + u64::from(a.abs_diff(*b)), n + 1));
    #[expect(clippy::cast_possible_truncation, reason = "a figure for people")]
    let mean = (sum as f64 / count.max(1) as f64) as f32;
    mean
}
