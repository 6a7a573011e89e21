//! How near simulated frames are to real ones for a policy: what it attends to on either, scene by scene and place by place.
//!
//! Differences are |φ − φ̃|² / Tr Σ, φ and φ̃ being what the policy attends to on the real and on the simulated frame of one
//! state and Σ the covariance of φ over all real frames of the case: 1 is as far apart as two such frames are on average,
//! but for a factor of 2. Averaged over frames it is an upper bound of FDπ in the same unit.

use serde::{Deserialize, Serialize};

/// What the name of a policy's metric of `how_far` begins with; the policy's own name follows.
pub const METRIC: &str = "policy_distance.";

/// What one policy attends to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Attended {
    /// The policy.
    pub policy: String,
    /// Each pair of streams, farthest first.
    pub scenes: Vec<Difference>,
    /// Rows and columns of the places, where what it attends to are places.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub grid: Option<[usize; 2]>,
    /// Whether they are places of the ground before the car, the farthest row first, and not of the picture.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub ground: bool,
    /// Each place row by row, or each token of a list, over the variance of a place, the mean of all.
    pub places: Vec<Difference>,
}

/// A difference as the simulator is, and with the effects of the diagnosis added.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Difference {
    /// The scene; absent of a place.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scene: Option<String>,
    /// As it is.
    pub before: f64,
    /// With the effects added.
    pub after: f64,
}
