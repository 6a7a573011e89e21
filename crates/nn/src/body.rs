//! The two networks behind traits, each with two bodies: the framework's graph, and the processor's own path ([`fast`]).
//!
//! What a body keeps between calls is an opaque handle that only the body that made it can read, so that a body on an
//! accelerator leaves its tensors there. Handles of one body given to another are a mistake of the caller.
//!
//! [`fast`]: crate::fast

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::array::{Array, Weights, WeightsError};
use crate::cache::{ChunkKv, FrameKv, Window};
use crate::device::{self, DeviceError};
use crate::dit::{self, Dit, DitShape};
use crate::fast::network::ContextKeys;
use crate::fast::{Buffer, FastAe, FastDit, work};
use crate::tiny_ae::{AeShape, Memory, TinyAe};

/// Which body computes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Backend {
    /// The processor's own path.
    #[default]
    Cpu,
    /// The machine-learning framework's graph on the processor.
    Framework,
    /// The same on a graphics processor through Vulkan.
    Vulkan,
    /// The same on a graphics processor of NVIDIA through CUDA.
    Cuda,
}

impl Backend {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Cpu, Self::Framework, Self::Vulkan, Self::Cuda];

    /// Returns the name in settings.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Framework => "framework",
            Self::Vulkan => "vulkan",
            Self::Cuda => "cuda",
        }
    }

    /// Makes sure that the device is there and makes it the one of this process; graphics processors need this before
    /// anything is bound. Returns what the device is.
    ///
    /// # Errors
    /// If this build lacks the back end, this machine the device, or another is in use.
    pub fn ready(self) -> Result<String, DeviceError> {
        device::choose(self)
    }

    /// Binds the transformer's weights.
    ///
    /// # Errors
    /// If the weights do not fit the shape, or the back end has no such layers.
    pub fn transformer(self, shape: &DitShape, weights: &Weights) -> Result<Box<dyn Transformer>, WeightsError> {
        Ok(match self {
            Self::Cpu if !shape.is_own() => return Err(WeightsError::Backend { backend: self.name() }),
            Self::Cpu => Box::new(FastDit::new(shape, weights)?),
            Self::Framework | Self::Vulkan | Self::Cuda => {
                device::expect(self);
                Box::new(Dit::new(shape, weights)?)
            }
        })
    }

    /// Binds the autoencoder's weights.
    ///
    /// # Errors
    /// If the weights do not fit the shape.
    pub fn autoencoder(self, shape: &AeShape, weights: &Weights) -> Result<Box<dyn Autoencoder>, WeightsError> {
        Ok(match self {
            Self::Cpu => Box::new(FastAe::new(shape, weights)?),
            Self::Framework | Self::Vulkan | Self::Cuda => {
                device::expect(self);
                Box::new(TinyAe::new(shape, weights)?)
            }
        })
    }
}

impl std::str::FromStr for Backend {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let known = Self::ALL.into_iter().find(|backend| backend.name() == text);
        known.ok_or_else(|| format!("{text:?} is no back end of the video model: cpu, framework, vulkan, cuda"))
    }
}

/// Something that one of the bodies holds.
#[derive(Clone)]
pub(crate) enum Held<G, F> {
    Graph(G),
    Fast(F),
}

impl<G, F> Held<G, F> {
    pub(crate) fn graph(&self) -> &G {
        match self {
            Self::Graph(held) => held,
            Self::Fast(_) => panic!("a handle of the processor's path was given to the graph"),
        }
    }

    pub(crate) fn fast(&self) -> &F {
        match self {
            Self::Fast(held) => held,
            Self::Graph(_) => panic!("a handle of the graph was given to the processor's path"),
        }
    }
}

/// The keys and values of a prompt and a first frame.
#[derive(Clone)]
pub struct Context(pub(crate) Held<dit::Context, Arc<ContextKeys>>);

/// The control latent of some frames.
#[derive(Clone)]
pub struct Control(pub(crate) Held<dit::Control, Arc<Buffer>>);

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
    /// A guided decoder also takes the layouts, in the shape of the frames and of values −1 to 1, or none for "no
    /// layout". The memory does not depend on them.
    fn decode(&self, latents: &Array, layouts: Option<&Array>, memory: &mut Memory) -> Array;
}

impl Transformer for Dit {
    fn shape(&self) -> &DitShape {
        &self.shape
    }

    fn forwards(&self) -> u64 {
        Self::forwards(self)
    }

    fn context(&self, text: &Array, first: &Array) -> Context {
        Context(Held::Graph(Self::context(self, text, first)))
    }

    fn control(&self, layouts: &Array) -> Control {
        Control(Held::Graph(Self::control(self, layouts)))
    }

    fn control_of(&self, latent: &Array) -> Control {
        Control(Held::Graph(Self::control_of(self, latent)))
    }

    fn control_values(&self, control: &Control) -> Array {
        let values = control.0.graph().values();
        // Without channels the graph holds a placeholder.
        if self.shape.control_channels > 0 { values } else { Array::zeros(&[1, values.shape()[1], 4, 0]) }
    }

    fn window(&self, frames: &[(&FrameKv, usize)], current: &[usize]) -> Window {
        Window::of_graph(self, frames, current)
    }

    fn denoise(&self, chunk: &Chunk<'_>, window: &Window, context: &Context) -> (Array, ChunkKv) {
        let Chunk { noisy, start, control, time } = *chunk;
        Self::denoise(self, &dit::Chunk { noisy, start, control: control.0.graph(), time }, window, context.0.graph())
    }
}

impl Autoencoder for TinyAe {
    fn encode(&self, steps: &Array, memory: &mut Memory) -> Array {
        Self::encode(self, steps, memory)
    }

    fn decode(&self, latents: &Array, layouts: Option<&Array>, memory: &mut Memory) -> Array {
        Self::decode(self, latents, layouts, memory)
    }
}
