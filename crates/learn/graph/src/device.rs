//! The device on which a process computes, chosen once from its configuration before any network is bound.
//!
//! The processor is always there; Vulkan and CUDA exist where the crate's features of these names are on. Choosing
//! probes the device, so that a machine without one is told so in words; nothing falls back silently. Weights of
//! large layers may be kept in bf16 while all else stays f32.

use std::sync::OnceLock;

use burn::tensor::Device;

/// Where tensors lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// The processor.
    Processor,
    /// A graphics processor through Vulkan.
    Vulkan,
    /// A graphics processor of NVIDIA through CUDA.
    Cuda,
}

impl Place {
    /// Returns the name in settings and errors.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Processor => "processor",
            Self::Vulkan => "vulkan",
            Self::Cuda => "cuda",
        }
    }

    fn device(self) -> Device {
        match self {
            Self::Processor => Device::flex(),
            #[cfg(feature = "vulkan")]
            Self::Vulkan => Device::vulkan(burn::tensor::DeviceKind::DefaultDevice),
            #[cfg(feature = "cuda")]
            Self::Cuda => Device::cuda(0),
            #[cfg(not(all(feature = "vulkan", feature = "cuda")))]
            #[allow(unreachable_patterns, reason = "which arms remain depends on the features")]
            other => unreachable!("{other:?} is refused by its probe in this build"),
        }
    }
}

/// Number format of the weights of large layers; norms, modulation, time and all sums stay f32.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Precision {
    /// 32 bits.
    #[default]
    F32,
    /// 16 bits with the exponent range of f32.
    Bf16,
}

/// Says why a device is refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DeviceError {
    /// The build lacks it.
    #[error("this build has no back end {:?}, build it with --features {}", place.name(), place.name())]
    NotBuilt {
        /// The place.
        place: Place,
    },
    /// The machine lacks it.
    #[error("no device for back end {:?}: {reason}", place.name())]
    Absent {
        /// The place.
        place: Place,
        /// What was looked for.
        reason: String,
    },
    /// Another is in use.
    #[error("back end {:?} was asked for after this process began to compute elsewhere", place.name())]
    TooLate {
        /// The place.
        place: Place,
    },
}

static CHOSEN: OnceLock<Place> = OnceLock::new();

/// Chooses the device of this process; the same choice twice is fine. Returns what the device is.
///
/// # Errors
/// If this build lacks the place, this machine the device, or another is in use.
pub fn choose(place: Place) -> Result<String, DeviceError> {
    let what = match place {
        Place::Processor => place.name().to_owned(),
        Place::Vulkan => probe_vulkan()?,
        Place::Cuda => probe_cuda()?,
    };
    if *CHOSEN.get_or_init(|| place) == place { Ok(what) } else { Err(DeviceError::TooLate { place }) }
}

/// Makes sure that a place is the one in use.
///
/// # Panics
/// If a graphics processor was not chosen before.
pub fn expect(place: Place) {
    let ready = *CHOSEN.get_or_init(|| Place::Processor) == place;
    assert!(ready, "Backend::ready was not called for {:?}", place.name());
}

/// Returns the device in use; the processor if none was chosen.
pub(crate) fn current() -> Device {
    CHOSEN.get_or_init(|| Place::Processor).device()
}

/// Returns what large layers of training steps are computed in: bf16 on a graphics processor that has units for it, f32 elsewhere.
#[must_use]
pub fn training_precision() -> Precision {
    let place = *CHOSEN.get_or_init(|| Place::Processor);
    if place != Place::Processor && Bf16::of_device().multiplied { Precision::Bf16 } else { Precision::F32 }
}

/// Returns what convolutions are computed in that should be in a format: a device that only multiplies bf16, as most do through
/// Vulkan, computes them in f32.
pub(crate) fn convolution_precision(wanted: Precision) -> Precision {
    let place = *CHOSEN.get_or_init(|| Place::Processor);
    if place == Place::Processor || Bf16::of_device().added { wanted } else { Precision::F32 }
}

/// What a graphics processor does with bf16.
#[derive(Default)]
struct Bf16 {
    multiplied: bool,
    added: bool,
}

impl Bf16 {
    #[cfg(any(feature = "vulkan", feature = "cuda"))]
    fn of_device() -> Self {
        use burn::backend::{Backend, DTypeUsage, Dispatch};

        let usage = Dispatch::dtype_usage(current().as_dispatch(), burn::tensor::DType::BF16);
        let stored = usage.contains(DTypeUsage::Storage);
        Self {
            multiplied: stored && usage.contains(DTypeUsage::Accelerated),
            added: stored && usage.contains(DTypeUsage::Arithmetic),
        }
    }

    #[cfg(not(any(feature = "vulkan", feature = "cuda")))]
    fn of_device() -> Self {
        Self::default()
    }
}

/// Waits until the device has done all that was asked of it.
///
/// # Errors
/// If the device reports a fault, in its own words.
pub fn wait() -> Result<(), String> {
    current().sync().map_err(|fault| format!("{fault:?}"))
}

/// Returns the bytes in use and reserved on the device, where it tells.
#[must_use]
pub fn memory() -> Option<(u64, u64)> {
    let usage = current().memory_pool_usage()?;
    Some((usage.bytes_in_use, usage.bytes_reserved))
}

#[cfg(not(feature = "vulkan"))]
fn probe_vulkan() -> Result<String, DeviceError> {
    Err(DeviceError::NotBuilt { place: Place::Vulkan })
}

#[cfg(feature = "vulkan")]
fn probe_vulkan() -> Result<String, DeviceError> {
    let found = burn::tensor::Device::enumerate(burn::tensor::DeviceType::Vulkan).into_vec();
    let first = found.first().ok_or_else(|| DeviceError::Absent {
        place: Place::Vulkan,
        reason: "the Vulkan loader lists no adapter".to_owned(),
    })?;
    Ok(first.identity().map_or_else(|| "vulkan".to_owned(), |identity| format!("vulkan: {}", identity.name)))
}

#[cfg(not(feature = "cuda"))]
fn probe_cuda() -> Result<String, DeviceError> {
    Err(DeviceError::NotBuilt { place: Place::Cuda })
}

#[cfg(feature = "cuda")]
fn probe_cuda() -> Result<String, DeviceError> {
    // Without the driver the framework panics in a thread of its own, so its files are looked for first.
    let absent = |reason: &str| Err(DeviceError::Absent { place: Place::Cuda, reason: reason.to_owned() });
    if !std::path::Path::new("/proc/driver/nvidia/version").exists() {
        return absent("/proc/driver/nvidia/version is absent: no NVIDIA driver is loaded");
    }
    let found = burn::tensor::Device::enumerate(burn::tensor::DeviceType::Cuda).into_vec();
    let Some(first) = found.first() else { return absent("the CUDA driver lists no device") };
    Ok(first.identity().map_or_else(|| "cuda".to_owned(), |identity| format!("cuda: {}", identity.name)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(not(feature = "cuda"))]
    fn a_build_without_cuda_says_how_to_get_it() {
        let error = choose(Place::Cuda).expect_err("not built");
        assert_eq!(error.to_string(), "this build has no back end \"cuda\", build it with --features cuda");
    }

    #[test]
    #[cfg(not(feature = "vulkan"))]
    fn a_build_without_vulkan_says_how_to_get_it() {
        let error = choose(Place::Vulkan).expect_err("not built");
        assert_eq!(error.to_string(), "this build has no back end \"vulkan\", build it with --features vulkan");
    }
}
