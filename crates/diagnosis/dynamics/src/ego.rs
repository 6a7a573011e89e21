//! The nominal simulator of the ego vehicle: a single track at 20 ms steps behind its command and actuator chains.
//!
//! Forces are those of `ds_vehicle`, which the running simulator steps too. Here slip, side force and yaw are integrated by the
//! implicit midpoint rule with the secant stiffness of the axle and slip angles linear in the speed across (stable down to
//! standstill, and quick: a fit takes thousands of rollouts). SI units, x forward, y left.

use ds_effect::chain::realise;
pub use ds_effect::law::Push;
use ds_effect::law::{Felt, Law, Port, Sources};
use ds_effect::plant::{Plant, Vehicle};
use ds_effect::signal::Context;
use ds_vehicle::{GRAVITY_MPS2, Saturation, air_n, axles, built_share, held, rolling_mps2, slope_mps2};

use crate::smooth::between;

/// Step of the actuator grid, s.
pub const FINE_SECS: f64 = 0.01;
/// Step of the vehicle's integration, s; at half of it the estimate of a practice case (04) was the same.
pub const ROLL_SECS: f64 = 0.02;
/// Below this speed slip angles are computed as if at this speed, m/s.
const SLOWEST_MPS: f64 = 0.5;

/// Commands and companions of a drive on the fine grid.
#[derive(Debug, Clone)]
pub struct Inputs {
    /// Time of the first sample, s.
    pub start_secs: f64,
    /// Commanded road-wheel angle, rad.
    pub steer: Vec<f64>,
    /// Commanded force over nominal mass, m/s².
    pub accel: Vec<f64>,
    /// Measured speed, m/s.
    pub speed: Vec<f64>,
    /// Brake work since the start, MJ.
    pub brake_work: Vec<f64>,
}

/// What the actuators make of the commands, on the fine grid.
pub struct Actuated {
    start_secs: f64,
    /// Steering angle at the road wheel, rad.
    pub wheel: Vec<f64>,
    /// Steering angle at the position sensor, rad.
    pub sensor: Vec<f64>,
    /// Realised force over nominal mass, m/s².
    pub accel: Vec<f64>,
    /// What is known of each law's terms before the car moves.
    known: Vec<Vec<Vec<f64>>>,
}

impl Actuated {
    fn at(&self, signal: &[f64], secs: f64) -> f64 {
        between(signal, (secs - self.start_secs) / FINE_SECS)
    }

    /// Returns the steering angle of the wheels, rad, and the force over nominal mass, m/s², at a time.
    #[must_use]
    pub fn asked(&self, secs: f64) -> (f64, f64) {
        (self.at(&self.wheel, secs), self.at(&self.accel, secs))
    }

    /// Returns what the laws of some ports add at a time to a car that feels what it feels; the laws are those of the plant
    /// that was actuated.
    #[must_use]
    pub fn added(&self, laws: &[Law], secs: f64, felt: &Felt, of: impl Fn(Port) -> bool) -> f64 {
        let here = laws.iter().zip(&self.known).filter(|(law, _)| of(law.port()));
        let term = |known: &Vec<f64>| if known.is_empty() { 1.0 } else { self.at(known, secs) };
        here.map(|(law, known)| law.at(|k| term(&known[k]), felt)).sum()
    }

    /// Returns what steers and drives the car at a time (rad of the wheels, m/s² over nominal mass), and what else pushes it:
    /// the laws of the plant that was actuated, added for a car that feels what it feels.
    #[must_use]
    pub fn pushed(&self, secs: f64, felt: &Felt, plant: &Plant) -> ((f64, f64), Push) {
        let (steer, accel) = self.asked(secs);
        if plant.laws.is_empty() {
            return ((steer, accel), Push::default());
        }
        let added = |port: Port| self.added(&plant.laws, secs, felt, |own| own == port);
        let push = Push::of([plant.vehicle.front_arm_m, plant.vehicle.rear_arm_m], added);
        ((steer + added(Port::Steering) + added(Port::Linkage), accel), push)
    }

    /// Returns the steering angle at the position sensor at a time, rad.
    #[must_use]
    pub fn sensed(&self, secs: f64) -> f64 {
        self.at(&self.sensor, secs)
    }
}

/// Runs the command paths and actuators over a whole drive.
#[must_use]
pub fn actuate(inputs: &Inputs, plant: &Plant) -> Actuated {
    let context = Context { step_secs: FINE_SECS, speed_mps: &inputs.speed, brake_work_mj: &inputs.brake_work };
    let steered = realise(&inputs.steer, plant.steering.lag_secs, &plant.steering.operators, &context);
    let driven = realise(&inputs.accel, plant.traction.lag_secs, &plant.traction.operators, &context);
    let step_secs = FINE_SECS;
    let sources = Sources { step_secs, delta: &steered.wheel, accel: &driven.wheel, speed: &inputs.speed };
    let known = plant.laws.iter().map(|law| law.known(&sources)).collect();
    Actuated { start_secs: inputs.start_secs, wheel: steered.wheel, sensor: steered.sensed, accel: driven.wheel, known }
}

/// Where a rollout starts and how long it lasts.
#[derive(Debug, Clone, Copy)]
pub struct Start {
    /// True time of the warm-up's start, s.
    pub secs: f64,
    /// Speed there, m/s.
    pub speed_mps: f64,
    /// Yaw rate there, rad/s.
    pub yaw_rate: f64,
    /// Heading of the anchor in the world, rad.
    pub heading_rad: f64,
    /// Duration of the warm-up, s; at its end pose is zeroed and speed reset.
    pub warm_secs: f64,
    /// Speed at the anchor, m/s.
    pub anchor_speed_mps: f64,
    /// Duration after the anchor, s.
    pub horizon_secs: f64,
}

/// One instant of a rollout; pose relative to the anchor.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Instant {
    /// Ahead of the anchor, m.
    pub x: f64,
    /// Left of the anchor, m.
    pub y: f64,
    /// Heading change, rad.
    pub yaw: f64,
    /// Longitudinal speed, m/s.
    pub v: f64,
    /// Yaw rate, rad/s.
    pub yaw_rate: f64,
    /// Forward specific force, m/s².
    pub ax: f64,
    /// Left specific force, m/s².
    pub ay: f64,
}

impl Instant {
    fn mix(&self, other: &Self, u: f64) -> Self {
        let m = |a: f64, b: f64| a + u * (b - a);
        Self {
            x: m(self.x, other.x),
            y: m(self.y, other.y),
            yaw: m(self.yaw, other.yaw),
            v: m(self.v, other.v),
            yaw_rate: m(self.yaw_rate, other.yaw_rate),
            ax: m(self.ax, other.ax),
            ay: m(self.ay, other.ay),
        }
    }
}

impl Instant {
    /// Returns what the car feels; slip is not recorded.
    pub(crate) fn felt(&self) -> Felt {
        Felt { v: self.v, ax: self.ax, ay: self.ay, yaw_rate: self.yaw_rate, ..Felt::default() }
    }
}

/// Returns the instant at `secs` of a rollout that began at `start_secs`.
#[must_use]
pub fn instant_at(rollout: &[Instant], start_secs: f64, secs: f64) -> Instant {
    let at = ((secs - start_secs) / ROLL_SECS).clamp(0.0, (rollout.len() - 1) as f64);
    let low = at as usize;
    let high = (low + 1).min(rollout.len() - 1);
    rollout[low].mix(&rollout[high], at - low as f64)
}

/// How a car moves in its own frame.
#[derive(Debug, Clone, Copy)]
pub struct State {
    /// Forward, m/s.
    pub vx: f64,
    /// To the left, m/s.
    pub vy: f64,
    /// rad/s.
    pub yaw_rate: f64,
    /// Slip angle that the front tyres have built up, rad.
    pub slip_front: f64,
    /// The same of the rear tyres, rad.
    pub slip_rear: f64,
}

/// The built-in car between two steps.
#[derive(Debug, Clone, Copy)]
pub struct Car {
    /// Ahead and left of the last mark, m, and heading since then, rad.
    pub pose: (f64, f64, f64),
    /// Its motion.
    pub state: State,
    /// Sine and cosine of the heading at the mark, and now.
    mark: (f64, f64),
    heading: (f64, f64),
}

impl Car {
    /// Returns a car in steady motion.
    #[must_use]
    pub fn steady(vehicle: &Vehicle, speed_mps: f64, yaw_rate: f64, heading_rad: f64) -> Self {
        let mark = heading_rad.sin_cos();
        Self { pose: (0.0, 0.0, 0.0), state: steady(vehicle, speed_mps, yaw_rate), mark, heading: mark }
    }

    /// Returns what it feels, with the specific force of the last step, m/s².
    #[must_use]
    pub fn felt(&self, ax: f64, ay: f64) -> Felt {
        let State { vx, yaw_rate, slip_front, slip_rear, .. } = self.state;
        Felt { v: vx, ax, ay, yaw_rate, slip_front, slip_rear, ..Felt::default() }
    }

    /// Moves on by one step with the inputs of its middle and returns the instant at its start; accelerations are those
    /// of the step.
    pub fn step(&mut self, steer: f64, accel: f64, push: &Push, plant: &Plant, saturation: &Saturation) -> Instant {
        let (next, ax, ay) = advance(&self.state, steer, accel, push, self.heading, saturation, plant);
        let (state, pose) = (&self.state, &mut self.pose);
        let instant = Instant { x: pose.0, y: pose.1, yaw: pose.2, v: state.vx, yaw_rate: state.yaw_rate, ax, ay };
        let yaw = pose.2 + 0.5 * ROLL_SECS * (state.yaw_rate + next.yaw_rate);
        let (sin, cos) = (0.5 * (pose.2 + yaw)).sin_cos();
        let (vx, vy) = (0.5 * (state.vx + next.vx), 0.5 * (state.vy + next.vy));
        pose.0 += ROLL_SECS * (vx * cos - vy * sin);
        pose.1 += ROLL_SECS * (vx * sin + vy * cos);
        pose.2 = yaw;
        self.state = next;
        self.heading = (self.mark.0 * cos + self.mark.1 * sin, self.mark.1 * cos - self.mark.0 * sin);
        instant
    }
}

/// Integrates one rollout, one instant per step from the start of the warm-up; `saturation` is that of the plant.
#[must_use]
pub fn rollout(start: &Start, actuated: &Actuated, plant: &Plant, saturation: &Saturation) -> Vec<Instant> {
    let mut car = Car::steady(&plant.vehicle, start.speed_mps, start.yaw_rate, start.heading_rad);
    let warm = (start.warm_secs / ROLL_SECS).round() as usize;
    let steps = warm + (start.horizon_secs / ROLL_SECS).ceil() as usize;
    let mut out = Vec::with_capacity(steps + 1);
    let mut force = (0.0, start.speed_mps * start.yaw_rate);
    for step in 0..=steps {
        if step == warm {
            car.pose = (0.0, 0.0, 0.0);
            car.state.vx = start.anchor_speed_mps;
        }
        let middle = start.secs + (step as f64 + 0.5) * ROLL_SECS;
        let (asked, push) = actuated.pushed(middle, &car.felt(force.0, force.1), plant);
        let instant = car.step(asked.0, asked.1, &push, plant, saturation);
        force = (instant.ax, instant.ay);
        out.push(instant);
        if step < warm {
            car.heading = car.mark;
        }
    }
    out
}

fn steady(vehicle: &Vehicle, speed: f64, yaw_rate: f64) -> State {
    let v = speed.max(SLOWEST_MPS);
    let base = vehicle.front_arm_m + vehicle.rear_arm_m;
    let side = vehicle.mass_kg * v * yaw_rate;
    let slip_rear = side * vehicle.front_arm_m / base / vehicle.rear_stiffness_n;
    let slip_front = side * vehicle.rear_arm_m / base / vehicle.front_stiffness_n;
    State { vx: speed, vy: vehicle.rear_arm_m * yaw_rate - v * slip_rear, yaw_rate, slip_front, slip_rear }
}

/// Returns the state one step later and the specific force in between.
fn advance(
    state: &State,
    steer: f64,
    accel: f64,
    push: &Push,
    heading: (f64, f64),
    saturation: &Saturation,
    plant: &Plant,
) -> (State, f64, f64) {
    let vehicle = &plant.vehicle;
    let [drag, side_wind] = air_n(vehicle, &plant.road, state.vx, heading.0, heading.1);
    let half = 0.5 * ROLL_SECS;
    let v = state.vx.max(SLOWEST_MPS);
    let (a, b) = (vehicle.front_arm_m, vehicle.rear_arm_m);
    let weight_n = vehicle.mass_kg * GRAVITY_MPS2;
    let traction =
        held(vehicle.nominal_mass_kg * accel, vehicle.friction, weight_n) + vehicle.nominal_mass_kg * push.drive_mps2;
    let [front, rear] = axles(vehicle, accel);
    let [build, build_step] = [half, ROLL_SECS].map(|secs| built_share(vehicle.relaxation_m, v, secs));
    let (cf, cr) = (front.secant_n(state.slip_front, saturation), rear.secant_n(state.slip_rear, saturation));
    let (sin, cos) = steer.sin_cos();
    // F = c (slip (1 - build) + build (slip in steady state)); steady slip is linear in (vy, yaw rate) at the midpoint
    let f0 = cf * (state.slip_front * (1.0 - build) + build * steer) + push.front_n;
    let r0 = cr * state.slip_rear * (1.0 - build) + push.rear_n;
    let (fk, rk) = (cf * build / v, cr * build / v);
    let (m, i) = (vehicle.mass_kg, vehicle.yaw_inertia_kg_m2);
    let across = side_wind / m - slope_mps2(plant.road.bank_rad);
    // vy' = (cos F_f + F_r) / m - v r + across ; r' = (a cos F_f - b F_r) / I
    let a11 = 1.0 + half * (cos * fk + rk) / m;
    let a12 = half * ((cos * fk * a - rk * b) / m + state.vx);
    let a21 = half * (a * cos * fk - b * rk) / i;
    let a22 = 1.0 + half * (a * a * cos * fk + b * b * rk) / i;
    let b1 = state.vy + half * ((cos * f0 + r0) / m + across);
    let b2 = state.yaw_rate + half * (a * cos * f0 - b * r0) / i;
    let det = a11 * a22 - a12 * a21;
    let (vy, r) = ((b1 * a22 - b2 * a12) / det, (a11 * b2 - a21 * b1) / det);
    let (steady_front, steady_rear) = (steer - (vy + a * r) / v, -(vy - b * r) / v);
    let force_front = f0 - cf * build * (steer - steady_front);
    let force_rear = r0 + cr * build * steady_rear;
    let ax = (traction - sin * force_front - drag - rolling_mps2(vehicle, state.vx) * m) / m;
    let ay = (cos * force_front + force_rear + side_wind) / m;
    let vx = state.vx + ROLL_SECS * (ax + vy * r - slope_mps2(plant.road.grade_rad));
    let next = State {
        vx: vx.max(0.0),
        vy: 2.0 * vy - state.vy,
        yaw_rate: 2.0 * r - state.yaw_rate,
        slip_front: state.slip_front + build_step * (steady_front - state.slip_front),
        slip_rear: state.slip_rear + build_step * (steady_rear - state.slip_rear),
    };
    (next, ax, ay)
}
