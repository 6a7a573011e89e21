//! The reference stream: a log, or another drive under way, whose readings count as the real ones.

use std::path::Path;

use ds_record::{Recording, vehicle_log};
use ds_space::Tick;
use ds_topic::{Topic, World};
use ds_world::Reading;

use crate::error::CasesError;
use crate::window::SHORTEST_SECS;

/// Readings farther apart than this are not of one moment, s.
const SAME_MOMENT_SECS: f64 = 0.026;

/// A reference stream, as far as it is known.
pub struct Reference {
    /// Its name.
    pub name: String,
    /// All its readings so far, in order.
    readings: Vec<Reading>,
}

impl Reference {
    /// Reads a vehicle log, or a recording of a drive with one.
    ///
    /// # Errors
    /// If it is neither, or holds no readings.
    pub fn read(path: &Path) -> Result<Self, CasesError> {
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let readings = match vehicle_log::read(path) {
            Ok(log) => log.readings,
            Err(_foreign) => recorded(path)?,
        };
        if readings.is_empty() {
            return Err(CasesError::NoReadings { path: path.to_path_buf() });
        }
        Ok(Self { name, readings })
    }

    /// Begins with a drive under way.
    #[must_use]
    pub fn of_drive(name: &str) -> Self {
        Self { name: name.to_owned(), readings: Vec::new() }
    }

    /// Takes more readings; a tick that comes again begins another attempt.
    pub fn take(&mut self, tick: Tick, readings: Vec<Reading>) {
        if tick == Tick(0) {
            self.readings.clear();
        }
        let newest = self.readings.last().map_or(f64::NEG_INFINITY, |reading| reading.secs);
        self.readings.extend(readings.into_iter().filter(|reading| reading.secs > newest));
    }

    /// Returns up to when it is known, s.
    #[must_use]
    pub fn known_to_secs(&self) -> f64 {
        self.readings.last().map_or(f64::NEG_INFINITY, |reading| reading.secs)
    }

    /// Returns the readings of a span; `None` where there are too few.
    #[must_use]
    pub fn within(&self, from: f64, to: f64) -> Option<Vec<Reading>> {
        let inside = |reading: &&Reading| (from - 1e-6..=to + 1e-6).contains(&reading.secs);
        let readings: Vec<Reading> = self.readings.iter().filter(inside).copied().collect();
        let long = readings.last()?.secs - readings.first()?.secs >= SHORTEST_SECS - 0.5;
        long.then_some(readings)
    }
}

fn recorded(path: &Path) -> Result<Vec<Reading>, CasesError> {
    let recording = Recording::open(path)?;
    let mut readings = Vec::new();
    for envelope in recording.topic(Topic::World) {
        readings.extend(recording.body::<World>(envelope.header.slot)?.readings);
    }
    Ok(readings)
}

/// Returns the root mean square of running minus reference by channel over the moments that both have, SI units.
#[must_use]
pub fn differences(running: &[Reading], reference: &[Reading]) -> Vec<(String, f64)> {
    const CHANNELS: [&str; 8] = ["position", "yaw", "v", "yaw_rate", "ax", "ay", "steer_meas", "v_wheel"];
    let mut sums = [0.0; CHANNELS.len()];
    let mut count = 0_u32;
    for own in running {
        let after = reference.partition_point(|other| other.secs < own.secs);
        let near = [after.checked_sub(1), Some(after)].into_iter().flatten().filter_map(|k| reference.get(k));
        let nearest = near.min_by(|a, b| (a.secs - own.secs).abs().total_cmp(&(b.secs - own.secs).abs()));
        let Some(other) = nearest.filter(|other| (other.secs - own.secs).abs() <= SAME_MOMENT_SECS) else { continue };
        let turn = own.yaw_rad - other.yaw_rad;
        let apart = [
            (own.x_m - other.x_m).hypot(own.y_m - other.y_m),
            turn.sin().atan2(turn.cos()),
            own.speed_mps - other.speed_mps,
            own.yaw_rate_radps - other.yaw_rate_radps,
            own.ax_mps2 - other.ax_mps2,
            own.ay_mps2 - other.ay_mps2,
            own.steering_rad - other.steering_rad,
            own.wheel_speed_mps - other.wheel_speed_mps,
        ];
        sums.iter_mut().zip(apart).for_each(|(sum, value)| *sum += value * value);
        count += 1;
    }
    if count == 0 {
        return Vec::new();
    }
    let root = |(name, sum): (&&str, f64)| ((*name).to_owned(), (sum / f64::from(count)).sqrt());
    CHANNELS.iter().zip(sums).map(root).filter(|(_, rms)| rms.is_finite()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drive(shift_m: f64, from: u32, to: u32) -> Vec<Reading> {
        let reading = |k: u32| Reading {
            secs: f64::from(k) * 0.05,
            x_m: f64::from(k),
            y_m: shift_m,
            yaw_rad: if shift_m > 0.0 { 6.2 } else { -0.08 },
            ..Reading::default()
        };
        (from..to).map(reading).collect()
    }

    #[test]
    fn differences_are_taken_at_equal_moments() {
        let found = differences(&drive(0.0, 0, 100), &drive(0.3, 50, 200));
        let of = |name: &str| found.iter().find(|(channel, _)| channel == name).expect("a channel").1;
        assert!((of("position") - 0.3).abs() < 1e-9, "{found:?}");
        assert!(of("yaw") < 0.01 && of("v") == 0.0, "{found:?}");
        assert!(differences(&drive(0.0, 0, 10), &drive(0.0, 100, 110)).is_empty());
    }

    #[test]
    fn a_span_needs_enough_readings() {
        let reference = Reference { name: String::new(), readings: drive(0.0, 0, 300) };
        assert_eq!(reference.within(1.0, 9.0).map(|readings| readings.len()), Some(161));
        assert!(reference.within(12.0, 20.0).is_none());
        assert!((reference.known_to_secs() - 14.95).abs() < 1e-9);
    }
}
