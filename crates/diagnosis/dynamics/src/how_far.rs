//! How far the gap shrinks on drives that the fit never saw: the nominal simulator, the one with the ordinary mismatch
//! fitted and the one with the effects added as well, against the floor.
//!
//! Position, heading and speed errors of free rollouts at fixed times, and each channel's residual; root mean squares in
//! the channel's unit. Shares are those of `ds_stats::explained`, over a bootstrap of drives and
//! blocks within them.

use std::collections::BTreeSet;

use ds_effect::{Channel, Plant};

use crate::bootstrap::{weights, weights_of_drives};
use crate::case::Case;
use crate::ego::Inputs;
use crate::floor;
use crate::following;
use crate::windows::{Anchor, BLOCK, EGO, EgoRecord};
use ds_diagnosis::saved::Saved;
use ds_diagnosis::schema::Shrink;

/// Samples between starts of the five-second rollouts, and in drives shorter than [`SHORT`].
const STRIDES: [usize; 2] = [40, 10];
/// Samples of a short drive.
const SHORT: usize = 400;
/// Samples of a rollout.
const SCORED: usize = 100;

/// A part's simulators: nominal, with the ordinary mismatch, with the effects as well.
pub type States<'a> = [&'a Plant; 3];

/// How the residuals of some windows are had: measured, or by what is known of the simulator.
type Residuals = fn(&EgoRecord, &[Anchor], &Inputs, &Plant) -> Vec<Vec<f64>>;

/// Squared errors of one metric, window by window: the three states and the floor.
struct Errors {
    name: String,
    rows: Vec<[f64; 4]>,
    drives: Vec<usize>,
}

/// Compares the simulators of the ego and of the followers on some drives.
#[must_use]
pub fn how_far(case: &Case, drives: &[usize], [car, followers]: [&States<'_>; 2], data: &str) -> Vec<Shrink> {
    let mut all = Vec::new();
    ego(case, drives, car, EgoRecord::measured, &mut all);
    following(case, drives, followers, &mut all);
    all.iter().filter_map(|errors| shrink(errors, data)).collect()
}

/// Compares the simulators on drives of which each has its own, fitted without it.
#[must_use]
pub fn cross_fitted(case: &Case, drives: &[(usize, [[Plant; 3]; 2])]) -> Vec<Shrink> {
    let mut all: Vec<Errors> = Vec::new();
    for (drive, [car, followers]) in drives {
        let mut own = Vec::new();
        ego(case, &[*drive], &car.each_ref(), EgoRecord::measured, &mut own);
        following(case, &[*drive], &followers.each_ref(), &mut own);
        for errors in own {
            match all.iter_mut().find(|other| other.name == errors.name) {
                Some(other) => {
                    other.rows.extend(errors.rows);
                    other.drives.extend(errors.drives);
                }
                None => all.push(errors),
            }
        }
    }
    all.iter().filter_map(|errors| shrink(errors, "crossfit")).collect()
}

fn ego(case: &Case, drives: &[usize], plants: &States<'_>, residuals: Residuals, all: &mut Vec<Errors>) {
    let names = ["position_1s", "position_2s", "position_5s", "yaw_2s", "speed_2s"];
    let channels = (0..EGO).map(|c| format!("channel:{}", Channel::ALL[c].name()));
    let first = all.len();
    all.extend(names.iter().map(|n| (*n).to_owned()).chain(channels).map(|name| Errors {
        name,
        rows: Vec::new(),
        drives: Vec::new(),
    }));
    for record in case.ego.iter().filter(|r| drives.contains(&r.drive)) {
        let starts = record.measurable(starts(record));
        let rolled = plants.map(|plant| residuals(record, &starts, &record.inputs, plant));
        let noise = &case.noise;
        for (k, anchor) in starts.iter().enumerate() {
            let own = rolled.each_ref().map(|states| &states[k]);
            let blocks = SCORED / BLOCK;
            let floor = |c: usize, k: usize| floor::ego(c, k, &anchor.regime, noise).powi(2);
            let at = |c: usize, secs: f64| c * blocks + (secs / 0.25) as usize - 1;
            let row = |f: &dyn Fn(&[f64]) -> f64, floor: f64| {
                let [nominal, nuisance, corrected] = own.map(|r| f(r));
                [nominal, nuisance, corrected, floor]
            };
            let square = |r: &[f64], i: usize| r[i] * r[i];
            for (k, secs) in [1.0, 2.0, 5.0].into_iter().enumerate() {
                let block = at(0, secs);
                let error = |r: &[f64]| square(r, at(0, secs)) + square(r, at(1, secs));
                push(&mut all[first + k], record.drive, row(&error, floor(0, block) + floor(1, block)));
            }
            for (k, channel) in [(3, 2), (4, 3)] {
                let error = |r: &[f64]| square(r, at(channel, 2.0));
                push(&mut all[first + k], record.drive, row(&error, floor(channel, at(0, 2.0))));
            }
            for channel in 0..EGO {
                let scored = 8;
                let error = |r: &[f64]| (0..scored).map(|k| square(r, channel * blocks + k)).sum::<f64>() / 8.0;
                let clean = (0..scored).map(|k| floor(channel, k)).sum::<f64>() / 8.0;
                push(&mut all[first + 5 + channel], record.drive, row(&error, clean));
            }
        }
    }
}

fn starts(record: &EgoRecord) -> Vec<Anchor> {
    record.anchors_every(STRIDES[usize::from(record.samples() < SHORT)], SCORED)
}

fn following(case: &Case, drives: &[usize], plants: &States<'_>, all: &mut Vec<Errors>) {
    let first = all.len();
    for channel in [Channel::FollowerSpeed, Channel::FollowerGap] {
        let name = format!("channel:{}", channel.name());
        all.push(Errors { name, rows: Vec::new(), drives: Vec::new() });
    }
    let blocks = following::BLOCKS;
    for record in case.following.iter().filter(|r| drives.contains(&r.drive)) {
        let rolled = plants.map(|plant| record.residuals(plant));
        for start in (0..rolled[0].len()).step_by(2 * blocks) {
            for channel in 0..2 {
                let range = start + channel * blocks..start + (channel + 1) * blocks;
                let mean = |r: &[f64]| r[range.clone()].iter().map(|e| e * e).sum::<f64>() / blocks as f64;
                let [nominal, nuisance, corrected] = rolled.each_ref().map(|r| mean(r));
                let clean =
                    (0..blocks).map(|k| floor::follower(channel, k, &case.noise).powi(2)).sum::<f64>() / blocks as f64;
                push(&mut all[first + channel], record.drive, [nominal, nuisance, corrected, clean]);
            }
        }
    }
}

fn push(errors: &mut Errors, drive: usize, row: [f64; 4]) {
    if row.iter().all(|v| v.is_finite()) {
        errors.rows.push(row);
        errors.drives.push(drive);
    }
}

fn shrink(errors: &Errors, data: &str) -> Option<Shrink> {
    if errors.rows.len() < 3 {
        return None;
    }
    let drawn =
        |draws: Vec<Vec<f64>>| -> Vec<[f64; 4]> { draws.iter().map(|d| roots(&errors.rows, Some(d))).collect() };
    let here = drawn(weights(&errors.drives, "shrink"));
    let elsewhere = drawn(weights_of_drives(&errors.drives, "drives"));
    let all = roots(&errors.rows, None);
    let added = |[_, nuisance, after, _]: [f64; 4]| [nuisance, after];
    let drives: BTreeSet<usize> = errors.drives.iter().copied().collect();
    let saved = Saved::new(added(all), elsewhere.iter().copied().map(added), drives.len());
    Some(Shrink { saved, ..Shrink::elsewhere(&errors.name, all, [&here, &elsewhere], data) })
}

/// Returns the root mean squares of rows of squares, each counted as often as a draw says.
#[must_use]
pub fn roots<const N: usize>(rows: &[[f64; N]], draw: Option<&Vec<f64>>) -> [f64; N] {
    let mut sums = [0.0; N];
    let mut total = 0.0;
    for (k, row) in rows.iter().enumerate() {
        let weight = draw.map_or(1.0, |d| d[k]);
        total += weight;
        sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += weight * value);
    }
    sums.map(|sum| (sum / f64::max(total, 1e-9)).sqrt())
}

/// Returns the squared errors of `position_2s` by window (the three states, the floor) and the windows' drives.
#[must_use]
pub fn position_errors(case: &Case, drives: &[usize], plants: &States<'_>) -> (Vec<[f64; 4]>, Vec<usize>) {
    let mut all = Vec::new();
    ego(case, drives, plants, EgoRecord::windows, &mut all);
    all.into_iter().find(|e| e.name == "position_2s").map(|e| (e.rows, e.drives)).unwrap_or_default()
}
