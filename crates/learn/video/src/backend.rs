//! Which body computes the networks: loops of this project (`ds_kernel`) or the framework's graph (`ds_graph`).
//!
//! [`Backend`] is the name in settings and the one place that knows both bodies; whoever uses a network holds it behind
//! the traits of [`ds_nn::body`]. Both bodies give the same numbers up to rounding; `tests/bodies.rs` and
//! `tests/steps.rs` hold that.

mod training;

use ds_graph::device::{self, DeviceError, Place};
use ds_graph::dit::Dit;
use ds_graph::tiny_ae::TinyAe;
use ds_kernel::{FastAe, FastDit};
use ds_nn::array::{Weights, WeightsError};
use ds_nn::body::{Autoencoder, Transformer};
use ds_nn::dit::DitShape;
use ds_nn::tiny_ae::AeShape;
use serde::{Deserialize, Serialize};

pub use training::WholeClips;

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

    /// Returns where the framework's tensors lie.
    fn place(self) -> Place {
        match self {
            Self::Cpu | Self::Framework => Place::Processor,
            Self::Vulkan => Place::Vulkan,
            Self::Cuda => Place::Cuda,
        }
    }

    /// Makes sure that the device is there and makes it the one of this process; graphics processors need this before
    /// anything is bound. Returns what the device is.
    ///
    /// # Errors
    /// If this build lacks the back end, this machine the device, or another is in use.
    pub fn ready(self) -> Result<String, DeviceError> {
        let device = device::choose(self.place())?;
        Ok(match self {
            Self::Cpu => "processor, own path".to_owned(),
            Self::Framework => "processor, framework".to_owned(),
            Self::Vulkan | Self::Cuda => device,
        })
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
                device::expect(self.place());
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
                device::expect(self.place());
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_paths_of_the_processor_are_always_there() {
        for backend in [Backend::Cpu, Backend::Framework] {
            assert!(backend.ready().expect("a processor").starts_with("processor"));
        }
    }
}
