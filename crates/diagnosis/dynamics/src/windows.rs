//! Cuts a drive into windows and compares the simulator with the log in each: the multi-step residuals.
//!
//! A window warms the simulator up for 0.5 s, anchors it to the measured pose and speed, then scores 2 s. Residuals
//! (measured minus simulated) are averaged over 0.25 s. Displacements are in the heading frame of the anchor.

use std::sync::Arc;

use ds_effect::law::Felt;
use ds_effect::plant::Vehicle;
use ds_effect::{Channel, Plant, Port};

use crate::drive::Drive;
use crate::ego::{Actuated, FINE_SECS, Inputs, Instant, Start, actuate, instant_at};
use crate::motion::{BuiltIn, Motion, Window};
use crate::smooth::{between, parabola};
use ds_diagnosis::table::STEP_SECS;

/// Ego channels, in the order of the residual vector.
pub const EGO: usize = 9;
/// Samples per block.
pub const BLOCK: usize = 5;
/// Blocks per window.
pub const BLOCKS: usize = 8;
/// Samples of warm-up.
const WARM: usize = 10;
/// Smallest change of the steering command within a sample interval that counts as a step, rad.
const STEER_STEP: f64 = 0.002;
/// The same for the requested acceleration, m/s².
const ACCEL_STEP: f64 = 0.1;
/// Share of it within one step of the fine grid from which on its instant is known.
const SHARP_SHARE: f64 = 0.5;
/// Samples between the starts of windows.
const STRIDE: usize = 25;
/// Speed below which the car drives backwards, which the simulator cannot, m/s.
const BACKWARDS_MPS: f64 = -0.1;

/// The part of a drive the ego simulator needs, with its windows.
#[derive(Clone)]
pub struct EgoRecord {
    /// Index of the drive in the case.
    pub drive: usize,
    /// Commands on the fine grid.
    pub inputs: Inputs,
    /// Starts of the scored part and what was measured there.
    pub anchors: Vec<Anchor>,
    log: Drive,
    speed: Vec<f64>,
    motion: Arc<dyn Motion>,
}

/// A window's anchor: the state the simulator is started from, and the measured blocks.
#[derive(Debug, Clone)]
pub struct Anchor {
    /// Sample of the anchor.
    pub sample: usize,
    /// Stamp of the anchor, s.
    pub secs: f64,
    /// Smoothed speed at the anchor, m/s.
    pub speed_mps: f64,
    /// Position in the world, m.
    pub position: (f64, f64),
    warm_speed_mps: f64,
    warm_yaw_rate: f64,
    heading_rad: f64,
    /// Measured block means, channel-major; NaN where the channel is absent.
    pub measured: Vec<f64>,
    /// What the window is like.
    pub regime: Regime,
}

/// What a sample is like, from the log alone.
#[derive(Debug, Clone, Copy, Default)]
pub struct Moment {
    /// Speed, m/s.
    pub speed_mps: f64,
    /// Yaw rate, rad/s.
    pub yaw_rate: f64,
    /// Commanded steering, rad.
    pub steer_rad: f64,
    /// Its rate, rad/s.
    pub steer_rate: f64,
    /// Commanded force over mass, m/s².
    pub accel_mps2: f64,
}

/// What a window is like, from the log alone.
#[derive(Debug, Clone, Copy, Default)]
pub struct Regime {
    /// Mean speed, m/s.
    pub speed_mps: f64,
    /// Mean commanded force over mass, m/s².
    pub accel_mps2: f64,
    /// Mean size of speed times yaw rate, m/s².
    pub lateral_mps2: f64,
    /// Largest demand on the tyres: lateral acceleration and commanded force over mass together, m/s².
    pub demand_mps2: f64,
    /// Root mean square rate of the commanded steering, rad/s.
    pub steer_rate: f64,
}

impl EgoRecord {
    /// Prepares a drive; `None` if no speed can be had from it.
    #[must_use]
    pub fn new(drive: usize, log: &Drive, mass_kg: f64) -> Option<Self> {
        let speed = log.speed()?;
        let fine = |signal: &[f64]| -> Vec<f64> {
            let count = ((log.samples - 1) as f64 * STEP_SECS / FINE_SECS).round() as usize + 1;
            (0..count).map(|k| between(signal, k as f64 * FINE_SECS / STEP_SECS)).collect()
        };
        let [steer, accel] = log.fine.clone().unwrap_or_else(|| [fine(&log.cmd_steer), fine(&log.cmd_accel)]);
        let fine_speed = fine(&speed);
        let mut work = 0.0;
        let brake_work = accel
            .iter()
            .zip(&fine_speed)
            .map(|(a, v)| {
                work += (-a).max(0.0) * mass_kg * v.max(0.0) * FINE_SECS * 1e-6;
                work
            })
            .collect();
        let inputs = Inputs { start_secs: log.start_secs, steer, accel, speed: fine_speed, brake_work };
        let mut record =
            Self { drive, inputs, anchors: Vec::new(), log: log.clone(), speed, motion: Arc::new(BuiltIn) };
        record.anchors = record.anchors_every(STRIDE, BLOCK * BLOCKS);
        Some(record)
    }

    /// Returns the inputs with every command step moved to the start (0.0) or the end (1.0) of the sample interval in
    /// which it happened, unless the log says when within it; `None` if no command steps so.
    #[must_use]
    pub fn stepped(&self, share: f64) -> Option<Inputs> {
        let mut inputs = self.inputs.clone();
        let steer = shift_steps(&self.log.cmd_steer, STEER_STEP, share, &mut inputs.steer);
        let accel = shift_steps(&self.log.cmd_accel, ACCEL_STEP, share, &mut inputs.accel);
        (steer || accel).then_some(inputs)
    }

    /// Returns anchors every `stride` samples with `scored` samples after each, but for windows in which the car drives
    /// backwards.
    #[must_use]
    pub fn anchors_every(&self, stride: usize, scored: usize) -> Vec<Anchor> {
        let forwards = |sample: &usize| {
            let mut window = self.speed[sample - WARM..sample + scored].chunks(BLOCK);
            window.all(|block| block.iter().sum::<f64>() >= BACKWARDS_MPS * block.len() as f64)
        };
        self.starts(stride, scored).filter(forwards).map(|sample| self.anchor(sample, scored)).collect()
    }

    fn starts(&self, stride: usize, scored: usize) -> impl Iterator<Item = usize> + use<> {
        (WARM..self.log.samples.saturating_sub(scored + 1)).step_by(stride)
    }

    /// Returns how many windows there would be if all were driven forwards.
    #[must_use]
    pub(crate) fn offered(&self) -> usize {
        self.starts(STRIDE, BLOCK * BLOCKS).count()
    }

    /// Returns the same drive in windows that share no sample.
    #[must_use]
    pub(crate) fn apart(&self) -> Self {
        let anchors = self.anchors_every(BLOCK * BLOCKS, BLOCK * BLOCKS);
        Self { anchors, ..self.clone() }
    }

    /// Returns the number of samples of the drive.
    #[must_use]
    pub fn samples(&self) -> usize {
        self.log.samples
    }

    /// Returns the stamp of a sample, s.
    #[must_use]
    pub fn secs(&self, sample: usize) -> f64 {
        self.log.start_secs + sample as f64 * STEP_SECS
    }

    /// Returns what a sample is like.
    #[must_use]
    pub fn moment(&self, sample: usize) -> Moment {
        let k = sample.min(self.log.samples - 1);
        let (before, after) = (k.saturating_sub(1), (k + 1).min(self.log.samples - 1));
        let rate =
            (self.log.cmd_steer[after] - self.log.cmd_steer[before]) / ((after - before).max(1) as f64 * STEP_SECS);
        Moment {
            speed_mps: self.speed[k],
            yaw_rate: self.yaw_rate_at(k),
            steer_rad: self.log.cmd_steer[k],
            steer_rate: rate,
            accel_mps2: self.log.cmd_accel[k],
        }
    }

    /// Returns what the car felt at a sample as far as the log tells: forces as its motion and its request need them, slip
    /// angles as in a steady turn of the nominal vehicle.
    #[must_use]
    pub fn felt(&self, sample: usize, vehicle: &Vehicle) -> Felt {
        let Moment { speed_mps, yaw_rate, accel_mps2, .. } = self.moment(sample);
        let ay = speed_mps * yaw_rate;
        let load_kg = vehicle.mass_kg / (vehicle.front_arm_m + vehicle.rear_arm_m);
        let [slip_front, slip_rear] = [
            load_kg * vehicle.rear_arm_m * ay / vehicle.front_stiffness_n,
            load_kg * vehicle.front_arm_m * ay / vehicle.rear_stiffness_n,
        ];
        Felt { v: speed_mps, ax: accel_mps2, ay, yaw_rate, slip_front, slip_rear, ..Felt::default() }
    }

    fn yaw_rate_at(&self, sample: usize) -> f64 {
        match (&self.log.yaw_rate, &self.log.yaw) {
            (Some(rate), _) => parabola(rate, sample, 4),
            (None, Some(yaw)) => {
                let (a, b) = (sample.saturating_sub(4), (sample + 4).min(yaw.len() - 1));
                (yaw[b] - yaw[a]) / ((b - a) as f64 * STEP_SECS)
            }
            (None, None) => 0.0,
        }
    }

    fn anchor(&self, sample: usize, scored: usize) -> Anchor {
        let log = &self.log;
        let speed_mps = parabola(&self.speed, sample, 7).max(0.0);
        let heading = log.yaw.as_ref().map(|yaw| parabola(yaw, sample, 5));
        let position = match (&log.x, &log.y) {
            (Some(x), Some(y)) => Some((parabola(x, sample, 4), parabola(y, sample, 4))),
            _ => None,
        };
        let blocks = scored / BLOCK;
        let mut measured = vec![f64::NAN; EGO * blocks];
        for channel in 0..EGO {
            for block in 0..blocks {
                let mut sum = 0.0;
                for k in 0..BLOCK {
                    sum += self.sample_of(channel, sample + 1 + block * BLOCK + k, heading, position);
                }
                measured[channel * blocks + block] = sum / BLOCK as f64;
            }
        }
        Anchor {
            sample,
            secs: self.secs(sample),
            speed_mps,
            position: position.unwrap_or((0.0, 0.0)),
            warm_speed_mps: parabola(&self.speed, sample - WARM, 7).max(0.0),
            warm_yaw_rate: self.yaw_rate_at(sample - WARM),
            heading_rad: heading.unwrap_or(0.0),
            measured,
            regime: self.regime(sample, scored),
        }
    }

    fn sample_of(&self, channel: usize, k: usize, heading: Option<f64>, position: Option<(f64, f64)>) -> f64 {
        let log = &self.log;
        let of = |column: &Option<Vec<f64>>| column.as_ref().map_or(f64::NAN, |c| c[k]);
        let displaced = || {
            let ((x0, y0), heading) = (position?, heading?);
            let (dx, dy) = (log.x.as_ref()?[k] - x0, log.y.as_ref()?[k] - y0);
            let (sin, cos) = heading.sin_cos();
            Some((dx * cos + dy * sin, dy * cos - dx * sin))
        };
        match Channel::ALL[channel] {
            Channel::Dx => displaced().map_or(f64::NAN, |d| d.0),
            Channel::Dy => displaced().map_or(f64::NAN, |d| d.1),
            Channel::Dyaw => heading.map_or(f64::NAN, |h| of(&log.yaw) - h),
            Channel::Speed => of(&log.v),
            Channel::YawRate => of(&log.yaw_rate),
            Channel::Ax => of(&log.ax),
            Channel::Ay => of(&log.ay),
            Channel::SteerMeas => of(&log.steer_meas),
            Channel::WheelSpeed => of(&log.v_wheel),
            Channel::FollowerSpeed | Channel::FollowerGap | Channel::AgentLateral | Channel::AgentDecision => f64::NAN,
        }
    }

    fn regime(&self, sample: usize, scored: usize) -> Regime {
        let range = sample..(sample + scored).min(self.log.samples - 1);
        let count = range.len().max(1) as f64;
        let mean = |f: &dyn Fn(usize) -> f64| range.clone().map(f).sum::<f64>() / count;
        let steer = &self.log.cmd_steer;
        let lateral = |k: usize| self.log.yaw_rate.as_ref().map_or(0.0, |r| (r[k] * self.speed[k]).abs());
        Regime {
            speed_mps: mean(&|k| self.speed[k]),
            accel_mps2: mean(&|k| self.log.cmd_accel[k]),
            lateral_mps2: mean(&lateral),
            demand_mps2: range.clone().map(|k| lateral(k).hypot(self.log.cmd_accel[k])).fold(0.0, f64::max),
            steer_rate: mean(&|k| ((steer[k + 1] - steer[k]) / STEP_SECS).powi(2)).sqrt(),
        }
    }

    /// Returns the age of a pose sample stamped `secs`, s.
    fn age(&self, plant: &Plant, secs: f64) -> f64 {
        plant.clock.pose_latency_secs + plant.clock.pose_drift * (secs - self.log.start_secs)
    }

    fn start(&self, anchor: &Anchor, plant: &Plant) -> Start {
        let lead = self.age(plant, anchor.secs);
        let warm_secs = WARM as f64 * STEP_SECS;
        Start {
            secs: anchor.secs - lead - warm_secs,
            speed_mps: anchor.warm_speed_mps,
            yaw_rate: anchor.warm_yaw_rate,
            heading_rad: anchor.heading_rad,
            warm_secs,
            anchor_speed_mps: anchor.speed_mps,
            horizon_secs: (anchor.measured.len() / EGO * BLOCK) as f64 * STEP_SECS + lead.max(0.0) + 0.02,
        }
    }

    /// Drives the simulator through some windows; what sensors report of it comes later.
    #[must_use]
    pub fn roll(&self, anchors: &[Anchor], actuated: &Actuated, plant: &Plant) -> Vec<Vec<Instant>> {
        let windows: Vec<Window> = anchors.iter().map(|anchor| self.window(anchor, plant)).collect();
        self.motion.roll(&windows, actuated, plant)
    }

    /// Returns a window as the simulator is to drive it.
    #[must_use]
    pub fn window(&self, anchor: &Anchor, plant: &Plant) -> Window {
        Window { drive: self.drive, sample: anchor.sample, start: self.start(anchor, plant) }
    }

    /// Has the windows driven by another simulator than the built-in one.
    pub fn move_by(&mut self, motion: Arc<dyn Motion>) {
        self.motion = motion;
    }

    /// Returns the residuals of some windows when the simulator is given some inputs.
    #[must_use]
    pub fn windows(&self, anchors: &[Anchor], inputs: &Inputs, plant: &Plant) -> Vec<Vec<f64>> {
        let actuated = actuate(inputs, plant);
        self.compared(anchors, &self.roll(anchors, &actuated, plant), &actuated, plant)
    }

    /// Returns the residuals of some windows for what is reported: the simulator is run for each.
    #[must_use]
    pub fn measured(&self, anchors: &[Anchor], inputs: &Inputs, plant: &Plant) -> Vec<Vec<f64>> {
        let actuated = actuate(inputs, plant);
        let windows: Vec<Window> = anchors.iter().map(|anchor| self.window(anchor, plant)).collect();
        self.compared(anchors, &self.motion.measure(&windows, &actuated, plant), &actuated, plant)
    }

    /// Returns some of the anchors, evenly, as many as the simulator can be measured on.
    #[must_use]
    pub fn measurable(&self, anchors: Vec<Anchor>) -> Vec<Anchor> {
        let every = anchors.len().div_ceil(self.motion.measurable()).max(1);
        anchors.into_iter().step_by(every).collect()
    }

    fn compared(
        &self,
        anchors: &[Anchor],
        rolled: &[Vec<Instant>],
        actuated: &Actuated,
        plant: &Plant,
    ) -> Vec<Vec<f64>> {
        anchors.iter().zip(rolled).map(|(anchor, r)| self.residual(anchor, r, actuated, plant)).collect()
    }

    /// Returns the residuals of all windows of this drive, one after another.
    #[must_use]
    pub fn residuals(&self, plant: &Plant) -> Vec<f64> {
        self.windows(&self.anchors, &self.inputs, plant).concat()
    }

    /// Returns measured minus simulated block means of one window, channel-major, NaN where the channel is absent.
    #[must_use]
    pub fn residual(&self, anchor: &Anchor, rollout: &[Instant], actuated: &Actuated, plant: &Plant) -> Vec<f64> {
        let blocks = anchor.measured.len() / EGO;
        let begin = self.start(anchor, plant).secs;
        let mut residual = anchor.measured.clone();
        let share = 1.0 / BLOCK as f64;
        for k in 0..blocks * BLOCK {
            let secs = anchor.secs + (k + 1) as f64 * STEP_SECS;
            let mut simulated = sense(secs, begin, self.age(plant, secs), rollout, actuated, plant);
            if !plant.laws.is_empty() {
                let at = |secs: f64| shifted(secs - self.age(plant, secs), begin, rollout, actuated, plant);
                let ([x0, y0], [x, y]) = (at(anchor.secs), at(secs));
                let (sin, cos) = anchor.heading_rad.sin_cos();
                simulated[0] += (x - x0) * cos + (y - y0) * sin;
                simulated[1] += (y - y0) * cos - (x - x0) * sin;
            }
            for (channel, value) in simulated.into_iter().enumerate() {
                residual[channel * blocks + k / BLOCK] -= share * value;
            }
        }
        residual
    }
}

/// Says which share of the windows is left out because the car drives backwards in them.
pub(crate) fn backwards(ego: &[EgoRecord]) -> Option<String> {
    let (offered, kept) = ego.iter().fold((0, 0), |(all, kept), r| (all + r.offered(), kept + r.anchors.len()));
    let percent = 100.0 * (offered - kept) as f64 / offered.max(1) as f64;
    (kept < offered).then(|| {
        format!(
            "{percent:.0} % of the windows are left out: the car drives backwards there, which the simulator cannot"
        )
    })
}

/// Replaces the ramps of a command's steps on the fine grid by steps at a share of their interval; tells if there were any. A
/// step that is one on the fine grid stays.
fn shift_steps(command: &[f64], least: f64, share: f64, fine: &mut [f64]) -> bool {
    let change = |k: usize| if k + 1 < command.len() { (command[k + 1] - command[k]).abs() } else { 0.0 };
    let per_sample = (STEP_SECS / FINE_SECS).round() as usize;
    let mut any = false;
    for k in 1..command.len().saturating_sub(1) {
        let ramp = &fine[k * per_sample..=(k + 1) * per_sample];
        let sharp = ramp.windows(2).any(|pair| (pair[1] - pair[0]).abs() > SHARP_SHARE * change(k));
        if !sharp && change(k) > least + 2.0 * (change(k - 1) + change(k + 1)) {
            any = true;
            for j in 1..per_sample {
                let after = j as f64 >= share * per_sample as f64;
                fine[k * per_sample + j] = command[if after { k + 1 } else { k }];
            }
        }
    }
    any
}

/// Returns what laws add to a position at a time, east and north, m.
fn shifted(secs: f64, begin: f64, rollout: &[Instant], actuated: &Actuated, plant: &Plant) -> [f64; 2] {
    let felt = instant_at(rollout, begin, secs).felt();
    let added = |channel| actuated.added(&plant.laws, secs, &felt, |port| port == Port::Sensor(channel));
    [added(Channel::Dx), added(Channel::Dy)]
}

/// Returns what the simulated sensors report for the sample stamped `secs`, of a rollout that began at `start_secs` and
/// with poses of age `age`.
#[must_use]
pub fn sense(
    secs: f64,
    start_secs: f64,
    age: f64,
    rollout: &[Instant],
    actuated: &Actuated,
    plant: &Plant,
) -> [f64; EGO] {
    let sensors = &plant.sensors;
    let pose = instant_at(rollout, start_secs, secs - age);
    let imu = instant_at(rollout, start_secs, secs - plant.clock.imu_latency_secs);
    let wheel = instant_at(rollout, start_secs, secs - plant.clock.wheel_latency_secs);
    let (sin, cos) = pose.yaw.sin_cos();
    let ay = imu.ay * sensors.roll_factor;
    let (turn_sin, turn_cos) = sensors.misalignment_rad.sin_cos();
    let mut readings = [
        pose.x + sensors.lever_arm_m * (cos - 1.0),
        pose.y + sensors.lever_arm_m * sin,
        pose.yaw,
        pose.v,
        imu.yaw_rate * sensors.gyro_factor + sensors.gyro_bias_rad_s,
        imu.ax * turn_cos + ay * turn_sin + sensors.ax_bias_mps2,
        ay * turn_cos - imu.ax * turn_sin + sensors.ay_bias_mps2,
        actuated.sensed(secs - plant.clock.encoder_latency_secs),
        wheel.v * sensors.wheel_factor * (1.0 + sensors.wheel_slip_s2_m * wheel.ax),
    ];
    if !plant.laws.is_empty() {
        let moments = [
            (2..4, secs - age, pose),
            (4..7, secs - plant.clock.imu_latency_secs, imu),
            (7..8, secs - plant.clock.encoder_latency_secs, imu),
            (8..9, secs - plant.clock.wheel_latency_secs, wheel),
        ];
        for (channels, at, instant) in moments {
            let felt = instant.felt();
            for channel in channels {
                let own = Port::Sensor(Channel::ALL[channel]);
                let seen = Channel::ALL[channel] == Channel::SteerMeas;
                let here = |port: Port| port == own || (seen && port == Port::Steering);
                readings[channel] += actuated.added(&plant.laws, at, &felt, here);
            }
        }
    }
    readings
}
