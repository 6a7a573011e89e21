//! Guidance: Ĝ = G(c∅) + w·(G(c) − G(c∅)), the paper's convention (section 3.2 of the specification), on clean latents.
//!
//! c∅ lacks something that the teacher's training dropped: the layout alone in the traffic-guided arm, the whole
//! condition in standard classifier-free guidance. w = 1 is the plain condition and costs one pass.

use ds_nn::body::Backend;
use ds_nn::step::ClipBatch;
use ds_nn::training::WholeClips;
use ds_nn::{Array, Weights, WeightsError};
use ds_video::{ModelConfig, sampler};

use crate::config::Dropout;

/// A bidirectional network and how it is guided.
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

    /// Predicts the clean latents of noisy frames [1, F − 1, tokens, 4, z] of one clip at level σ under guidance w.
    #[must_use]
    pub fn clean(&self, batch: &ClipBatch, noisy: &Array, sigma: f32, w: f32) -> Array {
        let predict = |batch: &ClipBatch| self.network.clean(batch, noisy, &[sigma], self.model.prediction());
        let with = predict(batch);
        if (w - 1.0).abs() < f32::EPSILON {
            return with;
        }
        let mut without = batch.clone();
        without.layout_on = vec![0.0];
        if self.unconditional == Dropout::All {
            without.given_on = vec![0.0];
        }
        let without = predict(&without);
        let guided = without.values().iter().zip(with.values()).map(|(without, with)| without + w * (with - without));
        Array::new(noisy.shape(), guided.collect())
    }

    /// Samples frames 1..F of one clip from noise by Euler steps of the guided flow; `visit` sees the state at each
    /// level before its step, counted from 0.
    #[must_use]
    pub fn sample(
        &self,
        batch: &ClipBatch,
        noise: &Array,
        steps: usize,
        w: f32,
        visit: &mut dyn FnMut(usize, &Array),
    ) -> Array {
        let mut sigmas = sampler::sigmas(steps, self.model.sampler.shift);
        sigmas.push(0.0);
        let mut state = noise.clone();
        for (at, pair) in sigmas.windows(2).enumerate() {
            visit(at, &state);
            let clean = self.clean(batch, &state, pair[0], w);
            // x' = x + (σ' − σ)·v with v = (x − x0) / σ.
            let share = pair[1] / pair[0];
            for (value, clean) in state.values_mut().iter_mut().zip(clean.values()) {
                *value = clean + share * (*value - clean);
            }
        }
        state
    }
}
