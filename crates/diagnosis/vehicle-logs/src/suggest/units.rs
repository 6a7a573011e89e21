//! Units that no header says, by what must hold in any vehicle: speed is the change of position, forward acceleration that
//! of speed, yaw rate that of heading, side acceleration speed times yaw rate, and the path leads where the heading points.
//!
//! In each relation the logarithms of units and values add up to nil. The units with the least sum of squares are right where
//! all others are worse by more than [`MARGIN`]; what is not so is said to be undecided.

use super::Draft;
use crate::channel::find;
use crate::check::{leads_astray, moving_ratio};
use crate::record::Record;
use crate::resample::slope;
use ds_diagnosis::relation::relate;
use ds_diagnosis::table::STEP_SECS;

/// Least correlation with which two series tell of the same motion.
const CLEAR: f64 = 0.7;
/// How much worse other units must be: a factor of 1.5 in one relation.
const MARGIN: f64 = 0.16;
/// Cost of a value that no road vehicle has.
const ABSURD: f64 = 0.3;
/// Cost of a heading that the path does not follow.
const ASTRAY: f64 = 2.0;
/// Largest turn of a road vehicle, rad/s.
const FASTEST_TURN: f64 = 2.0;
/// Factor from which two series do not fit in any unit.
const FAR: f64 = 1.6;
/// Channels whose unit can be told, the units that logs have them in, the usual one first, and the largest value in SI.
const OPEN: [(&str, &[&str], f64); 6] = [
    ("v", &["m/s", "km/h", "mph"], 70.0),
    ("v_wheel", &["m/s", "km/h", "mph"], 70.0),
    ("yaw_rate", &["rad/s", "deg/s"], FASTEST_TURN),
    ("ax", &["m/s2", "g"], 15.0),
    ("ay", &["m/s2", "g"], 15.0),
    ("cmd_accel", &["m/s2", "g"], 15.0),
];

/// A relation: the logarithm that must be nil, with the channels whose units count in it.
struct Tie {
    words: &'static str,
    log: f64,
    of: Vec<(&'static str, f64)>,
}

/// Units of all open channels, by their places in [`OPEN`] (the first where it is not open), and a reading of the heading.
struct Tried {
    cost: f64,
    heading: usize,
    units: [usize; OPEN.len()],
}

impl Tried {
    /// Returns the logarithm of the factor to SI of a channel's unit.
    fn log(&self, name: &str) -> f64 {
        let row = OPEN.iter().zip(&self.units).find(|(row, _)| row.0 == name);
        let factor = row.and_then(|(row, unit)| find(name)?.quantity.factor(row.1[*unit]));
        factor.map_or(0.0, f64::ln)
    }

    /// Returns what is left of a relation.
    fn left(&self, tie: &Tie) -> f64 {
        tie.log + tie.of.iter().map(|(name, sign)| sign * self.log(name)).sum::<f64>()
    }
}

/// Decides the units of channels that no header says, and which of some readings of the heading is right: `read` is the record
/// under each with its further entries of the mapping. The draft is told what was decided by what, and what was not.
pub(super) fn decide(draft: &mut Draft, read: &[(&'static str, Record)]) {
    let open = draft.open.clone();
    let told: Vec<Vec<Tie>> = read.iter().map(|(_, record)| ties(record)).collect();
    let all = tries(&open, read, &told);
    // the first of those that are alike: the usual units stand first
    let Some(best) = all.iter().min_by(|a, b| a.cost.total_cmp(&b.cost)) else { return };
    let is_told = |other: &dyn Fn(&Tried) -> bool| {
        let costs = all.iter().filter(|tried| other(tried)).map(|tried| tried.cost);
        costs.fold(f64::INFINITY, f64::min) - best.cost > MARGIN
    };
    let (entries, record) = &read[best.heading];
    for (place, (name, units, _)) in OPEN.iter().enumerate().filter(|(_, row)| open.contains(&row.0)) {
        let unit = units[best.units[place]];
        if is_told(&|tried| tried.units[place] != best.units[place]) {
            let by = told[best.heading].iter().filter(|tie| tie.of.iter().any(|of| of.0 == *name));
            let by: Vec<&str> = by.map(|tie| tie.words).collect();
            let by = if by.is_empty() { "of other units it would be absurd".to_owned() } else { by.join(", ") };
            draft.add(name, &format!("unit = {unit:?}"), &format!("unit by the data: {by}"));
        } else {
            draft.add(name, &format!("unit = {unit:?}"), "unit assumed");
            let values = range(record.channel(name).unwrap_or_default());
            draft.undecided.push(format!(
                "{name}: neither header nor data tell its unit; {unit} is taken (values {:.4} to {:.4})",
                values[0], values[1]
            ));
        }
    }
    if read.len() > 1 {
        let told = is_told(&|tried| tried.heading != best.heading);
        draft.add("yaw", entries, if told { "read by the data" } else { "assumed" });
        if !told {
            let taken = if entries.is_empty() { "radians to the left" } else { entries };
            draft.undecided.push(format!("yaw: neither header nor data tell how it counts; {taken} is taken"));
        }
    }
    let far =
        told[best.heading].iter().map(|tie| (tie.words, best.left(tie).abs())).filter(|(_, left)| *left > FAR.ln());
    draft.undecided.extend(
        far.map(|(words, left)| {
            format!("{words} differ by a factor of {:.2} in every unit that was tried", left.exp())
        }),
    );
}

/// Returns all units of the open channels with all readings of the heading, and what each costs.
fn tries(open: &[&str], read: &[(&'static str, Record)], told: &[Vec<Tie>]) -> Vec<Tried> {
    let mut all: Vec<[usize; OPEN.len()]> = vec![[0; OPEN.len()]];
    for (place, (_, units, _)) in OPEN.iter().enumerate().filter(|(_, row)| open.contains(&row.0)) {
        let with = |set: [usize; OPEN.len()], unit: usize| {
            let mut set = set;
            set[place] = unit;
            set
        };
        all = all.into_iter().flat_map(|set| (0..units.len()).map(move |unit| with(set, unit))).collect();
    }
    let cost = |tried: &Tried| {
        let record = &read[tried.heading].1;
        let absurd = OPEN.iter().filter(|(name, _, most)| {
            open.contains(name) && record.channel(name).is_some_and(|v| largest(v) * tried.log(name).exp() > *most)
        });
        let ties: f64 = told[tried.heading].iter().map(|tie| tried.left(tie).powi(2)).sum();
        astray(record) + ABSURD * absurd.count() as f64 + ties
    };
    let each = (0..read.len()).flat_map(|heading| all.iter().map(move |units| (heading, *units)));
    let costed = each.map(|(heading, units)| {
        let tried = Tried { cost: 0.0, heading, units };
        Tried { cost: cost(&tried), ..tried }
    });
    costed.collect()
}

/// Returns the relations that a record tells.
fn ties(record: &Record) -> Vec<Tie> {
    let own = |name: &str| record.channel(name).filter(|_| !record.derived.contains(&name));
    let clear = |first: &[f64], second: &[f64]| {
        let relation = relate(first, second, 1e-9).filter(|r| r.correlation.abs() > CLEAR)?;
        Some(relation.slope / relation.correlation)
    };
    let mut ties = Vec::new();
    let mut tie = |words, ratio: Option<f64>, of: &[(&'static str, f64)]| {
        let log = ratio.map(|ratio| ratio.abs().ln()).filter(|log| log.is_finite());
        ties.extend(log.map(|log| Tie { words, log, of: of.to_vec() }));
    };
    let (path, v, wheel) = (record.path(), own("v"), own("v_wheel"));
    if let (Some(path), Some(v)) = (&path, v) {
        tie("position and v", moving_ratio(path, v), &[("v", -1.0)]);
    }
    match (v, &path, wheel) {
        (Some(v), _, Some(wheel)) => tie("v and v_wheel", moving_ratio(v, wheel), &[("v", 1.0), ("v_wheel", -1.0)]),
        (None, Some(path), Some(wheel)) => tie("position and v_wheel", moving_ratio(path, wheel), &[("v_wheel", -1.0)]),
        _ => {}
    }
    let speeds = [("v", v), ("v_wheel", wheel), ("x", path.as_deref())];
    let speed = speeds.into_iter().find_map(|(name, values)| Some((name, values?)));
    if let (Some((of, speed)), Some(ax)) = (speed, own("ax")) {
        tie("ax and the change of speed", clear(&slope(speed, STEP_SECS), ax), &[("ax", 1.0), (of, -1.0)]);
    }
    if let (Some((of, speed)), Some(asked)) = (speed, own("cmd_accel")) {
        tie(
            "cmd_accel and the change of speed",
            clear(&slope(speed, STEP_SECS), asked),
            &[("cmd_accel", 1.0), (of, -1.0)],
        );
    }
    let turn = own("yaw").map(|yaw| slope(yaw, STEP_SECS));
    if let (Some(turn), Some(rate)) = (&turn, own("yaw_rate")) {
        tie("yaw_rate and the change of yaw", clear(turn, rate), &[("yaw_rate", 1.0)]);
    }
    let rate = own("yaw_rate").map(|rate| ("yaw_rate", rate)).or(turn.as_deref().map(|turn| ("yaw", turn)));
    if let (Some((of, speed)), Some((turned, rate)), Some(ay)) = (speed, rate, own("ay")) {
        let across: Vec<f64> = speed.iter().zip(rate).map(|(v, r)| v * r).collect();
        let of = [("ay", 1.0), (of, -1.0), (turned, -1.0)];
        tie("ay and speed times yaw rate", clear(&across, ay), &of);
    }
    ties
}

/// Returns what speaks against the heading as it was read.
fn astray(record: &Record) -> f64 {
    let Some(yaw) = record.channel("yaw") else { return 0.0 };
    let fast = largest(&slope(yaw, STEP_SECS)) > FASTEST_TURN;
    if leads_astray(record) { ASTRAY } else { f64::from(u8::from(fast)) * ABSURD }
}

/// Returns the size that one value in a hundred exceeds.
fn largest(values: &[f64]) -> f64 {
    ds_stats::quantile(&mut values.iter().map(|v| v.abs()).collect::<Vec<f64>>(), 0.99)
}

/// Returns the least and the largest finite value.
pub(super) fn range(values: &[f64]) -> [f64; 2] {
    let finite = values.iter().filter(|v| v.is_finite());
    finite.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(*v), high.max(*v)])
}
