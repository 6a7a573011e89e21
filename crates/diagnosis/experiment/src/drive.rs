//! One drive of a manoeuvre: commands through actuators, car and sensors to what a log would hold.

use ds_diagnosis::meta::DriveEntry;
use ds_diagnosis::table::{STEP_SECS, Table};
use ds_diagnosis::{CaseError, meta::Nominal};
use ds_dynamics::case::Case;
use ds_dynamics::drive::{Drive, MEASURED};
use ds_dynamics::ego::{Actuated, FINE_SECS, Inputs, Instant, Start, actuate};
use ds_dynamics::motion::{Motion, Window};
use ds_dynamics::settings::SENSOR_NOISE;
use ds_dynamics::smooth::between;
use ds_dynamics::windows::{EGO, sense};
use ds_effect::Plant;
use ds_space::Draws;

use crate::design::{Design, SECS};

/// Spare time at both ends of a log, for samples that are late, s.
const SPARE_SECS: f64 = 0.5;

/// What stands for reality: who moves the car, and the effects that act.
pub struct World<'a> {
    /// Moves the car.
    pub motion: &'a dyn Motion,
    /// Everything else: command path, actuators, sensors, clocks; vehicle and road as far as the motion takes them.
    pub plant: &'a Plant,
}

/// A manoeuvre as it was driven.
pub struct Driven {
    /// The car, one instant a step of the built-in car.
    pub instants: Vec<Instant>,
    /// What sensors report on the grid of logs, in the order of the channels.
    pub readings: Vec<[f64; EGO]>,
    /// Stamps of those, s.
    pub stamps: Vec<f64>,
    inputs: Inputs,
    heading_rad: f64,
}

impl World<'_> {
    /// Drives a manoeuvre; `draws` scatter the sampling instants by the world's jitter. `None` where the motion is not finite.
    #[must_use]
    pub fn drive(&self, design: &Design, nominal: &Nominal, draws: Option<&Draws>) -> Option<Driven> {
        let (inputs, plant) = (design.inputs(nominal), self.plant);
        let actuated = actuate(&inputs, plant);
        let speed_mps = design.speed_mps();
        let start = Start {
            secs: 0.0,
            speed_mps,
            yaw_rate: 0.0,
            heading_rad: design.heading_rad(),
            warm_secs: 0.0,
            anchor_speed_mps: speed_mps,
            horizon_secs: SECS,
        };
        let instants = self.motion.roll(&[Window { drive: 0, sample: 0, start }], &actuated, plant).pop()?;
        let moves = |i: &Instant| [i.x, i.y, i.yaw, i.v, i.yaw_rate, i.ax, i.ay].iter().all(|value| value.is_finite());
        if instants.len() < 2 || !instants.iter().all(moves) {
            return None;
        }
        let count = ((SECS - 2.0 * SPARE_SECS) / STEP_SECS).round() as usize + 1;
        let stamps: Vec<f64> = (0..count).map(|k| SPARE_SECS + k as f64 * STEP_SECS).collect();
        let jitter = |k: usize| draws.map_or(0.0, |d| plant.clock.jitter_secs * d.normal(k as u64));
        let of = |(k, secs): (usize, &f64)| readings(*secs, jitter(k), &instants, &actuated, plant);
        let readings = stamps.iter().enumerate().map(of).collect();
        Some(Driven { instants, readings, stamps, inputs, heading_rad: design.heading_rad() })
    }
}

fn readings(stamp: f64, late: f64, instants: &[Instant], actuated: &Actuated, plant: &Plant) -> [f64; EGO] {
    let age = plant.clock.pose_latency_secs + plant.clock.pose_drift * (stamp - SPARE_SECS);
    let mut found = sense(stamp + late, 0.0, age, instants, actuated, plant);
    found[0] += plant.sensors.lever_arm_m;
    found
}

impl Driven {
    /// Returns the log as a table, with the noise of a case's sensors where draws are given; channels that the case lacks
    /// are left out.
    ///
    /// # Errors
    /// If a value is not finite.
    pub fn table(&self, file: &str, case: &Case, noise: Option<&Draws>) -> Result<Table, CaseError> {
        let command = |signal: &[f64]| self.stamps.iter().map(|t| between(signal, t / FINE_SECS)).collect::<Vec<f64>>();
        let mut columns = vec![
            ("t".to_owned(), self.stamps.clone()),
            ("cmd_steer".to_owned(), command(&self.inputs.steer)),
            ("cmd_accel".to_owned(), command(&self.inputs.accel)),
        ];
        let present: Vec<&str> = case.drives[0].columns().iter().map(|column| column.0).collect();
        let (sin, cos) = self.heading_rad.sin_cos();
        for (channel, name) in MEASURED.iter().enumerate().filter(|(_, name)| present.contains(*name)) {
            let sd = SENSOR_NOISE[channel] * case.noise.ego[channel];
            let value = |(k, r): (usize, &[f64; EGO])| {
                let truth = match channel {
                    0 => r[0] * cos - r[1] * sin,
                    1 => r[0] * sin + r[1] * cos,
                    2 => r[2] + self.heading_rad,
                    _ => r[channel],
                };
                truth + noise.map_or(0.0, |d| sd * d.normal(((k + 1) * EGO + channel) as u64))
            };
            columns.push(((*name).to_owned(), self.readings.iter().enumerate().map(value).collect()));
        }
        Table::new(file, columns)
    }

    /// Returns the log as a drive of a case.
    ///
    /// # Errors
    /// If it cannot be one.
    pub fn log(&self, file: &str, case: &Case, noise: Option<&Draws>) -> Result<Drive, CaseError> {
        let entry = DriveEntry { file: file.to_owned(), ..DriveEntry::default() };
        Drive::new(&self.table(file, case, noise)?, None, &entry)
    }
}
