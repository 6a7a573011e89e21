//! Steering, gyro, heading and side acceleration must tell of one and the same turn.

use super::motion::accelerometer;
use crate::finding::LogFinding;
use crate::record::Record;
use crate::resample::slope;
use ds_diagnosis::relation::{Relation, near, relate, relate_at};
use ds_diagnosis::table::STEP_SECS;

/// Degrees per radian.
const DEGREES: f64 = 57.3;
/// Turns of the steering wheel per turn of the road wheel in any car or truck.
pub(crate) const STEERING_RATIO: std::ops::Range<f64> = 8.0..26.0;
/// Lead of the measurement over the command from which the stamps are to blame, samples.
const LEAD: i32 = 3;

/// Least spread of the yaw rate that tells, rad/s.
const LEAST_TURN: f64 = 0.006;

/// Returns what does not fit; `base_m` is the wheelbase.
pub(super) fn findings(record: &Record, speed: &[f64], base_m: f64) -> Vec<LogFinding> {
    let own = |name: &str| record.channel(name).filter(|_| !record.derived.contains(&name));
    let mut found = Vec::new();
    let heading_rate = own("yaw").map(|yaw| slope(yaw, STEP_SECS));
    let gyro = own("yaw_rate");
    if let (Some(rate), Some(gyro)) = (&heading_rate, gyro) {
        found.extend(heading(record, rate, gyro));
    }
    let turned = found.iter().any(|f| f.channel == "yaw_rate" || f.channel == "yaw");
    let Some(rate) = gyro.map(<[f64]>::to_vec).or(heading_rate) else { return found };
    if turned {
        return found;
    }
    for name in ["cmd_steer", "steer_meas"] {
        let Some(steer) = own(name) else { continue };
        let asked: Vec<f64> = steer.iter().zip(speed).map(|(angle, v)| v * angle / base_m).collect();
        found.extend(steering(record, name, &asked, &rate));
    }
    let centripetal: Vec<f64> = speed.iter().zip(&rate).map(|(v, r)| v * r).collect();
    let swapped = own("ax").and_then(|ax| relate(&centripetal, ax, 0.3)).is_some_and(|r| r.correlation.abs() > 0.7);
    if let (Some(ay), false) = (own("ay"), swapped) {
        found.extend(relate(&centripetal, ay, 0.3).and_then(|r| accelerometer(record, "ay", "v yaw_rate", r)));
        let mean = ay.iter().sum::<f64>() / ay.len() as f64;
        if mean.abs() > 6.0 {
            let evidence = format!("its mean is {mean:.2} m/s2");
            found.push(record.finding("ay", "holds gravity", evidence, "map the left axis, not the vertical one"));
        }
    }
    found
}

/// The gyro must turn as the heading does.
fn heading(record: &Record, rate: &[f64], gyro: &[f64]) -> Option<LogFinding> {
    let relation = relate(gyro, rate, 0.01)?;
    let evidence =
        format!("heading turns {:.3} times as fast as yaw_rate says (r = {:.2})", relation.slope, relation.correlation);
    let said = |channel: &str, problem: &str, proposal: &str| {
        Some(record.finding(channel, problem, evidence.clone(), proposal))
    };
    if relation.correlation < -0.6 {
        return said(
            "yaw_rate",
            "gyro and heading turn opposite ways",
            "frame.body = \"frd\" or channels.yaw_rate.negate = true if the gyro counts to the right; frame.pose = \"ned\" if the pose does",
        );
    }
    if relation.correlation < 0.7 {
        return None;
    }
    if near(relation.slope, DEGREES, 1.5) {
        return said("yaw", "degrees read as radians", "channels.yaw.unit = \"deg\"");
    }
    if near(relation.slope, 1.0 / DEGREES, 1.5) {
        return said("yaw_rate", "degrees read as radians", "channels.yaw_rate.unit = \"deg/s\"");
    }
    None
}

/// Returns by how many samples a turn follows what was asked for, and how.
fn follows(asked: &[f64], rate: &[f64]) -> Option<(i32, Relation)> {
    let shifted = |lag: i32| {
        let n = asked.len() as i32;
        let (a, b) = (0.max(-lag), n.min(n - lag));
        if b - a < 160 {
            return None;
        }
        relate_at(&asked[a as usize..b as usize], &rate[(a + lag) as usize..(b + lag) as usize], LEAST_TURN)
    };
    (-20..=20)
        .filter_map(|lag| shifted(lag).map(|r| (lag, r)))
        .max_by(|a, b| a.1.correlation.abs().total_cmp(&b.1.correlation.abs()))
}

/// Returns the wheelbase that a vehicle without slip would have, m, if a channel is the angle of its road wheels, with the
/// correlation that says so.
pub(crate) fn wheelbase_m(record: &Record, steering: &str) -> Option<(f64, f64)> {
    let (speed, steer) = (record.speed()?, record.channel(steering)?);
    let rate =
        record.channel("yaw_rate").map(<[f64]>::to_vec).or_else(|| Some(slope(record.channel("yaw")?, STEP_SECS)))?;
    let asked: Vec<f64> = steer.iter().zip(&speed).map(|(angle, v)| v * angle).collect();
    let (_, best) = follows(&asked, &rate)?;
    Some((1.0 / best.slope, best.correlation))
}

/// The vehicle must turn as the steering says: yaw rate about speed times angle over wheelbase, after the command.
fn steering(record: &Record, name: &str, asked: &[f64], rate: &[f64]) -> Option<LogFinding> {
    let (lag, best) = follows(asked, rate)?;
    let evidence =
        format!("yaw rate is {:.4} times speed times {name} over wheelbase (r = {:.2})", best.slope, best.correlation);
    let said = |problem: &str, proposal: String| Some(record.finding(name, problem, evidence.clone(), proposal));
    if best.correlation < -0.6 {
        return said("wrong sign", format!("turn channels.{name}.negate"));
    }
    if best.correlation < 0.6 {
        return None;
    }
    if near(best.slope, 1.0 / DEGREES, 2.0) {
        return said("degrees read as radians", format!("channels.{name}.unit = \"deg\""));
    }
    let ratio = 1.0 / best.slope;
    if STEERING_RATIO.contains(&ratio) {
        return said(
            "steering wheel, not road wheel",
            format!("channels.{name}.scale = {best:.4} (1 / ratio)", best = best.slope),
        );
    }
    if STEERING_RATIO.contains(&(ratio / DEGREES)) {
        let scale = best.slope * DEGREES;
        return said(
            "steering wheel in degrees",
            format!("channels.{name}.unit = \"deg\", channels.{name}.scale = {scale:.4}"),
        );
    }
    if near(best.slope, DEGREES, 2.0) {
        return said("radians read as degrees", format!("channels.{name}.unit = \"rad\""));
    }
    let now = relate_at(asked, rate, LEAST_TURN)?.correlation;
    if lag <= -LEAD && best.correlation > now + 0.02 && name.starts_with("cmd") {
        let secs = f64::from(-lag) * STEP_SECS;
        let evidence = format!(
            "the vehicle turns {secs:.2} s before the command (r = {:.2}, at the same stamp {now:.2})",
            best.correlation
        );
        let proposal = "stamp the command when it is sent, not when it is logged".to_owned();
        return Some(record.finding(name, "command behind what it causes", evidence, proposal));
    }
    None
}
