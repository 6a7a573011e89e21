//! The diagnosis as written to `diagnosis.json`; field by field the schema of the specification, section 4.
//!
//! JSON has no number for what is not finite (the far end of a limit's interval, seconds needed where no manoeuvre helps):
//! such a value is written as `null` and read back as NaN.

use std::collections::BTreeMap;
use std::path::Path;

use ds_effect::Verdict;
use serde::{Deserialize, Serialize};

use crate::error::CaseError;
use crate::{json, null, verdict};

/// The file in the folder of a diagnosis.
pub const FILE: &str = "diagnosis.json";
/// Version of the schema.
pub const SCHEMA: u32 = 1;

/// A diagnosis.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Diagnosis {
    /// Version of this schema.
    pub schema_version: u32,
    /// Name of the case.
    pub case: String,
    /// What was found.
    #[serde(with = "verdict")]
    pub verdict: Verdict,
    /// Every effect considered, likeliest first; sums with `p_none` and `p_unknown` to 1.
    pub effects: Vec<Finding>,
    /// Probability that nothing is missing.
    #[serde(deserialize_with = "null::number")]
    pub p_none: f64,
    /// Probability that what is missing is not in the library.
    #[serde(deserialize_with = "null::number")]
    pub p_unknown: f64,
    /// Effects of the corrected model.
    pub chosen: Vec<String>,
    /// Sets of effects that these data cannot tell apart.
    pub indistinguishable: Vec<Vec<String>>,
    /// Cells in which the gap is beyond the floor.
    #[serde(rename = "where")]
    pub cells: Vec<Cell>,
    /// Gap before and after on data not used for the fit.
    pub how_far: Vec<Shrink>,
    /// What each of several accepted effects contributes.
    #[serde(default)]
    pub shares: Vec<EffectShare>,
    /// Share explained that the fit drives promise for `position_2s`.
    #[serde(deserialize_with = "null::number")]
    pub predicted_share: f64,
    /// What remains, where the verdict is unknown.
    pub unknown_description: Option<Remainder>,
    /// Manoeuvres that would tell the best hypotheses apart.
    pub next_manoeuvre: Vec<Manoeuvre>,
    /// The simulator with the effects added.
    pub corrected_model: Corrected,
    /// Where the floor comes from: `practice` (effect-free practice cases) or `self`.
    pub floor_source: String,
    /// What looked odd in the input.
    pub warnings: Vec<String>,
    /// From which size on each effect could have been seen in these data, where that was asked (streams of frames that
    /// do not agree pixel by pixel).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub detection_limits: Vec<DetectionLimit>,
    /// Time spent, s.
    #[serde(deserialize_with = "null::number")]
    pub secs: f64,
}

impl Diagnosis {
    /// Reads `diagnosis.json` of a folder.
    ///
    /// # Errors
    /// If the file cannot be read or is no diagnosis.
    pub fn read(folder: &Path) -> Result<Self, CaseError> {
        json::read(&folder.join(FILE))
    }

    /// Writes `diagnosis.json` into a folder, which is made where it is not there.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), CaseError> {
        json::write(self, &folder.join(FILE))
    }

    /// Returns the diagnosis of a case in which nothing was found, to be filled in.
    #[must_use]
    pub fn blank(case: &str) -> Self {
        Self {
            schema_version: SCHEMA,
            case: case.to_owned(),
            verdict: Verdict::None,
            effects: Vec::new(),
            p_none: 1.0,
            p_unknown: 0.0,
            chosen: Vec::new(),
            indistinguishable: Vec::new(),
            cells: Vec::new(),
            how_far: Vec::new(),
            shares: Vec::new(),
            predicted_share: 0.0,
            unknown_description: None,
            next_manoeuvre: Vec::new(),
            corrected_model: Corrected::default(),
            floor_source: "practice".to_owned(),
            warnings: Vec::new(),
            detection_limits: Vec::new(),
            secs: 0.0,
        }
    }
}

/// One effect.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Finding {
    /// Its id.
    pub id: String,
    /// Its probability.
    #[serde(deserialize_with = "null::number")]
    pub probability: f64,
    /// Its estimate.
    #[serde(deserialize_with = "null::number")]
    pub value: f64,
    /// Unit of the estimate.
    pub unit: String,
    /// 90 % interval of the estimate.
    #[serde(deserialize_with = "null::pair")]
    pub interval90: [f64; 2],
    /// Effects that these data cannot tell from it, itself included.
    pub group: Vec<String>,
    /// Predictive log score gained on drives left out.
    #[serde(deserialize_with = "null::number")]
    pub heldout_gain: f64,
    /// Log evidence over the nuisance fit.
    #[serde(deserialize_with = "null::number")]
    pub evidence_gain: f64,
    /// All parameters by name, in reported units.
    #[serde(deserialize_with = "null::table")]
    pub params: BTreeMap<String, f64>,
}

/// From which size on an effect could have been seen.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DetectionLimit {
    /// Its id.
    pub id: String,
    /// Its least value that would have been found; absent: not testable with this generator.
    pub limit: Option<f64>,
    /// Unit of the value.
    pub unit: String,
}

/// What one of several effects contributes to the shrink.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct EffectShare {
    /// Its id.
    pub id: String,
    /// Shapley value: its part of the explained share of `position_2s`.
    #[serde(deserialize_with = "null::number")]
    pub share: f64,
    /// 90 % interval.
    #[serde(deserialize_with = "null::pair")]
    pub interval90: [f64; 2],
}

/// One cell of the map of the gap.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Cell {
    /// Channel.
    pub channel: String,
    /// Drive and bins.
    pub regime: Regime,
    /// Root mean square in floor units.
    #[serde(deserialize_with = "null::number")]
    pub effect_size: f64,
    /// False-discovery controlled p-value.
    #[serde(deserialize_with = "null::number")]
    pub q_value: f64,
    /// Time spans, s.
    pub t: Vec<[f64; 2]>,
}

/// Where in the data a cell lies; an absent bin means all.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Regime {
    /// Drive.
    pub drive: usize,
    /// Speed tercile: low, mid, high.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub speed: Option<String>,
    /// Size of lateral acceleration: straight, curve, hard.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lateral: Option<String>,
    /// traction, coast, brake.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pedal: Option<String>,
    /// Steering rate: still, slow, fast.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub steering: Option<String>,
    /// Row and column of the image tile, 4 x 6 of them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tile: Option<[usize; 2]>,
    /// Distance of what is seen: near, middle, far.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distance: Option<String>,
    /// Class of the object seen.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub class: Option<String>,
    /// Name of the agent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub agent: Option<String>,
    /// Place as a tile of the map, 50 m wide, east and north.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place: Option<[i64; 2]>,
}

/// A metric before and after.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Shrink {
    /// Its name.
    pub metric: String,
    /// Root mean square of the nominal simulator.
    #[serde(deserialize_with = "null::number")]
    pub before: f64,
    /// Root mean square of the corrected simulator.
    #[serde(deserialize_with = "null::number")]
    pub after: f64,
    /// What an effect-free world leaves.
    #[serde(deserialize_with = "null::number")]
    pub floor: f64,
    /// 1 - (after - floor) / (before - floor); 0 where before is not above the floor.
    #[serde(deserialize_with = "null::number")]
    pub share_explained: f64,
    /// 90 % interval of the share.
    #[serde(deserialize_with = "null::pair")]
    pub interval90: [f64; 2],
    /// heldout, fit or unseen.
    pub data: String,
}

/// What no library effect explains.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Remainder {
    /// Channels beyond the clean level and by what factor.
    #[serde(deserialize_with = "null::table")]
    pub channels: BTreeMap<String, f64>,
    /// Drives concerned.
    pub drives: Vec<usize>,
    /// constant, burst or periodic.
    pub time_pattern: String,
    /// Frequency of the strongest line in the residual of the worst channel, Hz.
    pub frequency_hz: Option<f64>,
    /// Commanded or measured quantity whose size goes with the remainder, and the correlation.
    pub goes_with: Option<(String, f64)>,
    /// Library effects that explain most of it.
    pub nearest: Vec<String>,
    /// One sentence.
    pub text: String,
}

/// A manoeuvre to drive next.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Manoeuvre {
    /// Its name.
    pub name: String,
    /// The hypotheses it separates.
    pub separates: [String; 2],
    /// Expected log Bayes factor of one run.
    #[serde(deserialize_with = "null::number")]
    pub expected_log_bayes_factor: f64,
    /// Seconds of it for a log Bayes factor of 5.
    #[serde(deserialize_with = "null::number")]
    pub secs_needed: f64,
}

/// The corrected simulator.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Corrected {
    /// Effects with their estimates over the neutral value.
    pub effects: Vec<CorrectedEffect>,
    /// Every other parameter at its estimate, in reported units; several parameters of one effect are numbered.
    #[serde(deserialize_with = "null::table")]
    pub nuisance: BTreeMap<String, f64>,
}

/// An effect of the corrected simulator.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct CorrectedEffect {
    /// Its id.
    pub id: String,
    /// Its whole value in the simulator, usual mismatch included.
    #[serde(deserialize_with = "null::number")]
    pub value: f64,
    /// All its parameters, in order.
    #[serde(deserialize_with = "null::list")]
    pub values: Vec<f64>,
}
