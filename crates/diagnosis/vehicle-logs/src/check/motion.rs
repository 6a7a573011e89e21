//! Speed, position, heading and forward acceleration must tell of one and the same motion.

use crate::finding::LogFinding;
use crate::record::Record;
use crate::resample::slope;
use ds_diagnosis::relation::{Relation, near, relate};
use ds_diagnosis::table::STEP_SECS;

/// Speed below which heading and course say nothing, as a share of the drive's typical speed.
const SLOW: f64 = 0.25;
/// Units in which speed is written by mistake, per m/s.
const SPEED_UNITS: [(f64, &str); 3] = [(3.6, "km/h"), (2.237, "mph"), (1000.0, "mm/s")];

/// Returns what does not fit.
pub(super) fn findings(record: &Record, speed: &[f64]) -> Vec<LogFinding> {
    let mut found = speeds(record);
    found.extend(course(record, speed));
    found.extend(forward(record, speed));
    found
}

/// Position must move as fast as either speed says, and wheels as fast as the vehicle.
fn speeds(record: &Record) -> Vec<LogFinding> {
    let mut found = Vec::new();
    let path = record.path();
    let own = |name: &str| record.channel(name).filter(|_| !record.derived.contains(&name));
    let pairs =
        [("v", path.as_deref(), "position moves"), ("v_wheel", own("v").or(path.as_deref()), "the vehicle moves")];
    for (name, reference, what) in pairs {
        let (Some(reference), Some(said)) = (reference, own(name)) else { continue };
        let Some(ratio) = moving_ratio(reference, said).filter(|ratio| !(0.75..1.35).contains(ratio)) else { continue };
        let evidence = format!("{what} {ratio:.3} times as fast as {name} says");
        let unit = SPEED_UNITS.iter().find(|(per, _)| near(1.0 / ratio, *per, 1.15));
        found.push(match unit {
            _ if ratio < 0.0 => record.finding(name, "wrong sign", evidence, format!("channels.{name}.negate = true")),
            Some((_, unit)) => record.finding(name, "wrong unit", evidence, format!("channels.{name}.unit = {unit:?}")),
            None => record.finding(
                name,
                "speed and position disagree",
                evidence,
                format!("check the units of {name}, x, y and time, or channels.{name}.scale = {ratio:.3}"),
            ),
        });
    }
    found
}

/// Returns how many times as fast as is said something moves, by the median over all but slow samples; `None` where there are
/// too few.
pub(crate) fn moving_ratio(moves: &[f64], said: &[f64]) -> Option<f64> {
    let top = said.iter().map(|v| v.abs()).fold(0.0, f64::max);
    let mut ratios: Vec<f64> =
        said.iter().zip(moves).filter(|(v, _)| v.abs() > 0.3 * top).map(|(v, r)| r / v).collect();
    (ratios.len() >= 40 && top >= 1e-3).then(|| ds_stats::quantile(&mut ratios, 0.5))
}

/// Tells whether the path leads elsewhere than the heading points.
pub(crate) fn leads_astray(record: &Record) -> bool {
    record.path().is_some_and(|path| !course(record, &path).is_empty())
}

/// The path must lead where the heading points.
fn course(record: &Record, speed: &[f64]) -> Vec<LogFinding> {
    let (Some(x), Some(y), Some(yaw)) = (record.channel("x"), record.channel("y"), record.channel("yaw")) else {
        return Vec::new();
    };
    let (dx, dy) = (slope(x, STEP_SECS), slope(y, STEP_SECS));
    let mut sizes: Vec<f64> = speed.iter().map(|v| v.abs()).collect();
    let least = SLOW * ds_stats::quantile(&mut sizes, 0.9);
    let fast: Vec<usize> = (0..yaw.len()).filter(|&k| dx[k].hypot(dy[k]) > least.max(0.05)).collect();
    let range =
        yaw.iter().copied().fold(f64::NEG_INFINITY, f64::max) - yaw.iter().copied().fold(f64::INFINITY, f64::min);
    if fast.len() < 40 {
        return Vec::new();
    }
    if range > 60.0 && record.secs() < 600.0 && degrees_fit(&fast, yaw, &dx, &dy) {
        let evidence = format!("yaw covers {range:.0} rad; as degrees it follows the path");
        return vec![record.finding("yaw", "degrees read as radians", evidence, "channels.yaw.unit = \"deg\"")];
    }
    // how closely course minus yaw (same sense of turning) and course plus yaw (opposite sense) keep one value
    let circle = |sense: f64| {
        let (mut sin, mut cos) = (0.0, 0.0);
        for &k in &fast {
            let angle = dy[k].atan2(dx[k]) - sense * yaw[k];
            sin += angle.sin();
            cos += angle.cos();
        }
        (f64::hypot(sin, cos) / fast.len() as f64, f64::atan2(sin, cos))
    };
    let ((same, offset), (opposite, sum)) = (circle(1.0), circle(-1.0));
    if opposite > 0.9 && opposite > same + 0.02 {
        let evidence = format!(
            "course plus yaw keeps {sum:.2} rad within {:.0} %, course minus yaw does not",
            100.0 * (1.0 - opposite)
        );
        let ned = (sum - std::f64::consts::FRAC_PI_2).abs() < 0.35;
        let proposal =
            if ned { "swap the columns of x and y" } else { "channels.y.negate = true, or channels.yaw.negate = true" };
        return vec![record.finding("yaw", "mirrored frame", evidence, proposal)];
    }
    if same > 0.9 && offset.abs() < 0.35 {
        return Vec::new();
    }
    let evidence =
        format!("the path leads {offset:.2} rad to the left of yaw (kept within {:.0} %)", 100.0 * (1.0 - same));
    if same > 0.9 {
        let proposal = if offset.abs() > 2.8 {
            "negate both x and y, or v: the vehicle would drive backwards".to_owned()
        } else {
            format!("channels.yaw.offset = {offset:.3}: yaw counts from another axis")
        };
        return vec![record.finding("yaw", "turned frame", evidence, proposal)];
    }
    vec![record.finding("yaw", "the path does not follow the heading", evidence, "check the columns of x, y and yaw")]
}

fn degrees_fit(fast: &[usize], yaw: &[f64], dx: &[f64], dy: &[f64]) -> bool {
    let (mut sin, mut cos) = (0.0, 0.0);
    for &k in fast {
        let angle = dy[k].atan2(dx[k]) - yaw[k].to_radians();
        sin += angle.sin();
        cos += angle.cos();
    }
    f64::hypot(sin, cos) / fast.len() as f64 > 0.8
}

/// Accelerometer and drive command must go with the change of speed.
fn forward(record: &Record, speed: &[f64]) -> Vec<LogFinding> {
    let mut found = Vec::new();
    let change = slope(speed, STEP_SECS);
    let own = |name: &str| record.channel(name).filter(|_| !record.derived.contains(&name));
    let spread = 0.15;
    if let Some(ax) = own("ax") {
        let along = relate(&change, ax, spread);
        let across = own("ay").and_then(|ay| relate(&change, ay, spread));
        let size = |r: Option<Relation>| r.map_or(0.0, |r| r.correlation.abs());
        if size(across) > 0.7 && size(along) < 0.4 {
            let evidence =
                format!("dv/dt goes with ay (r = {:.2}), not with ax (r = {:.2})", size(across), size(along));
            found.push(record.finding("ax", "ax and ay swapped", evidence, "swap the columns of ax and ay"));
        } else if let Some(relation) = along {
            found.extend(accelerometer(record, "ax", "dv/dt", relation));
        }
        let mean = ax.iter().sum::<f64>() / ax.len() as f64;
        if mean.abs() > 5.0 {
            let evidence = format!("its mean is {mean:.2} m/s2");
            found.push(record.finding("ax", "holds gravity", evidence, "map the forward axis, not the vertical one"));
        }
    }
    let command = own("cmd_accel").and_then(|c| relate(&change, c, spread)).filter(|r| r.correlation < -0.5);
    if let Some(relation) = command {
        let evidence = format!("it goes against dv/dt (r = {:.2})", relation.correlation);
        found.push(record.finding("cmd_accel", "wrong sign", evidence, "channels.cmd_accel.negate = true"));
    }
    found
}

/// Sign and unit of an accelerometer against the acceleration of the motion.
pub(super) fn accelerometer(record: &Record, name: &str, motion: &str, relation: Relation) -> Option<LogFinding> {
    let Relation { slope, correlation } = relation;
    let evidence = format!("{name} is {slope:.2} times {motion} (r = {correlation:.2})");
    if correlation < -0.6 {
        let why = "wrong sign, or gravity's reaction counted the other way";
        return Some(record.finding(name, why, evidence, format!("turn channels.{name}.negate")));
    }
    if correlation > 0.7 && near(slope, 1.0 / 9.81, 1.6) {
        return Some(record.finding(name, "wrong unit", evidence, format!("channels.{name}.unit = \"g\"")));
    }
    None
}
