//! Guidance: Ĝ = G(c∅) + w·(G(c) − G(c∅)), the paper's convention (section 3.2 of the specification), on clean latents.
//!
//! c∅ lacks something that the teacher's training dropped: the layout alone in the traffic-guided arm, the whole
//! condition in standard classifier-free guidance. w = 1 is the plain condition and costs one pass.
//!
//! A layout says what is where, not how the day is; a teacher that has seen layouts in one look alone still pulls towards
//! that look, and w > 1 amplifies it. Where c∅ keeps the first frame, [`Guidance::keep_look`] gives each latent channel of
//! each frame the mean and deviation that it has under c∅.
//!
//! Guidance at every level of noise pushes samples beyond the data; kept to the middle levels it decides what is where and
//! leaves the rest to the plain network (Kynkäänniemi et al. 2024, "Applying Guidance in a Limited Interval Improves Sample
//! and Distribution Quality in Diffusion Models").

use ds_nn::step::ClipBatch;
use ds_nn::{Array, Weights, WeightsError};
use ds_video::{Backend, ModelConfig, WholeClips, sampler};
use serde::{Deserialize, Serialize};

/// What a condition can lack: the teacher learns to do without it, and guidance amplifies it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Dropout {
    /// The layout alone; first frame and prompt stay (the paper's traffic-guided arm).
    #[default]
    Layout,
    /// Layout, first frame and prompt together (standard classifier-free guidance).
    All,
}

/// How a network is guided.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Guidance {
    /// w in G(c∅) + w·(G(c) − G(c∅)); 1 is none.
    pub weight: f32,
    /// Whether mean and deviation of each latent channel of a frame stay as c∅ has them.
    pub keep_look: bool,
    /// Lowest and highest level σ at which it acts.
    pub levels: [f32; 2],
}

impl Guidance {
    /// Guidance by a weight alone.
    #[must_use]
    pub fn by(weight: f32) -> Self {
        Self { weight, keep_look: false, levels: Self::EVERYWHERE }
    }

    /// All levels.
    pub const EVERYWHERE: [f32; 2] = [0.0, 1.0];

    /// Whether c∅ is asked at a level.
    fn acts(&self, sigma: f32) -> bool {
        (self.weight - 1.0).abs() >= f32::EPSILON && (self.levels[0]..=self.levels[1]).contains(&sigma)
    }
}

/// A bidirectional network and what its guidance does without.
pub struct Teacher {
    /// The model.
    pub model: ModelConfig,
    /// Its network.
    network: Box<dyn WholeClips>,
    /// What c∅ lacks.
    unconditional: Dropout,
}

impl Teacher {
    /// Binds weights for the default back end.
    ///
    /// # Errors
    /// As [`Self::new_on`].
    pub fn new(model: &ModelConfig, weights: &Weights, unconditional: Dropout) -> Result<Self, WeightsError> {
        Self::new_on(Backend::default(), model, weights, unconditional)
    }

    /// Binds weights for a back end.
    ///
    /// # Errors
    /// If they do not fit the model.
    pub fn new_on(
        backend: Backend,
        model: &ModelConfig,
        weights: &Weights,
        unconditional: Dropout,
    ) -> Result<Self, WeightsError> {
        Ok(Self { model: model.clone(), network: backend.whole_clips(&model.dit(), weights)?, unconditional })
    }

    /// Predicts the clean latents of noisy frames [B, F − 1, tokens, 4, z] at one level σ under guidance.
    #[must_use]
    pub fn clean(&self, batch: &ClipBatch, noisy: &Array, sigma: f32, guidance: Guidance) -> Array {
        let (w, clips) = (guidance.weight, batch.layout_on.len());
        let levels = vec![sigma; clips];
        let predict = |batch: &ClipBatch| self.network.clean(batch, noisy, &levels, self.model.prediction());
        let with = predict(batch);
        if !guidance.acts(sigma) {
            return with;
        }
        let mut without = batch.clone();
        without.layout_on = vec![0.0; clips];
        if self.unconditional == Dropout::All {
            without.given_on = vec![0.0; clips];
        }
        let without = predict(&without);
        let guided = without.values().iter().zip(with.values()).map(|(without, with)| without + w * (with - without));
        let mut guided: Vec<f32> = guided.collect();
        if guidance.keep_look {
            let frame = noisy.shape()[2..].iter().product();
            for (frame, like) in guided.chunks_exact_mut(frame).zip(without.values().chunks_exact(frame)) {
                take_moments(frame, like, self.model.vae.z);
            }
        }
        Array::new(noisy.shape(), guided)
    }

    /// Samples frames 1..F from noise by Euler steps of the guided flow; `visit` sees the state at each
    /// level before its step, counted from 0.
    #[must_use]
    pub fn sample(
        &self,
        batch: &ClipBatch,
        noise: &Array,
        steps: usize,
        guidance: Guidance,
        visit: &mut dyn FnMut(usize, &Array),
    ) -> Array {
        let mut sigmas = sampler::sigmas(steps, self.model.sampler.shift);
        sigmas.push(0.0);
        let mut state = noise.clone();
        for (at, pair) in sigmas.windows(2).enumerate() {
            visit(at, &state);
            let clean = self.clean(batch, &state, pair[0], guidance);
            // x' = x + (σ' − σ)·v with v = (x − x0) / σ.
            let share = pair[1] / pair[0];
            for (value, clean) in state.values_mut().iter_mut().zip(clean.values()) {
                *value = clean + share * (*value - clean);
            }
        }
        state
    }
}

/// How much a channel's deviation may change.
const STRETCH: (f32, f32) = (0.5, 2.0);

/// Gives each of the `z` channels of a frame mean and deviation of another frame's.
fn take_moments(frame: &mut [f32], like: &[f32], z: usize) {
    for channel in 0..z {
        let moments = |values: &[f32]| {
            let channel = || values[channel..].iter().step_by(z).map(|value| f64::from(*value));
            let count = (values.len() / z) as f64;
            let mean = channel().sum::<f64>() / count;
            let square = channel().map(|value| (value - mean).powi(2)).sum::<f64>() / count;
            #[expect(clippy::cast_possible_truncation, reason = "latents are single precision")]
            let moments = (mean as f32, square.sqrt() as f32);
            moments
        };
        let ((mean, deviation), (wanted, wide)) = (moments(frame), moments(like));
        let stretch = (wide / deviation.max(1e-6)).clamp(STRETCH.0, STRETCH.1);
        frame[channel..].iter_mut().step_by(z).for_each(|value| *value = wanted + stretch * (*value - mean));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn guidance_acts_within_its_levels_alone() {
        let acts = |weight, levels, sigma| Guidance { levels, ..Guidance::by(weight) }.acts(sigma);
        assert!(acts(2.0, Guidance::EVERYWHERE, 1.0) && acts(2.0, Guidance::EVERYWHERE, 0.0));
        assert!(!acts(1.0, Guidance::EVERYWHERE, 0.5), "w = 1 is the plain condition");
        assert!(acts(2.0, [0.3, 0.8], 0.5) && !acts(2.0, [0.3, 0.8], 0.9) && !acts(2.0, [0.3, 0.8], 0.2));
    }

    #[test]
    fn a_frame_takes_the_moments_of_each_channel() {
        // Channels in turn: 1, 3, 5 becomes as wide and high as 10, 13, 16; the other is as it was.
        let (mut frame, like) = ([1.0, 7.0, 3.0, 8.0, 5.0, 9.0], [10.0, 8.0, 13.0, 9.0, 16.0, 7.0]);
        take_moments(&mut frame, &like, 2);
        let expected = [10.0, 7.0, 13.0, 8.0, 16.0, 9.0];
        assert!(frame.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-5), "{frame:?}");
    }
}
