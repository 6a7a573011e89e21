//! Sensors that stand still, or seem to be in another unit or of another sign, by what the speed does meanwhile.

use ds_diagnosis::relation::{Relation, near, relate};
use ds_diagnosis::table::STEP_SECS;

use crate::drive::{Drive, MEASURED};

/// Longest time for which a sensor may keep one value while the vehicle moves, s.
const FROZEN_SECS: f64 = 5.0;
/// Speed from which on a vehicle moves, m/s.
const MOVING_MPS: f64 = 1.0;
/// Ratios of the wheels' speed to the vehicle's within which both are in one unit.
const SAME_SPEED: std::ops::Range<f64> = 0.74..1.34;
/// Standard gravity, m/s².
const GRAVITY_MPS2: f64 = 9.81;
/// Mean of a horizontal accelerometer from which on it holds gravity, m/s².
const HOLDS_GRAVITY_MPS2: f64 = 5.0;
/// Half of the time over which a change of speed is taken, samples.
const HALF: usize = 4;
/// Least spread of the change of speed that tells, m/s².
const TELLING_MPS2: f64 = 0.15;

/// Returns what looks wrong but could be used.
pub(super) fn findings(drive: &Drive) -> Vec<String> {
    let Some(speed) = drive.speed() else { return Vec::new() };
    let mut found: Vec<String> =
        drive.columns().iter().filter_map(|(name, column)| still(name, column, &speed)).collect();
    found.extend(wheels(drive));
    found.extend(forward(drive, &speed));
    for (name, column) in [("ax", &drive.ax), ("ay", &drive.ay)] {
        let mean = column.as_ref().map_or(0.0, |c| c.iter().sum::<f64>() / c.len() as f64);
        if mean.abs() > HOLDS_GRAVITY_MPS2 {
            found.push(format!("{name} has a mean of {mean:.1} m/s2: does it hold gravity?"));
        }
    }
    found
}

/// Says for how long a sensor keeps one value while the vehicle moves.
fn still(name: &str, column: &[f64], speed: &[f64]) -> Option<String> {
    let (mut run, mut longest) = (0, 0);
    for (pair, v) in column.windows(2).zip(speed) {
        run = if (pair[1] - pair[0]).abs() < 1e-9 && *v > MOVING_MPS { run + 1 } else { 0 };
        longest = longest.max(run);
    }
    let secs = longest as f64 * STEP_SECS;
    (MEASURED.contains(&name) && secs > FROZEN_SECS)
        .then(|| format!("{name} keeps one value for {secs:.1} s while the vehicle moves: frozen?"))
}

fn wheels(drive: &Drive) -> Option<String> {
    let pairs = drive.v.as_ref()?.iter().zip(drive.v_wheel.as_ref()?);
    let mut ratios: Vec<f64> = pairs.filter(|(v, _)| **v > MOVING_MPS).map(|(v, wheel)| wheel / v).collect();
    if ratios.len() < 40 {
        return None;
    }
    let ratio = ds_stats::quantile(&mut ratios, 0.5);
    (!SAME_SPEED.contains(&ratio)).then(|| format!("v_wheel is {ratio:.2} times v: km/h or another unit?"))
}

/// Accelerometer and drive command must go with the change of speed.
fn forward(drive: &Drive, speed: &[f64]) -> Vec<String> {
    let change: Vec<f64> =
        speed.windows(2 * HALF + 1).map(|w| (w[2 * HALF] - w[0]) / (2 * HALF) as f64 / STEP_SECS).collect();
    let related = |column: &[f64]| relate(&change, column.get(HALF..)?, TELLING_MPS2);
    let mut found = Vec::new();
    if let Some(Relation { slope, correlation }) = drive.ax.as_deref().and_then(related) {
        let told = |guess: &str| format!("ax is {slope:.2} times the change of speed (r = {correlation:.2}): {guess}");
        if correlation < -0.6 {
            found.push(told("wrong sign?"));
        } else if correlation > 0.7 && near(slope, 1.0 / GRAVITY_MPS2, 1.6) {
            found.push(told("g?"));
        }
    }
    if let Some(Relation { correlation, .. }) = related(&drive.cmd_accel).filter(|r| r.correlation < -0.5) {
        found.push(format!("cmd_accel goes against the change of speed (r = {correlation:.2}): wrong sign?"));
    }
    found
}
