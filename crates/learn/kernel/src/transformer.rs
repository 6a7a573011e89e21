//! The transformer for chunks against a cached window: the counterpart of `ds_graph::dit::Dit`.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use ds_nn::array::{Array, Weights, WeightsError};
use ds_nn::body::{Chunk, ChunkKv, Context, Control, FrameKv, Handle, Job, Transformer, Window};
use ds_nn::dit::DitShape;

use super::Buffer;
use super::buffer::{Pool, Pooled};
use super::cache::{Captured, FrameRows, Sight};
use super::network::{Network, Scratch, Sequence};

/// The transformer with packed weights.
pub struct FastDit {
    network: Network,
    scratch: Arc<Pool<Scratch>>,
    sights: Arc<Pool<Sight>>,
    forwards: AtomicU64,
}

impl FastDit {
    /// Packs weights.
    ///
    /// # Errors
    /// If the weights do not fit the shape.
    pub fn new(shape: &DitShape, weights: &Weights) -> Result<Self, WeightsError> {
        weights.check(&shape.declare())?;
        Ok(Self {
            network: Network::new(shape, weights),
            scratch: Arc::default(),
            sights: Arc::default(),
            forwards: AtomicU64::new(0),
        })
    }
}

impl Transformer for FastDit {
    fn shape(&self) -> &DitShape {
        &self.network.shape
    }

    fn forwards(&self) -> u64 {
        self.forwards.load(Ordering::Relaxed)
    }

    fn context(&self, text: &Array, first: &Array) -> Context {
        Context(Handle::new(self.network.context(text.values(), first.values())))
    }

    fn control(&self, layouts: &Array) -> Control {
        Control(Handle::new(self.network.control(layouts.values())))
    }

    fn control_of(&self, latent: &Array) -> Control {
        Control(Handle::new(Buffer::of(latent.values())))
    }

    fn control_values(&self, control: &Control) -> Array {
        let (values, channels) = (control.0.of::<Buffer>(), self.shape().control_channels);
        Array::new(&[1, values.len() / (4 * channels), 4, channels], values.to_vec())
    }

    fn window(&self, frames: &[(&FrameKv, usize)], current: &[usize]) -> Window {
        let frames: Vec<(FrameRows, usize)> =
            frames.iter().map(|(frame, at)| (frame.0.of::<FrameRows>().clone(), *at)).collect();
        let layers = self.shape().layers;
        Window(Handle::new(Sight::read(&self.sights, &self.network.grid, layers, &frames, current)))
    }

    fn denoise(&self, chunk: &Chunk<'_>, window: &Window, context: &Context) -> (Array, ChunkKv) {
        self.denoise_many(&[Job { chunk, window, context }]).remove(0)
    }

    fn denoise_many(&self, jobs: &[Job<'_>]) -> Vec<(Array, ChunkKv)> {
        let times: Vec<[f32; 1]> = jobs.iter().map(|job| [job.chunk.time]).collect();
        let sequences: Vec<Sequence<'_>> = jobs.iter().zip(&times).map(|(job, times)| sequence(job, times)).collect();
        let mut scratch = self.scratch.take(Scratch::default);
        self.network.forward(&sequences, true, &mut scratch);
        self.forwards.fetch_add(jobs.len() as u64, Ordering::Relaxed);
        let mut result = |(at, job): (usize, &Job<'_>)| {
            let noisy = job.chunk.noisy;
            let (mut output, mut blocks) = (Vec::with_capacity(noisy.values().len()), Vec::new());
            for block in scratch.blocks.iter_mut().filter(|block| block.sequence == at) {
                output.extend_from_slice(&block.output);
                blocks.extend(block.capture.take());
            }
            let frames = noisy.shape()[0];
            let captured = Captured { blocks, layers: self.shape().layers, dim: self.shape().dim, frames };
            (Array::new(noisy.shape(), output), ChunkKv::new(captured))
        };
        jobs.iter().enumerate().map(&mut result).collect()
    }
}

fn sequence<'a>(job: &'a Job<'a>, times: &'a [f32]) -> Sequence<'a> {
    let window: &Sight = job.window.0.of::<Pooled<Sight>>();
    Sequence {
        noisy: job.chunk.noisy.values(),
        control: job.chunk.control.0.of::<Buffer>(),
        control_on: 1.0,
        start: job.chunk.start.values(),
        times,
        context: job.context.0.of(),
        window: Some(window),
        rotary: &window.current,
    }
}
