//! What the car remembers: its commands over the drive, for effects with memory (delay, play, limits), and its last
//! moments, for what it records of itself.
//!
//! One entry per sub-step. The command chain is run over the whole memory at each tick, so that every operator is the
//! one that the gap diagnosis fits. Memory is cut to the last minute or so; nothing of the library looks back further.

use ds_effect::Law;
use ds_effect::chain::{Realised, realise};
use ds_effect::law::{Felt, Sources};
use ds_effect::plant::Plant;
use ds_effect::signal::Context;

/// Commands are cut from `LONGEST` to `KEPT` entries, moments from twice `RECENT` to `RECENT`.
const LONGEST: usize = 8000;
const KEPT: usize = 7000;
const RECENT: usize = 200;

/// The state of the car at the end of a sub-step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Moment {
    /// Centre of gravity, metres.
    pub(crate) x_m: f64,
    pub(crate) y_m: f64,
    /// Heading without wraps, radians.
    pub(crate) heading_rad: f64,
    /// Forward speed, m/s.
    pub(crate) speed_mps: f64,
    pub(crate) yaw_rate_radps: f64,
    /// Specific force in body axes, m/s².
    pub(crate) ax_mps2: f64,
    pub(crate) ay_mps2: f64,
    /// Steering angle at the actuator's sensor, radians.
    pub(crate) sensed_rad: f64,
    /// Drive and brake force over mass, m/s².
    pub(crate) drive_mps2: f64,
}

impl Moment {
    pub(crate) const FIELDS: usize = 9;

    /// Returns what the car feels; slip is not kept.
    pub(crate) fn felt(&self) -> Felt {
        let (v, ax, ay, yaw_rate) = (self.speed_mps, self.ax_mps2, self.ay_mps2, self.yaw_rate_radps);
        Felt { v, ax, ay, yaw_rate, ..Felt::default() }
    }

    pub(crate) fn to_array(self) -> [f64; Self::FIELDS] {
        let Self { x_m, y_m, heading_rad, speed_mps, yaw_rate_radps, ax_mps2, ay_mps2, sensed_rad, drive_mps2 } = self;
        [x_m, y_m, heading_rad, speed_mps, yaw_rate_radps, ax_mps2, ay_mps2, sensed_rad, drive_mps2]
    }

    pub(crate) fn from_array(fields: [f64; Self::FIELDS]) -> Self {
        let [x_m, y_m, heading_rad, speed_mps, yaw_rate_radps, ax_mps2, ay_mps2, sensed_rad, drive_mps2] = fields;
        Self { x_m, y_m, heading_rad, speed_mps, yaw_rate_radps, ax_mps2, ay_mps2, sensed_rad, drive_mps2 }
    }
}

/// A command of one sub-step and its companions.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Sent {
    /// Commanded road-wheel angle, radians.
    pub(crate) steer_rad: f64,
    /// Commanded force over nominal mass, m/s².
    pub(crate) accel_mps2: f64,
    /// Speed when it was sent, m/s.
    pub(crate) speed_mps: f64,
    /// Brake work since the start, MJ.
    pub(crate) brake_work_mj: f64,
}

/// The car's memory; empty where nothing needs it.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Past {
    pub(crate) sent: Vec<Sent>,
    pub(crate) moments: Vec<Moment>,
}

/// What the actuators make of the commands of one tick, one entry per sub-step.
pub(crate) struct Tick {
    pub(crate) steering: Realised,
    pub(crate) accel: Vec<f64>,
    /// What is known of each law's terms before the car moves; empty where that is 1.
    pub(crate) known: Known,
}

/// By law and term, one entry per sub-step.
pub(crate) type Known = Vec<Vec<Vec<f64>>>;

impl Past {
    /// Adds `count` commands that begin where the last one left off and steer at a rate; laws count time and way from the first
    /// one, so that with them all are `kept`.
    pub(crate) fn send(&mut self, count: u32, kept: bool, next: impl Fn(&Sent) -> Sent) {
        for _ in 0..count {
            let last = self.sent.last().copied().unwrap_or_default();
            self.sent.push(next(&last));
        }
        if self.sent.len() > LONGEST && !kept {
            self.sent.drain(..self.sent.len() - KEPT);
        }
    }

    /// Adds the end of a sub-step.
    pub(crate) fn witness(&mut self, moment: Moment) {
        self.moments.push(moment);
        if self.moments.len() > 2 * RECENT {
            self.moments.drain(..RECENT);
        }
    }

    /// Runs the chains of a plant over the memory and returns the last `count` sub-steps.
    pub(crate) fn realise(&self, plant: &Plant, step_secs: f64, count: u32) -> Tick {
        let column = |field: fn(&Sent) -> f64| -> Vec<f64> { self.sent.iter().map(field).collect() };
        let (speed, work) = (column(|sent| sent.speed_mps), column(|sent| sent.brake_work_mj));
        let context = Context { step_secs, speed_mps: &speed, brake_work_mj: &work };
        let tail = |mut signal: Vec<f64>| signal.split_off(signal.len().saturating_sub(count as usize));
        let (steering, traction) = (&plant.steering, &plant.traction);
        let steered = realise(&column(|sent| sent.steer_rad), steering.lag_secs, &steering.operators, &context);
        let driven = realise(&column(|sent| sent.accel_mps2), traction.lag_secs, &traction.operators, &context);
        let sources = Sources { step_secs, delta: &steered.wheel, accel: &driven.wheel, speed: &speed };
        let known = |law: &Law| law.known(&sources).into_iter().map(tail).collect();
        Tick {
            known: plant.laws.iter().map(known).collect(),
            steering: Realised { sensed: tail(steered.sensed), wheel: tail(steered.wheel) },
            accel: tail(driven.wheel),
        }
    }

    /// Returns the moment `ago` sub-steps before the last one, between two by interpolation.
    pub(crate) fn ago(&self, ago: f64) -> Moment {
        let Some(last) = self.moments.len().checked_sub(1) else { return Moment::default() };
        let at = (last as f64 - ago).clamp(0.0, last as f64);
        let low = at as usize;
        let (low, high, u) = (self.moments[low], self.moments[(low + 1).min(last)], at - low as f64);
        let (low, high) = (low.to_array(), high.to_array());
        Moment::from_array(std::array::from_fn(|i| low[i] + u * (high[i] - low[i])))
    }

    /// Returns the command `ago` sub-steps before the last one.
    pub(crate) fn sent_ago(&self, ago: f64) -> Sent {
        let Some(last) = self.sent.len().checked_sub(1) else { return Sent::default() };
        self.sent[(last as f64 - ago).round().clamp(0.0, last as f64) as usize]
    }
}
