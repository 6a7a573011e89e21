//! The processor's vectors: the widest set that it has, found once.

use pulp::{Simd, WithSimd};

/// A set of vector instructions.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Arch {
    /// None that is known.
    Scalar,
    /// 256 bits and fused multiply-add.
    #[cfg(target_arch = "x86_64")]
    V3(pulp::x86::V3),
    /// 512 bits.
    #[cfg(target_arch = "x86_64")]
    V4(pulp::x86::V4),
    /// 128 bits.
    #[cfg(target_arch = "aarch64")]
    Neon(pulp::aarch64::Neon),
}

impl Arch {
    /// Returns the widest set of this processor.
    pub(crate) fn new() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            if let Some(simd) = pulp::x86::V4::try_new() {
                return Self::V4(simd);
            }
            if let Some(simd) = pulp::x86::V3::try_new() {
                return Self::V3(simd);
            }
        }
        #[cfg(target_arch = "aarch64")]
        if let Some(simd) = pulp::aarch64::Neon::try_new() {
            return Self::Neon(simd);
        }
        Self::Scalar
    }

    /// Runs an operation compiled for the set.
    pub(crate) fn dispatch<O: WithSimd>(self, op: O) -> O::Output {
        match self {
            Self::Scalar => pulp::Scalar.vectorize(op),
            #[cfg(target_arch = "x86_64")]
            Self::V3(simd) => Simd::vectorize(simd, op),
            #[cfg(target_arch = "x86_64")]
            Self::V4(simd) => Simd::vectorize(simd, op),
            #[cfg(target_arch = "aarch64")]
            Self::Neon(simd) => Simd::vectorize(simd, op),
        }
    }
}
