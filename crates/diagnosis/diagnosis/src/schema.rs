//! The diagnosis as written to `diagnosis.json`; field by field the schema of the specification, section 4.
//!
//! One rule for what is not there: a field that was not determined is absent, a list that was made and is empty is
//! written empty. JSON has no number for what is not finite (the far end of a limit's interval, seconds needed where no
//! manoeuvre helps): such a value is written as `null` and read back as NaN.

use std::collections::BTreeMap;
use std::path::Path;

use ds_effect::{Effect, Law, Verdict, library};
use ds_stats::{explained_elsewhere, false_discovery};
use serde::{Deserialize, Serialize};

use crate::error::CaseError;
use crate::modulation::Modulation;
use crate::saved::Saved;
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
    /// What each of several accepted effects contributes; absent where there are not several, or it was not asked.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub shares: Vec<EffectShare>,
    /// What policies attend to on the frames of a case, where any were asked.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub attended: Vec<crate::attended::Attended>,
    /// Share explained that the fit drives promise for `position_2s` (frames: `image_rmse`); absent where these show no
    /// gap beyond the floor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub predicted_share: Option<f64>,
    /// What remains, where the verdict is unknown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unknown_description: Option<Remainder>,
    /// Of which kind the unknown is, where the verdict is unknown and that was looked at.
    #[serde(default, flatten, skip_serializing_if = "Option::is_none")]
    pub unknown: Option<Unknown>,
    /// A law outside the library, where one was looked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub discovery: Option<crate::discovery::Discovery>,
    /// Manoeuvres that would tell the best hypotheses apart.
    pub next_manoeuvre: Vec<Manoeuvre>,
    /// The simulator with the effects added.
    pub corrected_model: Corrected,
    /// Where the floor comes from: `practice` (effect-free practice cases) or `self`.
    pub floor_source: String,
    /// What looked odd in the input.
    pub warnings: Vec<String>,
    /// Share of the windows in which the car does something far from all that the healthy drives of a baseline had; absent
    /// without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub outside_domain_share: Option<f64>,
    /// From which size on each effect could have been seen in these data, where that was asked (streams of frames that
    /// do not agree pixel by pixel).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub detection_limits: Vec<DetectionLimit>,
    /// Rollouts of a simulator of somebody else, where one was the nominal one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rollouts: Option<usize>,
    /// Effects that such a simulator has neither a parameter nor a port for, those that a drive command computed from the
    /// speed cannot show, and those of other drivers where nobody follows.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub not_testable: Vec<String>,
    /// When the accepted effect that changes most acts; absent where none is accepted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub modulation: Option<Modulation>,
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
            attended: Vec::new(),
            predicted_share: None,
            unknown_description: None,
            unknown: None,
            discovery: None,
            next_manoeuvre: Vec::new(),
            corrected_model: Corrected::default(),
            floor_source: "practice".to_owned(),
            warnings: Vec::new(),
            outside_domain_share: None,
            detection_limits: Vec::new(),
            rollouts: None,
            not_testable: Vec::new(),
            modulation: None,
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
    /// Predictive log score gained on data left out of the fit; absent where none was left out for this effect.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub heldout_gain: Option<f64>,
    /// Log evidence over the nuisance fit.
    #[serde(deserialize_with = "null::number")]
    pub evidence_gain: f64,
    /// All parameters by name, in reported units.
    #[serde(deserialize_with = "null::table")]
    pub params: BTreeMap<String, f64>,
}

/// Returns the group of the first effect, of which its data cannot tell it apart, where there is one.
#[must_use]
pub fn group_of_first(effects: &[Finding]) -> Vec<Vec<String>> {
    effects.iter().take(1).filter(|effect| effect.group.len() > 1).map(|effect| effect.group.clone()).collect()
}

/// From which size on an effect could have been seen.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DetectionLimit {
    /// Its id.
    pub id: String,
    /// Its least value that would have been found; absent: not testable with this generator.
    #[serde(default, skip_serializing_if = "Option::is_none")]
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
    /// False-discovery controlled p-value; absent where nothing was tested.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub q_value: Option<f64>,
    /// Time spans, s.
    pub t: Vec<[f64; 2]>,
}

/// Turns the p-values of cells, some of `tested` that were looked at, into q-values.
pub fn correct(cells: &mut [Cell], tested: usize) {
    let p_values: Vec<f64> = cells.iter().map(|cell| cell.q_value.unwrap_or(1.0)).collect();
    cells.iter_mut().zip(false_discovery(&p_values, tested)).for_each(|(cell, q)| cell.q_value = Some(q));
}

/// Where in the data a cell lies; an absent bin means all.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
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

/// A metric in three states: the nominal simulator, the one with the ordinary mismatch fitted, and the one with the
/// effects added as well.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Shrink {
    /// Its name.
    pub metric: String,
    /// Root mean square of the nominal simulator.
    #[serde(deserialize_with = "null::number")]
    pub before: f64,
    /// Root mean square with the ordinary mismatch fitted and no effect added; absent in files of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nuisance: Option<f64>,
    /// Root mean square of the corrected simulator.
    #[serde(deserialize_with = "null::number")]
    pub after: f64,
    /// What an effect-free world leaves.
    #[serde(deserialize_with = "null::number")]
    pub floor: f64,
    /// What the ordinary mismatch alone explains: 1 - (nuisance - floor) / (before - floor); absent where before is not
    /// two standard errors above the floor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub share_nuisance: Option<f64>,
    /// What the effects explain of the rest: 1 - (after - floor) / (nuisance - floor), 0 without effects; absent where
    /// nuisance is not two standard errors above the floor. In files of earlier versions, which have no `nuisance`, it
    /// stands for before in the formula.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub share_explained: Option<f64>,
    /// 90 % interval of `share_explained`.
    #[serde(default, deserialize_with = "null::known_pair", skip_serializing_if = "Option::is_none")]
    pub interval90: Option<[f64; 2]>,
    /// What the effects save in the metric's unit; absent where none was added, and where it was not measured by drives.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub saved: Option<Saved>,
    /// heldout, crossfit (every drive by a fit without it), fit or unseen.
    pub data: String,
}

impl Shrink {
    /// Measures a metric: `all` is (nominal, ordinary mismatch, corrected, floor) of all data, `drawn` the same of each
    /// resample.
    #[must_use]
    pub fn new(metric: &str, all: [f64; 4], drawn: &[[f64; 4]], data: &str) -> Self {
        Self::elsewhere(metric, all, [drawn, drawn], data)
    }

    /// Measures a metric with an interval for data still to come: resamples of the data at hand, and such as those may be.
    #[must_use]
    pub fn elsewhere(metric: &str, all: [f64; 4], drawn: [&[[f64; 4]]; 2], data: &str) -> Self {
        let step = |from: usize, to: usize| {
            let [here, elsewhere] = drawn.map(|d| d.iter().map(|d| [d[from], d[to], d[3]]).collect::<Vec<_>>());
            explained_elsewhere([all[from], all[to], all[3]], &here, &elsewhere)
        };
        let effects = step(1, 2);
        let [before, nuisance, after, floor] = all;
        Self {
            metric: metric.to_owned(),
            before,
            nuisance: Some(nuisance),
            after,
            floor,
            share_nuisance: step(0, 1).map(|found| found.share),
            share_explained: effects.map(|found| found.share),
            interval90: effects.map(|found| found.interval90),
            saved: None,
            data: data.to_owned(),
        }
    }
}

/// Of which kind the unknown is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Unknown {
    /// `structure`: no vehicle of any family has such a remainder by nature; `needs_baseline`: healthy drives of this
    /// vehicle must say what is usual for it.
    pub unknown_kind: String,
    /// Part of `p_unknown` for an ordinary trait of a vehicle of another family.
    pub p_ordinary: f64,
    /// Part of `p_unknown` for structure.
    pub p_structure: f64,
}

impl Unknown {
    /// The kind of a remainder that is a trait or a fault, which only healthy drives could tell.
    pub const NEEDS_BASELINE: &str = "needs_baseline";
    /// The kind of a remainder that no vehicle has by nature.
    pub const STRUCTURE: &str = "structure";

    /// Splits the probability of something unknown by the share that is structure.
    #[must_use]
    pub fn new(p_unknown: f64, share: f64) -> Self {
        let kind = if share > 0.5 { Self::STRUCTURE } else { Self::NEEDS_BASELINE };
        let p_structure = p_unknown * share;
        Self { unknown_kind: kind.to_owned(), p_ordinary: p_unknown - p_structure, p_structure }
    }
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
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frequency_hz: Option<f64>,
    /// Commanded or measured quantity whose size goes with the remainder, and the correlation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
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
    /// Laws that no effect of the library is, by their text; with them the effects are not added, which they replace.
    #[serde(default, deserialize_with = "crate::discovery::laws", skip_serializing_if = "Vec::is_empty")]
    pub laws: Vec<String>,
    /// Every other parameter at its estimate, in reported units; several parameters of one effect are numbered.
    #[serde(deserialize_with = "null::table")]
    pub nuisance: BTreeMap<String, f64>,
    /// The same parameters where the ordinary mismatch is fitted alone, which is the state `nuisance` of `how_far`; absent
    /// where no effect is added, and where `nuisance` is that of both.
    #[serde(default, deserialize_with = "null::table", skip_serializing_if = "BTreeMap::is_empty")]
    pub ordinary: BTreeMap<String, f64>,
}

/// Effects with a value for each of their parameters, in reported units.
pub type Lines = Vec<(String, Vec<f64>)>;

impl Corrected {
    /// Returns the effects that were added.
    #[must_use]
    pub fn added(&self) -> Lines {
        self.effects.iter().map(|effect| (effect.id.clone(), effect.values.clone())).collect()
    }

    /// Returns the laws that were added.
    #[must_use]
    pub fn obeyed(&self) -> Vec<Law> {
        self.laws.iter().filter_map(|text| Law::parse(text).ok()).collect()
    }

    /// Returns the ordinary mismatch of the corrected simulator, without the effects added; what it does not name is neutral.
    #[must_use]
    pub fn mismatch(&self) -> Lines {
        lines(&self.nuisance)
    }

    /// Returns the ordinary mismatch fitted alone.
    #[must_use]
    pub fn mismatch_alone(&self) -> Lines {
        if self.ordinary.is_empty() { self.mismatch() } else { lines(&self.ordinary) }
    }
}

/// Reads parameters by name, `id` or `id.2` or `id.parameter`, as effects of the library; other names are left out.
fn lines(table: &BTreeMap<String, f64>) -> Lines {
    let of = |effect: &&'static Effect| {
        let mut values = effect.neutral();
        let mut named = false;
        for (place, (value, parameter)) in values.iter_mut().zip(effect.parameters).enumerate() {
            let first = if place == 0 { effect.id.to_owned() } else { format!("{}.{}", effect.id, place + 1) };
            let found = table.get(&first).or_else(|| table.get(&format!("{}.{}", effect.id, parameter.name)));
            if let Some(found) = found {
                (*value, named) = (*found, true);
            }
        }
        named.then(|| (effect.id.to_owned(), values))
    };
    library().iter().filter_map(of).collect()
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
