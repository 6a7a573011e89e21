//! Why features cannot be compared.

use ds_stats::SampleError;

/// Says why features of a policy cannot be compared.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum FidelityError {
    /// The features of a set have no distribution.
    #[error("features of {policy:?} on {set:?} cannot be compared")]
    Sample {
        /// The policy, or another network.
        policy: String,
        /// The set of frames.
        set: String,
        /// Why.
        #[source]
        source: SampleError,
    },
    /// The features are the same for every frame, so that no distance has a unit.
    #[error(
        "features of {policy:?} are constant over the real frames; a policy of several frames sees the same one as often, which \
         has no motion"
    )]
    Constant {
        /// The policy.
        policy: String,
    },
    /// Two sets do not hold the same frames.
    #[error("{policy:?}: {set:?} has {found} frames of scenario {scenario}, the real set has {expected}")]
    Unpaired {
        /// The policy.
        policy: String,
        /// The set of frames.
        set: String,
        /// Number of the scenario; one past the last where one set has more scenarios.
        scenario: usize,
        /// Frames in the real set.
        expected: usize,
        /// Frames in the other.
        found: usize,
    },
}
