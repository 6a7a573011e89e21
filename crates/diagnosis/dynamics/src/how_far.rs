//! How far the gap shrinks: nominal and corrected simulator on drives that the fit never saw, against the floor.
//!
//! Position, heading and speed errors of free rollouts at fixed times, and each channel's residual; root mean squares in
//! the channel's unit. Share explained is 1 - (after - floor) / (before - floor) with a 90 % block-bootstrap interval.

use ds_effect::{Channel, Plant};

use ds_stats::quantile;

use crate::bootstrap::weights;
use crate::case::Case;
use crate::floor;
use crate::following;
use crate::windows::{BLOCK, EGO, EgoRecord};
use ds_diagnosis::schema::Shrink;

/// Samples between starts of the five-second rollouts.
const STRIDE: usize = 40;
/// Samples of a rollout.
const SCORED: usize = 100;

/// Squared errors of one metric, window by window: before, after, floor.
struct Errors {
    name: String,
    rows: Vec<[f64; 3]>,
    drives: Vec<usize>,
}

/// Compares two simulators of the ego and of the followers on some drives.
#[must_use]
pub fn how_far(case: &Case, drives: &[usize], plants: [(&Plant, &Plant); 2], data: &str) -> Vec<Shrink> {
    let mut all = Vec::new();
    ego(case, drives, plants[0], &mut all);
    following(case, drives, plants[1], &mut all);
    all.iter().filter_map(|errors| shrink(errors, data)).collect()
}

fn ego(case: &Case, drives: &[usize], (before, after): (&Plant, &Plant), all: &mut Vec<Errors>) {
    let names = ["position_1s", "position_2s", "position_5s", "yaw_2s", "speed_2s"];
    let channels = (0..EGO).map(|c| format!("channel:{}", Channel::ALL[c].name()));
    let first = all.len();
    all.extend(names.iter().map(|n| (*n).to_owned()).chain(channels).map(|name| Errors {
        name,
        rows: Vec::new(),
        drives: Vec::new(),
    }));
    for record in case.ego.iter().filter(|r| drives.contains(&r.drive)) {
        let (bare, full) = (rollouts(record, before), rollouts(record, after));
        let noise = &case.noise;
        for ((anchor, b), a) in record.anchors_every(STRIDE, SCORED).iter().zip(&bare).zip(&full) {
            let blocks = SCORED / BLOCK;
            let floor = |c: usize, k: usize| floor::ego(c, k, &anchor.regime, noise).powi(2);
            let at = |c: usize, secs: f64| c * blocks + (secs / 0.25) as usize - 1;
            let pair = |f: &dyn Fn(&[f64]) -> f64, floor: f64| [f(b), f(a), floor];
            let square = |r: &[f64], i: usize| r[i] * r[i];
            for (k, secs) in [1.0, 2.0, 5.0].into_iter().enumerate() {
                let block = at(0, secs);
                let error = |r: &[f64]| square(r, at(0, secs)) + square(r, at(1, secs));
                push(&mut all[first + k], record.drive, pair(&error, floor(0, block) + floor(1, block)));
            }
            for (k, channel) in [(3, 2), (4, 3)] {
                let error = |r: &[f64]| square(r, at(channel, 2.0));
                push(&mut all[first + k], record.drive, pair(&error, floor(channel, at(0, 2.0))));
            }
            for channel in 0..EGO {
                let scored = 8;
                let error = |r: &[f64]| (0..scored).map(|k| square(r, channel * blocks + k)).sum::<f64>() / 8.0;
                let clean = (0..scored).map(|k| floor(channel, k)).sum::<f64>() / 8.0;
                push(&mut all[first + 5 + channel], record.drive, pair(&error, clean));
            }
        }
    }
}

fn rollouts(record: &EgoRecord, plant: &Plant) -> Vec<Vec<f64>> {
    record.windows(&record.anchors_every(STRIDE, SCORED), &record.inputs, plant)
}

fn following(case: &Case, drives: &[usize], (before, after): (&Plant, &Plant), all: &mut Vec<Errors>) {
    let first = all.len();
    for channel in [Channel::FollowerSpeed, Channel::FollowerGap] {
        let name = format!("channel:{}", channel.name());
        all.push(Errors { name, rows: Vec::new(), drives: Vec::new() });
    }
    let blocks = following::BLOCKS;
    for record in case.following.iter().filter(|r| drives.contains(&r.drive)) {
        let (bare, full) = (record.residuals(before), record.residuals(after));
        for (b, a) in bare.chunks(2 * blocks).zip(full.chunks(2 * blocks)) {
            for channel in 0..2 {
                let range = channel * blocks..(channel + 1) * blocks;
                let mean = |r: &[f64]| r[range.clone()].iter().map(|e| e * e).sum::<f64>() / blocks as f64;
                let clean =
                    (0..blocks).map(|k| floor::follower(channel, k, &case.noise).powi(2)).sum::<f64>() / blocks as f64;
                push(&mut all[first + channel], record.drive, [mean(b), mean(a), clean]);
            }
        }
    }
}

fn push(errors: &mut Errors, drive: usize, row: [f64; 3]) {
    if row.iter().all(|v| v.is_finite()) {
        errors.rows.push(row);
        errors.drives.push(drive);
    }
}

fn shrink(errors: &Errors, data: &str) -> Option<Shrink> {
    if errors.rows.len() < 3 {
        return None;
    }
    let [before, after, floor] = roots(&errors.rows, None);
    let draws = weights(&errors.drives, "shrink");
    let mut shares: Vec<f64> = draws.iter().map(|d| share_of(&errors.rows, Some(d))).collect();
    Some(Shrink {
        metric: errors.name.clone(),
        before,
        after,
        floor,
        share_explained: share_of(&errors.rows, None),
        interval90: [quantile(&mut shares, 0.05), quantile(&mut shares, 0.95)],
        data: data.to_owned(),
    })
}

fn roots(rows: &[[f64; 3]], draw: Option<&Vec<f64>>) -> [f64; 3] {
    let mut sums = [0.0; 3];
    let mut total = 0.0;
    for (k, row) in rows.iter().enumerate() {
        let weight = draw.map_or(1.0, |d| d[k]);
        total += weight;
        sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += weight * value);
    }
    sums.map(|sum| (sum / f64::max(total, 1e-9)).sqrt())
}

/// Returns the squared errors of `position_2s` by window (before, after, floor) and the windows' drives.
#[must_use]
pub fn position_errors(case: &Case, drives: &[usize], plants: (&Plant, &Plant)) -> (Vec<[f64; 3]>, Vec<usize>) {
    let mut all = Vec::new();
    ego(case, drives, plants, &mut all);
    all.into_iter().find(|e| e.name == "position_2s").map(|e| (e.rows, e.drives)).unwrap_or_default()
}

/// Returns the share explained by squared errors of windows, each counted as often as a draw says.
#[must_use]
pub fn share_of(rows: &[[f64; 3]], draw: Option<&Vec<f64>>) -> f64 {
    share(roots(rows, draw))
}

/// Returns the share of the gap beyond the floor that is explained, 0 where there is none to explain.
fn share([before, after, floor]: [f64; 3]) -> f64 {
    let gap = before - floor;
    if gap <= 0.05 * floor { 0.0 } else { (1.0 - (after - floor).max(0.0) / gap).clamp(-5.0, 1.0) }
}
