//! When an accepted effect acts, as written to `diagnosis.json`: always, from an instant on, until one, or ever more.

use serde::{Deserialize, Serialize};

use crate::null;

/// The effect is of one size throughout.
pub const CONSTANT: &str = "constant";
/// The effect begins at an instant.
pub const ONSET: &str = "onset";
/// The effect ends at an instant.
pub const OFFSET: &str = "offset";
/// The effect grows from an instant to the end of a drive.
pub const RAMP: &str = "ramp";

/// How the size of an effect changes in time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Modulation {
    /// Id of the effect.
    pub effect: String,
    /// constant, onset, offset or ramp.
    pub kind: String,
    /// Log evidence of that kind over a constant effect; of a constant one, how far the best other kind is behind.
    #[serde(deserialize_with = "null::number")]
    pub evidence: f64,
    /// When it begins to change, s, by the stamps of its drive; absent where it does not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub onset_s: Option<f64>,
    /// Ends of the 90 % set of that instant, s.
    #[serde(default, deserialize_with = "null::known_pair", skip_serializing_if = "Option::is_none")]
    pub interval90: Option<[f64; 2]>,
    /// The drive in which it changes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drive: Option<usize>,
    /// How the other drives go on: `later` (those after it stay changed), `drive` (the effect acts in this one alone),
    /// `each` (the same at the same time since the start of each).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scope: Option<String>,
    /// Estimate while the effect acts, in the unit of its finding.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value: Option<f64>,
    /// Size of the effect in each drive of the fit, as a share of its estimate over all.
    #[serde(default)]
    pub sessions: Vec<Session>,
}

/// The size of an effect in one drive.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Session {
    /// The drive.
    pub drive: usize,
    /// Size as a share of the estimate over all drives.
    #[serde(deserialize_with = "null::number")]
    pub size: f64,
    /// Its standard error.
    #[serde(deserialize_with = "null::number")]
    pub error: f64,
}
