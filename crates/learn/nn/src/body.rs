//! The two networks behind traits, whatever computes them: the framework's graph, or loops of this project.
//!
//! What a body keeps between calls is an opaque handle that only the body that made it can read, so that a body on an
//! accelerator leaves its tensors there. Handles of one body given to another are a mistake of the caller.

use std::any::Any;
use std::sync::Arc;

use ds_space::{Digest, DigestWriter};

use crate::array::Array;
use crate::dit::DitShape;
use crate::tiny_ae::Memory;
use crate::work;

/// What a body keeps between calls. Only the body that made it can read it; a clone shares it.
#[derive(Clone)]
pub struct Handle(Arc<dyn Any + Send + Sync>);

impl Handle {
    /// Wraps what is kept.
    pub fn new(kept: impl Any + Send + Sync) -> Self {
        Self(Arc::new(kept))
    }

    /// Returns what is kept.
    ///
    /// # Panics
    /// If another body made the handle.
    #[must_use]
    pub fn of<T: Any>(&self) -> &T {
        self.0.downcast_ref().expect("a handle goes to the body that made it")
    }
}

/// The keys and values of a prompt and a first frame.
#[derive(Clone)]
pub struct Context(pub Handle);

/// The control latent of some frames.
#[derive(Clone)]
pub struct Control(pub Handle);

/// Keys (un-rotated) and values of one chunk, as a body keeps them.
pub trait Cached: Send + Sync {
    /// Returns the frames of the chunk.
    fn frames(&self) -> usize;

    /// Adds all keys and values to a digest.
    fn digest_into(&self, writer: &mut DigestWriter);

    /// Returns those of one frame, as [`Transformer::window`] takes them.
    fn frame(self: Arc<Self>, index: usize) -> FrameKv;
}

/// Keys and values of one chunk, keys un-rotated.
#[derive(Clone)]
pub struct ChunkKv(pub(crate) Arc<dyn Cached>);

/// Keys and values of one frame of a chunk.
#[derive(Clone)]
pub struct FrameKv(pub Handle);

/// The rotated keys and the values that a chunk sees, and the rotation of the chunk itself.
pub struct Window(pub Handle);

impl ChunkKv {
    /// Wraps what a body keeps of a chunk.
    #[must_use]
    pub fn new(kept: impl Cached + 'static) -> Self {
        Self(Arc::new(kept))
    }

    /// Returns the digest of all keys and values of the chunk.
    #[must_use]
    pub fn digest(&self) -> Digest {
        let mut writer = DigestWriter::new();
        self.0.digest_into(&mut writer);
        writer.finish()
    }
}

/// A chunk to denoise.
pub struct Chunk<'a> {
    /// The noisy latent, [frames, tokens, 4, z].
    pub noisy: &'a Array,
    /// The start latent: the first frame's clean tokens in frame 0 of the rollout; elsewhere the same or zeros.
    pub start: &'a Array,
    /// The control latent of the chunk.
    pub control: &'a Control,
    /// The timestep, 0 to 1000.
    pub time: f32,
}

/// What is needed to run one chunk.
#[derive(Clone, Copy)]
pub struct Job<'a> {
    /// The chunk.
    pub chunk: &'a Chunk<'a>,
    /// What was cached before it.
    pub window: &'a Window,
    /// What cross-attention sees.
    pub context: &'a Context,
}

/// The patch diffusion transformer.
pub trait Transformer: Send + Sync {
    /// Returns its sizes.
    fn shape(&self) -> &DitShape;

    /// Returns how many chunks were denoised.
    fn forwards(&self) -> u64;

    /// Computes the context's keys and values: `text` is [1, text_len, text_dim], `first` the first frame's clean
    /// tokens [1, tokens, 4, z].
    fn context(&self, text: &Array, first: &Array) -> Context;

    /// Computes the control latent of space-to-depth layouts [1, F·tokens, 4, control inputs].
    fn control(&self, layouts: &Array) -> Control;

    /// Takes a control latent [frames, tokens, 4, channels] from its values.
    fn control_of(&self, latent: &Array) -> Control;

    /// Reads a control latent back, [1, frames·tokens, 4, channels].
    fn control_values(&self, control: &Control) -> Array;

    /// Rotates cached frames at their positions for a chunk whose own frames stand at `current`.
    fn window(&self, frames: &[(&FrameKv, usize)], current: &[usize]) -> Window;

    /// Runs one chunk against a window of cached frames. Returns the network's output in the shape of the noisy
    /// latent, and the chunk's keys and values.
    fn denoise(&self, chunk: &Chunk<'_>, window: &Window, context: &Context) -> (Array, ChunkKv);

    /// Runs chunks of several rollouts; each gets what it would get alone.
    fn denoise_many(&self, jobs: &[Job<'_>]) -> Vec<(Array, ChunkKv)> {
        jobs.iter().map(|job| self.denoise(job.chunk, job.window, job.context)).collect()
    }

    /// Returns the floating-point operations of denoising a chunk of `frames` frames against `cached` frames.
    fn operations(&self, frames: usize, cached: usize) -> f64 {
        work::denoise(self.shape(), frames, cached)
    }
}

/// The streaming video autoencoder.
pub trait Autoencoder: Send + Sync {
    /// Encodes latent steps [steps, h, w, inputs] that follow those already in `memory`.
    fn encode(&self, steps: &Array, memory: &mut Memory) -> Array;

    /// Decodes latents [steps, h, w, z] that follow those already in `memory` to [steps·stride_t, 8h, 8w, 3].
    ///
    /// A guided decoder also takes what guides each pixel of the frames, [`AeShape::guide_channels`] of values −1 to 1, or none for
    /// "no layout". The memory does not depend on it.
    ///
    /// [`AeShape::guide_channels`]: crate::tiny_ae::AeShape::guide_channels
    fn decode(&self, latents: &Array, guide: Option<&Array>, memory: &mut Memory) -> Array;
}
