//! Looks for what makes a log unusable or suspicious before anything is fitted: frozen, swapped, scaled or mirrored
//! columns, by relations that hold in any vehicle whatever effect is at work.
//!
//! A relation that only a wrong unit or column can break is an error; one that a strong effect could break is a warning.

mod sensors;

use crate::drive::fast::FAST_HZ;
use crate::drive::{COMMANDS, Drive, MEASURED};
use ds_diagnosis::CaseError;
use ds_diagnosis::meta::VehicleMeta;
use ds_diagnosis::table::STEP_SECS;

/// Samples a second below which the floor does not hold.
const SLOW_HZ: f64 = 15.0;
/// Largest commanded road-wheel angle of any vehicle, rad.
const LARGEST_STEER: f64 = 1.2;
/// Largest acceleration of any vehicle, m/s².
const LARGEST_ACCEL: f64 = 30.0;
/// Largest yaw rate of a vehicle of the usual wheelbase, rad/s.
const LARGEST_TURN: f64 = 6.0;
const USUAL_WHEELBASE_M: f64 = 2.5;
/// Fastest vehicle, m/s.
const FASTEST: f64 = 120.0;

/// Checks all drives; returns what is odd but usable.
///
/// # Errors
/// If a log cannot be what its columns say.
pub(crate) fn check(drives: &[Drive], meta: &VehicleMeta) -> Result<Vec<String>, CaseError> {
    let mut odd: Vec<(&str, String)> = Vec::new();
    for drive in drives {
        ranges(drive, meta)?;
        frozen(drive)?;
        motion(drive)?;
        let mut found = turning(drive, meta)?;
        found.extend(sensors::findings(drive));
        let rate = drive.rate_hz;
        if rate > FAST_HZ {
            found.push(format!(
                "{rate:.0} samples a second, averaged over steps of {STEP_SECS} s: nothing above 10 Hz is looked at"
            ));
        } else if rate < SLOW_HZ {
            found.push(format!("{rate:.0} samples a second; the floor is that of 20, so `unknown` may only mean that"));
        }
        found.extend(drive.oddities.iter().cloned());
        found.extend(missing(drive, meta).into_iter().map(|name| format!("channel {name} is absent")));
        odd.extend(found.into_iter().map(|what| (drive.file.as_str(), what)));
    }
    let mut warnings = folded(&odd, drives.len());
    warnings.extend(dead_commands(drives));
    if drives.iter().all(|d| d.followers.is_empty()) {
        warnings.push("no followers: effects of other drivers cannot be judged".to_owned());
    }
    Ok(warnings)
}

/// Says once what is odd about several of `all` drives, whatever its figures, by the first of them.
fn folded(odd: &[(&str, String)], all: usize) -> Vec<String> {
    let kind = |what: &str| what.replace(|c: char| c.is_ascii_digit() || ".-".contains(c), "");
    let mut kinds: Vec<(String, Vec<&(&str, String)>)> = Vec::new();
    for line in odd {
        let own = kind(&line.1);
        match kinds.iter_mut().find(|(kind, _)| *kind == own) {
            Some((_, lines)) => lines.push(line),
            None => kinds.push((own, vec![line])),
        }
    }
    let told = |(_, lines): &(String, Vec<&(&str, String)>)| {
        let (file, what) = lines[0];
        match lines.len() {
            1 => format!("{file}: {what}"),
            count => format!("in {count} of {all} drives: {what} ({file})"),
        }
    };
    kinds.iter().map(told).collect()
}

fn inconsistent(drive: &Drive, finding: String) -> CaseError {
    CaseError::Inconsistent { finding, file: drive.file.clone() }
}

fn largest(column: &[f64]) -> f64 {
    column.iter().map(|v| v.abs()).fold(0.0, f64::max)
}

/// Returns a typical size: the 90th percentile of magnitudes.
fn typical(column: impl Iterator<Item = f64>) -> f64 {
    let mut sizes: Vec<f64> = column.map(f64::abs).collect();
    ds_stats::quantile(&mut sizes, 0.9)
}

fn ranges(drive: &Drive, meta: &VehicleMeta) -> Result<(), CaseError> {
    let steer = largest(&drive.cmd_steer);
    if steer > LARGEST_STEER {
        return Err(inconsistent(drive, format!("cmd_steer reaches {steer:.1}, more than any road wheel: degrees?")));
    }
    let accel = largest(&drive.cmd_accel);
    if accel > LARGEST_ACCEL {
        return Err(inconsistent(drive, format!("cmd_accel reaches {accel:.1} m/s2: another unit or column?")));
    }
    let bounds = [
        ("v", &drive.v, FASTEST, "km/h or another column?"),
        ("v_wheel", &drive.v_wheel, FASTEST, "km/h or another column?"),
        ("yaw_rate", &drive.yaw_rate, fastest_turn(meta), "degrees per second?"),
        ("ax", &drive.ax, 60.0, "another unit?"),
        ("ay", &drive.ay, 60.0, "another unit?"),
        ("steer_meas", &drive.steer_meas, LARGEST_STEER, "degrees or steering-wheel angle?"),
    ];
    for (name, column, limit, guess) in bounds {
        if let Some(top) = column.as_ref().map(|c| largest(c)).filter(|top| *top > limit) {
            return Err(inconsistent(drive, format!("{name} reaches {top:.1}: {guess}")));
        }
    }
    Ok(())
}

/// Returns the largest yaw rate of a vehicle of such a wheelbase, rad/s; models of cars turn faster than cars.
fn fastest_turn(meta: &VehicleMeta) -> f64 {
    let wheelbase_m = meta.nominal.lf + meta.nominal.lr;
    (LARGEST_TURN * USUAL_WHEELBASE_M / wheelbase_m).clamp(LARGEST_TURN, 10.0 * LARGEST_TURN)
}

fn constant(column: &[f64]) -> bool {
    column.iter().all(|v| (v - column[0]).abs() < 1e-12)
}

/// A sensor never repeats itself over a whole drive; a command may (circles, steady speed).
fn frozen(drive: &Drive) -> Result<(), CaseError> {
    for (name, column) in drive.columns() {
        if constant(column) && !COMMANDS.contains(&name) {
            return Err(CaseError::ZeroVariance { column: name.to_owned(), file: drive.file.clone() });
        }
    }
    if drive.speed().is_none() {
        return Err(inconsistent(drive, "neither v, v_wheel nor x and y: no speed to start from".to_owned()));
    }
    Ok(())
}

/// Names the commands that keep one value over all drives though the vehicle moves: perhaps another column was meant.
fn dead_commands(drives: &[Drive]) -> Vec<String> {
    let moving = |drive: &Drive| drive.speed().is_some_and(|v| typical(v.iter().copied()) > 1.0);
    if !drives.iter().any(moving) {
        return Vec::new();
    }
    let dead = |name: &&str| {
        let columns = drives.iter().flat_map(Drive::columns).filter(|(n, _)| n == name);
        let all: Vec<f64> = columns.flat_map(|(_, column)| column.iter().copied()).collect();
        !all.is_empty() && constant(&all)
    };
    let told = |name| format!("{name} keeps one value over all drives: its effects cannot be judged; another column?");
    COMMANDS.into_iter().filter(dead).map(told).collect()
}

/// Position must move as fast as the speed says, and along the heading, backwards where the speed is below 0.
fn motion(drive: &Drive) -> Result<(), CaseError> {
    let (Some(x), Some(y)) = (&drive.x, &drive.y) else { return Ok(()) };
    let stride = 20;
    let mut pairs = Vec::new();
    let mut along = 0.0;
    for k in (0..drive.samples.saturating_sub(stride)).step_by(stride) {
        let (dx, dy) = (x[k + stride] - x[k], y[k + stride] - y[k]);
        let path = dx.hypot(dy);
        let travelled = drive.v.as_ref().map(|v| v[k..k + stride].iter().sum::<f64>() * STEP_SECS);
        if let Some(travelled) = travelled.filter(|travelled| *travelled > 2.0 || path > 4.0) {
            pairs.push(path / travelled.abs().max(0.1));
        }
        if let (Some(yaw), true) = (&drive.yaw, path > 2.0) {
            let heading = yaw[k + stride / 2];
            let way = travelled.map_or(1.0, f64::signum);
            along += way * (dx * heading.cos() + dy * heading.sin()) / path - 1.0;
        }
    }
    let windows = (drive.samples / stride).max(1) as f64;
    if pairs.len() > 3 {
        let ratio = ds_stats::quantile(&mut pairs, 0.5);
        if !(0.6..1.6).contains(&ratio) {
            let guess =
                if (3.0..4.2).contains(&(1.0 / ratio)) { "v in km/h?" } else { "v, x or y in another unit or column?" };
            return Err(inconsistent(drive, format!("position moves {ratio:.2} times as fast as v says: {guess}")));
        }
    }
    if along / windows < -0.4 {
        return Err(inconsistent(
            drive,
            "the path does not follow the heading: yaw in degrees, mirrored, or x and y swapped?".to_owned(),
        ));
    }
    Ok(())
}

/// Heading must turn as the gyro says, and both as the steering says; returns what is odd but usable.
fn turning(drive: &Drive, meta: &VehicleMeta) -> Result<Vec<String>, CaseError> {
    let base = meta.nominal.lf + meta.nominal.lr;
    let mut warnings = Vec::new();
    let Some(speed) = drive.speed() else { return Ok(warnings) };
    let steered = |angles: &[f64]| -> Vec<f64> { angles.iter().zip(&speed).map(|(d, v)| v * d.tan() / base).collect() };
    let kinematic = steered(&drive.cmd_steer);
    if let (Some(yaw), Some(rate)) = (&drive.yaw, &drive.yaw_rate) {
        let stride = 20;
        let (mut cross, mut square, mut turned) = (0.0, 0.0, 0.0);
        for k in (0..drive.samples.saturating_sub(stride)).step_by(stride) {
            let turn = yaw[k + stride] - yaw[k];
            let gyro = rate[k..k + stride].iter().sum::<f64>() * STEP_SECS;
            cross += turn * gyro;
            square += gyro * gyro;
            turned += turn * turn;
        }
        let slope = cross / square.max(1e-12);
        if turned.sqrt() > 0.3 && !(0.5..2.0).contains(&slope) {
            let finding = format!(
                "heading turns {slope:.2} times as much as the gyro says: degrees, wrong sign or swapped columns?"
            );
            return Err(inconsistent(drive, finding));
        }
    }
    if let Some(rate) = &drive.yaw_rate {
        if let Some(slope) = turn_slope(&kinematic, rate) {
            // a steering zero far off makes the sign of small angles meaningless: their changes must go the wrong way too
            let centred = || turn_slope(&steered(&centred(&drive.cmd_steer, &speed)), &centred_turns(rate, &speed));
            if slope < -0.1 && centred().is_none_or(|slope| slope < -0.1) {
                let finding = "the vehicle turns against the steering: sign of cmd_steer or yaw_rate?".to_owned();
                return Err(inconsistent(drive, finding));
            }
            if !(0.2..2.5).contains(&slope) {
                warnings.push(format!("the vehicle turns {slope:.2} times as much as the steering says"));
            }
        }
        if let Some(ay) = &drive.ay {
            let centripetal: Vec<f64> = rate.iter().zip(&speed).map(|(r, v)| r * v).collect();
            let square: f64 = centripetal.iter().map(|c| c * c).sum();
            let slope = centripetal.iter().zip(ay).map(|(c, a)| c * a).sum::<f64>() / square.max(1e-12);
            if typical(centripetal.iter().copied()) > 0.5 && !(0.5..1.8).contains(&slope) {
                warnings
                    .push(format!("ay is {slope:.2} times speed times yaw rate: g, wrong sign or swapped with ax?"));
            }
        }
    }
    Ok(warnings)
}

/// Returns how much a vehicle turns for what its steering says: the median over stretches of two seconds, so that one
/// slide or spin does not decide; nothing where it hardly steers.
fn turn_slope(steered: &[f64], turned: &[f64]) -> Option<f64> {
    let slope = |(a, b): (&[f64], &[f64])| {
        let square: f64 = a.iter().map(|s| s * s).sum();
        let cross: f64 = a.iter().zip(b).map(|(s, t)| s * t).sum();
        (square > a.len() as f64 * 0.03 * 0.03).then(|| cross / square)
    };
    let mut slopes: Vec<f64> = steered.chunks_exact(40).zip(turned.chunks_exact(40)).filter_map(slope).collect();
    (slopes.len() > 3).then(|| ds_stats::quantile(&mut slopes, 0.5))
}

/// Returns steering angles less their median while driving.
fn centred(angles: &[f64], speed: &[f64]) -> Vec<f64> {
    let mut moving: Vec<f64> = angles.iter().zip(speed).filter(|(_, v)| **v > 1.0).map(|(d, _)| *d).collect();
    let middle = if moving.is_empty() { 0.0 } else { ds_stats::quantile(&mut moving, 0.5) };
    angles.iter().map(|d| d - middle).collect()
}

/// Returns yaw rates less what the median curvature makes of the speed.
fn centred_turns(rate: &[f64], speed: &[f64]) -> Vec<f64> {
    let curvature: Vec<f64> = rate.iter().zip(speed).map(|(r, v)| r / v.max(1.0)).collect();
    centred(&curvature, speed).iter().zip(speed).map(|(c, v)| c * v).collect()
}

fn missing(drive: &Drive, meta: &VehicleMeta) -> Vec<&'static str> {
    let there: Vec<&str> = drive.columns().iter().map(|c| c.0).collect();
    let told = |name: &str| meta.channels_missing.iter().any(|m| m == name);
    MEASURED.into_iter().filter(|name| !there.contains(name) && !told(name)).collect()
}
