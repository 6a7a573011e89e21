//! Training steps and whole clips by the body that a back end names: loops of this project on the processor
//! ([`ds_kernel::train`]), the framework's graph ([`ds_graph::step`]) elsewhere. Both give the same numbers up to
//! rounding.

use ds_graph::dit::Dit;
use ds_graph::{device, step};
use ds_kernel::{FastTeacher, train};
use ds_nn::array::{Array, Weights, WeightsError};
use ds_nn::dit::DitShape;
use ds_nn::step::{Adversary, AeBatch, BidirectionalPlan, CausalPlan, ClipBatch, DecoderBatch, Prediction, Step};
use ds_nn::team::Team;
use ds_nn::tiny_ae::AeShape;

use super::Backend;

/// The bidirectional transformer over whole clips, without gradients.
pub trait WholeClips: Send + Sync {
    /// Predicts the clean latents of noisy frames [B, F − 1, tokens, 4, z] at one level per clip.
    fn clean(&self, batch: &ClipBatch, noisy: &Array, levels: &[f32], prediction: Prediction) -> Array;
}

impl WholeClips for FastTeacher {
    fn clean(&self, batch: &ClipBatch, noisy: &Array, levels: &[f32], prediction: Prediction) -> Array {
        Self::clean(self, batch, noisy, levels, prediction)
    }
}

impl WholeClips for Dit {
    fn clean(&self, batch: &ClipBatch, noisy: &Array, levels: &[f32], prediction: Prediction) -> Array {
        step::clean_by(self, batch, noisy, levels, prediction)
    }
}

impl Backend {
    /// Says whether the clips of a batch are joined: a device computes many at once, while a core computes one.
    #[must_use]
    pub fn joins(self) -> bool {
        matches!(self, Self::Vulkan | Self::Cuda)
    }

    /// Returns what computes small networks that clips pass one by one: a device leaves them to the processor.
    #[must_use]
    pub fn for_single_clips(self) -> Self {
        if self.joins() { Self::Cpu } else { self }
    }

    /// Gathers workers for the clips of a batch: one per core of a processor; a device computes clip after clip.
    #[must_use]
    pub fn team(self) -> Team {
        match self {
            Self::Cpu | Self::Framework => Team::of_all_cores(),
            Self::Vulkan | Self::Cuda => Team::new(1),
        }
    }

    /// Says whether the framework's graph computes, and that the device is this process's.
    fn graph(self) -> bool {
        if self != Self::Cpu {
            device::expect(self.place());
        }
        self != Self::Cpu
    }

    /// Binds the bidirectional transformer's weights.
    ///
    /// # Errors
    /// If the weights do not fit the shape.
    pub fn whole_clips(self, shape: &DitShape, weights: &Weights) -> Result<Box<dyn WholeClips>, WeightsError> {
        if !self.graph() {
            return Ok(Box::new(FastTeacher::new(shape, weights)?));
        }
        Ok(Box::new(Dit::new(shape, weights)?))
    }

    /// Computes loss and gradient of flow matching over whole clips.
    #[must_use]
    pub fn bidirectional(
        self,
        shape: &DitShape,
        weights: &Weights,
        batch: &ClipBatch,
        plan: &BidirectionalPlan,
    ) -> Step {
        if self.graph() {
            return step::bidirectional_in(device::training_precision(), shape, weights, batch, plan);
        }
        train::bidirectional(shape, weights, batch, plan)
    }

    /// Computes loss and gradient of a causal step.
    #[must_use]
    pub fn causal(self, shape: &DitShape, weights: &Weights, batch: &ClipBatch, plan: &CausalPlan) -> Step {
        if self.graph() {
            return step::causal_in(device::training_precision(), shape, weights, batch, plan);
        }
        train::causal(shape, weights, batch, plan)
    }

    /// Computes loss and gradient of the autoencoder.
    #[must_use]
    pub fn reconstruction(self, shape: &AeShape, weights: &Weights, batch: &AeBatch) -> Step {
        let compute = if self.graph() { step::autoencoder } else { train::autoencoder };
        compute(shape, weights, batch)
    }

    /// Computes loss and gradient of the guided decoder.
    #[must_use]
    pub fn decoding(self, shape: &AeShape, weights: &Weights, batch: &DecoderBatch) -> Step {
        let compute = if self.graph() { step::decoder } else { train::decoder };
        compute(shape, weights, batch)
    }

    /// Computes the guided decoder's step against a discriminator, and the discriminator's against it.
    #[must_use]
    pub fn adversarial(
        self,
        shape: &AeShape,
        weights: &Weights,
        batch: &DecoderBatch,
        against: &Adversary<'_>,
    ) -> [Step; 2] {
        let compute = if self.graph() { step::adversarial } else { train::adversarial };
        compute(shape, weights, batch, against)
    }
}
