//! The teacher's forward pass over whole clips: every frame sees every other, nothing is cached.

use std::sync::Arc;

use ds_nn::array::{Array, Weights, WeightsError};
use ds_nn::dit::DitShape;
use ds_nn::step::{ClipBatch, Prediction};

use super::buffer::Pool;
use super::network::{ContextKeys, Network, Scratch, Sequence};
use super::rotary::Rotary;

/// The bidirectional transformer with packed weights.
pub struct FastTeacher {
    network: Network,
    scratch: Arc<Pool<Scratch>>,
}

impl FastTeacher {
    /// Packs weights.
    ///
    /// # Errors
    /// If the weights do not fit the shape.
    pub fn new(shape: &DitShape, weights: &Weights) -> Result<Self, WeightsError> {
        weights.check(&shape.declare())?;
        Ok(Self { network: Network::new(shape, weights), scratch: Arc::default() })
    }

    /// Returns the output for noisy frames 1..F [B, F − 1, tokens, 4, z] at one level per clip, after the given first
    /// frames: equal to the pass of `ds_graph::step::bidirectional`.
    #[must_use]
    pub fn output(&self, batch: &ClipBatch, noisy: &Array, levels: &[f32]) -> Array {
        let [clips, later, tokens, _, z]: [usize; 5] = noisy.shape().try_into().expect("latents have five axes");
        let (shape, frames) = (&self.network.shape, later + 1);
        let (frame, text) = (tokens * 4 * z, shape.text_len * shape.text_dim);
        let given =
            |values: &[f32], at: usize| values.iter().map(|value| value * batch.given_on[at]).collect::<Vec<_>>();
        let clip = batch.clean.values().len() / clips;
        let starts: Vec<Vec<f32>> =
            (0..clips).map(|at| given(&batch.start.values()[at * frame..(at + 1) * frame], at)).collect();
        let states = |at: usize| {
            let mut states = given(&batch.clean.values()[at * clip..at * clip + frame], at);
            states.extend_from_slice(&noisy.values()[at * later * frame..(at + 1) * later * frame]);
            states
        };
        let states: Vec<Vec<f32>> = (0..clips).map(states).collect();
        let prompt =
            |at: usize| self.network.context(&given(&batch.text.values()[at * text..(at + 1) * text], at), &starts[at]);
        let contexts: Vec<ContextKeys> = (0..clips).map(prompt).collect();
        let starts: Vec<Vec<f32>> = starts.iter().map(|first| start(first, frames, shape.start_every)).collect();
        let control = self.network.control(batch.layouts.values());
        let mut rotary = Rotary::default();
        self.network.grid.fill(&(0..frames).collect::<Vec<_>>(), &mut rotary);
        let times = |level: &f32| std::iter::once(0.0).chain(std::iter::repeat_n(1000.0 * level, later)).collect();
        let times: Vec<Vec<f32>> = levels.iter().map(times).collect();
        let pixels = frames * tokens * 4 * shape.control_channels;
        let sequence = |at: usize| Sequence {
            noisy: &states[at],
            control: &control[at * pixels..(at + 1) * pixels],
            control_on: batch.layout_on[at],
            start: &starts[at],
            times: &times[at],
            context: &contexts[at],
            window: None,
            rotary: &rotary,
        };
        let sequences: Vec<Sequence<'_>> = (0..clips).map(sequence).collect();
        let mut scratch = self.scratch.take(Scratch::default);
        self.network.forward(&sequences, false, &mut scratch);
        let output: Vec<f32> = scratch.blocks.iter().flat_map(|block| block.output.iter()).copied().collect();
        let rest = output.chunks_exact(frames * frame).flat_map(|clip| &clip[frame..]).copied().collect();
        Array::new(noisy.shape(), rest)
    }

    /// Predicts clean latents: equal to `ds_graph::step::bidirectional_clean`.
    #[must_use]
    pub fn clean(&self, batch: &ClipBatch, noisy: &Array, levels: &[f32], prediction: Prediction) -> Array {
        let output = self.output(batch, noisy, levels);
        match prediction {
            Prediction::Clean => output,
            Prediction::Flow => {
                let clip = noisy.values().len() / levels.len().max(1);
                let values = noisy.values().iter().zip(output.values()).enumerate();
                Array::new(noisy.shape(), values.map(|(at, (x, v))| x - levels[at / clip] * v).collect())
            }
        }
    }
}

/// Returns the start latents of all frames, given the first frame's.
fn start(first: &[f32], frames: usize, every: bool) -> Vec<f32> {
    if every {
        return first.repeat(frames);
    }
    let mut start = first.to_vec();
    start.resize(first.len() * frames, 0.0);
    start
}
