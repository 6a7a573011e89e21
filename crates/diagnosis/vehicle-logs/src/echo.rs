//! Finds a measurement that calls itself a command: it equals a sensor up to scale and offset without any delay.
//!
//! An actuator never follows its command at once and without noise. Such a column says what the vehicle did, so that every
//! actuator of the diagnosis would look perfect. A delay of a few milliseconds leaves more than the two may differ by.

use crate::finding::LogFinding;
use crate::log::{Log, Series};

/// What is left of the sensor after scale and offset, as a share of its spread, below which the two are one signal.
const SAME: f64 = 0.002;
/// Fewest samples of a command that tell.
const LEAST: usize = 50;
/// Commands and the sensors that could be logged in their place.
const PAIRS: [(&str, &str); 2] = [("cmd_steer", "steer_meas"), ("cmd_accel", "ax")];

/// Returns an echo for every command that is one.
pub(crate) fn findings(log: &Log) -> Vec<LogFinding> {
    let echoes = PAIRS.iter().filter_map(|(command, sensor)| {
        let left = left(log.series.get(command)?, log.series.get(sensor)?).filter(|left| *left < SAME)?;
        Some(LogFinding {
            file: log.file.clone(),
            channel: (*command).to_owned(),
            problem: "echo of a measurement".to_owned(),
            evidence: format!(
                "it is {sensor} up to scale and offset, to {:.2} % and without delay: no actuator does that",
                100.0 * left
            ),
            proposal: format!(
                "map the command that was sent, or leave channels.{sensor} out if this vehicle's actuators are ideal"
            ),
        })
    });
    echoes.collect()
}

/// Returns what is left of a sensor after a command of the same moments, as a share of its spread.
fn left(command: &Series, sensor: &Series) -> Option<f64> {
    let known: Vec<usize> = (0..sensor.t.len()).filter(|k| sensor.values[*k].is_finite()).collect();
    let at = |t: f64| -> Option<f64> {
        let next = known.partition_point(|k| sensor.t[*k] < t);
        let high = *known.get(next)?;
        let low = known[if sensor.t[high] > t { next.checked_sub(1)? } else { next }];
        let share = if high == low { 0.0 } else { (t - sensor.t[low]) / (sensor.t[high] - sensor.t[low]) };
        Some(sensor.values[low] + share * (sensor.values[high] - sensor.values[low]))
    };
    let sent = command.t.iter().zip(&command.values).filter(|(_, value)| value.is_finite());
    let pairs: Vec<(f64, f64)> = sent.filter_map(|(t, value)| Some((*value, at(*t)?))).collect();
    let count = pairs.len() as f64;
    let (ma, mb) = (pairs.iter().map(|p| p.0).sum::<f64>() / count, pairs.iter().map(|p| p.1).sum::<f64>() / count);
    let (mut cross, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for (a, b) in &pairs {
        cross += (a - ma) * (b - mb);
        aa += (a - ma).powi(2);
        bb += (b - mb).powi(2);
    }
    let telling = pairs.len() >= LEAST && aa > 1e-9 * count && bb > 1e-9 * count;
    telling.then(|| (1.0 - cross * cross / (aa * bb)).max(0.0).sqrt())
}
