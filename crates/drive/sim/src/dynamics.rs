//! The ego's motion: actuator lags and a dynamic single-track car, kinematic at low speed, in sub-steps.
//!
//! Forces are those of `ds_vehicle`. The nominal tyre force is clamp(C·slip angle, ±μ·load) per axle, no combined slip; C is
//! proportional to the static load (14 per radian in front, 20 behind: mild understeer), μ = 1, centre of gravity midway
//! between the axles, yaw inertia of a uniform box. Lateral speed and yaw rate are stepped with a linearly implicit Euler
//! rule, stable at all speeds. Lags: 0.2 s for acceleration, 0.05 s for the steering rate. Rig frame; lateral speed is that
//! of the rear axle. Effects change the car's [`Plant`]; without any, the plant is the car above.

use std::sync::Arc;

use ds_effect::law::{Felt, Port, Push};
use ds_effect::plant::Plant;
use ds_space::angle::wrap;
use ds_space::{DVec2, PoseSe2};
use ds_vehicle::{
    Command, GRAVITY_MPS2, STANDING_MPS, Tyre, UNDERSTEER_S2_PER_M, air_n, axles, built_share, held, rolling_mps2,
    slip_rad, slope_mps2,
};
use ds_world::{EgoState, VehicleParameters};

use crate::actuation::{Moment, Past, Sent};
use crate::settings::DynamicsKind;

/// Kinematic up to the first speed, dynamic from the second.
const BLEND_MPS: [f64; 2] = [2.0, 4.0];
/// Forward and reverse speeds that no command exceeds.
pub(crate) const MAX_SPEED_MPS: f64 = 70.0;
pub(crate) const MAX_REVERSE_MPS: f64 = 5.0;
/// Yaw rate that stability control does not let through.
const MAX_YAW_RATE_RADPS: f64 = 3.0;

/// The ego's body and what its actuators do.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Body {
    pub(crate) ego: EgoState,
    /// Acceleration that drive and brakes produce now, in metres per second squared.
    pub(crate) drive_mps2: f64,
    /// Steering angle that the actuator's sensor sees, in radians.
    pub(crate) sensed_rad: f64,
    /// Slip angles that tyres with a relaxation length have built up, front and rear, in radians.
    pub(crate) slip_rad: [f64; 2],
    /// Commands and moments, where an effect or the vehicle log needs them.
    pub(crate) past: Past,
}

/// A car ready to be stepped.
#[derive(Clone)]
pub(crate) struct Chassis {
    vehicle: VehicleParameters,
    kind: DynamicsKind,
    substeps: u32,
    step_secs: f64,
    plant: Arc<Plant>,
    /// Whether commands pass an altered chain instead of the nominal lags.
    chained: bool,
    /// Whether the car keeps its past.
    remembers: bool,
}

impl std::fmt::Debug for Chassis {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Chassis").field("vehicle", &self.vehicle).field("kind", &self.kind).finish_non_exhaustive()
    }
}

/// Forward speed, lateral speed of the rear axle, yaw rate, and specific force at the centre of gravity.
#[derive(Debug, Clone, Copy)]
struct Rates {
    forward_mps: f64,
    lateral_mps: f64,
    yaw_radps: f64,
    force_mps2: DVec2,
}

impl Chassis {
    pub(crate) fn new(
        vehicle: VehicleParameters,
        kind: DynamicsKind,
        substeps: u32,
        dt_secs: f64,
        plant: Arc<Plant>,
        remembers: bool,
    ) -> Self {
        let nominal = ds_vehicle::nominal(&vehicle, &ds_vehicle::IdmParameters::default());
        let same_lags = (plant.steering.lag_secs, plant.traction.lag_secs)
            == (nominal.steering.lag_secs, nominal.traction.lag_secs);
        let straight = plant.steering.operators.is_empty() && plant.traction.operators.is_empty();
        let chained = !(same_lags && straight && plant.laws.is_empty());
        let step_secs = dt_secs / f64::from(substeps);
        Self { vehicle, kind, substeps, step_secs, plant, chained, remembers: remembers || chained }
    }

    /// Takes over a logged state. A log without steering gets the angle that its yaw rate needs.
    pub(crate) fn take_over(&self, ego: &EgoState) -> Body {
        let (mut ego, vehicle) = (*ego, &self.vehicle);
        let speed_mps = ego.speed_mps();
        if ego.steering_rad == 0.0 && speed_mps > 1.0 {
            ego.steering_rad = (ego.yaw_rate_radps * self.wheel_base_m(speed_mps) / speed_mps).atan();
        }
        let limit = vehicle.max_steering_rad;
        ego.steering_rad = ego.steering_rad.clamp(-limit, limit);
        ego.velocity_mps.x = speed_mps.clamp(-MAX_REVERSE_MPS, MAX_SPEED_MPS);
        let drive_mps2 = ego.acceleration_mps2.x.clamp(-vehicle.max_deceleration_mps2, vehicle.max_acceleration_mps2);
        let sensed_rad = ego.steering_rad;
        Body { ego, drive_mps2, sensed_rad, ..Body::default() }
    }

    /// Follows the log to a body, whose commands are taken to be what the log shows.
    pub(crate) fn follow(&self, body: &mut Body, logged: Body) {
        if self.remembers {
            let (from, to) =
                (self.moment(body, body.ego.acceleration_mps2), self.moment(&logged, logged.ego.acceleration_mps2));
            let (from, mut to) = (from.to_array(), to.to_array());
            to[2] = from[2] + wrap(to[2] - from[2]);
            let sent = self.sent_by_log(&logged);
            let count = if body.past.sent.is_empty() { 1 } else { self.substeps };
            body.past.send(count, self.lawful(), |last| Sent { brake_work_mj: last.brake_work_mj, ..sent });
            for k in 1..=self.substeps {
                let u = f64::from(k) / f64::from(self.substeps);
                body.past.witness(Moment::from_array(std::array::from_fn(|i| from[i] + u * (to[i] - from[i]))));
            }
        }
        let past = std::mem::take(&mut body.past);
        *body = Body { past, ..logged };
    }

    /// The command of a car in steady motion: its servo lags behind by the lag times the rate.
    fn sent_by_log(&self, logged: &Body) -> Sent {
        let ego = &logged.ego;
        Sent {
            steer_rad: ego.steering_rad + self.plant.steering.lag_secs * ego.steering_rate_radps,
            accel_mps2: logged.drive_mps2,
            speed_mps: ego.speed_mps(),
            brake_work_mj: 0.0,
        }
    }

    /// Returns the wheel base of the kinematic car that turns as much at this speed: L + K·v² with the understeer
    /// gradient K. Trackers steer by it; they know the nominal car.
    pub(crate) fn wheel_base_m(&self, speed_mps: f64) -> f64 {
        self.vehicle.wheel_base_m + self.dynamic_share(speed_mps) * UNDERSTEER_S2_PER_M * speed_mps * speed_mps
    }

    fn dynamic_share(&self, speed_mps: f64) -> f64 {
        match self.kind {
            DynamicsKind::Kinematic => 0.0,
            DynamicsKind::SingleTrack => smooth_step(speed_mps, BLEND_MPS),
        }
    }

    /// Returns the ego as its controller knows it: behind an altered chain, the angle that it has asked for.
    pub(crate) fn known(&self, body: &Body) -> EgoState {
        match body.past.sent.last() {
            Some(sent) if self.chained => EgoState { steering_rad: sent.steer_rad, ..body.ego },
            _ => body.ego,
        }
    }

    /// Moves the body one tick under a constant command.
    pub(crate) fn step(&self, body: &mut Body, command: Command) {
        let before = body.ego.velocity_mps;
        let realised = self.remembers.then(|| self.send(body, command)).flatten();
        let mut pushed = Push::default();
        for k in 0..self.substeps as usize {
            match &realised {
                Some(tick) => {
                    let steering_rad = tick.steering.wheel[k];
                    body.ego.steering_rate_radps = (steering_rad - body.ego.steering_rad) / self.step_secs;
                    body.ego.steering_rad = steering_rad;
                    body.sensed_rad = tick.steering.sensed[k];
                    body.drive_mps2 = tick.accel[k];
                    if self.lawful() {
                        pushed = self.obey(body, tick, k);
                    }
                }
                None => self.actuate(body, command),
            }
            let force_mps2 = self.substep(body, &pushed);
            if self.remembers {
                let moment = self.moment(body, force_mps2);
                let unwrapped =
                    body.past.moments.last().map_or(moment.heading_rad, |last| {
                        last.heading_rad + wrap(moment.heading_rad - last.heading_rad)
                    });
                body.past.witness(Moment { heading_rad: unwrapped, ..moment });
            }
        }
        let ego = &mut body.ego;
        let change = (ego.velocity_mps - before) / (self.step_secs * f64::from(self.substeps));
        ego.acceleration_mps2 = change + ego.yaw_rate_radps * ego.velocity_mps.perp();
    }

    fn lawful(&self) -> bool {
        !self.plant.laws.is_empty()
    }

    /// Turns the wheels by what laws add at the steering in a sub-step, and returns what laws push the car with.
    fn obey(&self, body: &mut Body, tick: &crate::actuation::Tick, k: usize) -> Push {
        let last = body.past.moments.last().copied().unwrap_or_default();
        let [slip_front, slip_rear] = body.slip_rad;
        let felt = Felt {
            v: body.ego.velocity_mps.x,
            yaw_rate: body.ego.yaw_rate_radps,
            slip_front,
            slip_rear,
            ..last.felt()
        };
        let known = |(law, term): (usize, usize)| tick.known[law][term].get(k).copied().unwrap_or(1.0);
        let added = |port: Port| -> f64 {
            let here = self.plant.laws.iter().enumerate().filter(|(_, law)| law.port() == port);
            here.map(|(n, law)| law.at(|term| known((n, term)), &felt)).sum()
        };
        let (seen, unseen) = (added(Port::Steering), added(Port::Linkage));
        body.ego.steering_rad += seen + unseen;
        body.sensed_rad += seen;
        Push::of([self.plant.vehicle.front_arm_m, self.plant.vehicle.rear_arm_m], added)
    }

    /// Notes the commands of a tick; returns what an altered chain makes of them.
    fn send(&self, body: &mut Body, command: Command) -> Option<crate::actuation::Tick> {
        let (h, vehicle) = (self.step_secs, &self.vehicle);
        let accel_mps2 = command.acceleration_mps2.clamp(-vehicle.max_deceleration_mps2, vehicle.max_acceleration_mps2);
        let rate = vehicle.max_steering_rate_radps;
        let rate = command.steering_rate_radps.clamp(-rate, rate);
        let limit = vehicle.max_steering_rad;
        let speed_mps = body.ego.speed_mps();
        let work_mj = self.plant.vehicle.nominal_mass_kg * (-accel_mps2).max(0.0) * speed_mps.abs() * h * 1e-6;
        if body.past.sent.is_empty() {
            let start = self.sent_by_log(body);
            body.past.send(1, self.lawful(), |_| start);
        }
        body.past.send(self.substeps, self.lawful(), |last| Sent {
            steer_rad: (last.steer_rad + rate * h).clamp(-limit, limit),
            accel_mps2,
            speed_mps,
            brake_work_mj: last.brake_work_mj + work_mj,
        });
        self.chained.then(|| body.past.realise(&self.plant, h, self.substeps))
    }

    fn moment(&self, body: &Body, force_mps2: DVec2) -> Moment {
        let ego = &body.ego;
        let centre = ego.pose.position + ego.pose.forward() * self.plant.vehicle.rear_arm_m;
        Moment {
            x_m: centre.x,
            y_m: centre.y,
            heading_rad: ego.pose.heading_rad,
            speed_mps: ego.velocity_mps.x,
            yaw_rate_radps: ego.yaw_rate_radps,
            ax_mps2: force_mps2.x,
            ay_mps2: force_mps2.y,
            sensed_rad: body.sensed_rad,
            drive_mps2: body.drive_mps2,
        }
    }

    fn substep(&self, body: &mut Body, pushed: &Push) -> DVec2 {
        let h = self.step_secs;
        let ego = &body.ego;
        let now = Rates {
            forward_mps: ego.velocity_mps.x,
            lateral_mps: ego.velocity_mps.y,
            yaw_radps: ego.yaw_rate_radps,
            force_mps2: DVec2::ZERO,
        };
        let mut next = self.kinematic(now, body, pushed);
        let share = self.dynamic_share(now.forward_mps);
        if share > 0.0 {
            let slipping = self.dynamic(now, body, pushed);
            next.forward_mps += share * (slipping.forward_mps - next.forward_mps);
            next.lateral_mps += share * (slipping.lateral_mps - next.lateral_mps);
            next.yaw_radps += share * (slipping.yaw_radps - next.yaw_radps);
            next.force_mps2 += share * (slipping.force_mps2 - next.force_mps2);
        }
        if now.forward_mps * next.forward_mps < 0.0 {
            // Brakes hold at a stand; the direction changes only under a new command from there.
            next = Rates { forward_mps: 0.0, lateral_mps: 0.0, yaw_radps: 0.0, force_mps2: DVec2::ZERO };
            body.drive_mps2 = 0.0;
        }
        next.forward_mps = next.forward_mps.clamp(-MAX_REVERSE_MPS, MAX_SPEED_MPS);
        next.yaw_radps = next.yaw_radps.clamp(-MAX_YAW_RATE_RADPS, MAX_YAW_RATE_RADPS);
        next.lateral_mps = next.lateral_mps.clamp(-next.forward_mps.abs(), next.forward_mps.abs());
        let turned_rad = next.yaw_radps * h;
        let ego = &mut body.ego;
        let midway = PoseSe2 { heading_rad: ego.pose.heading_rad + 0.5 * turned_rad, ..ego.pose };
        ego.velocity_mps = DVec2::new(next.forward_mps, next.lateral_mps);
        ego.yaw_rate_radps = next.yaw_radps;
        ego.pose = PoseSe2 {
            position: midway.to_outer(ego.velocity_mps * h),
            heading_rad: wrap(ego.pose.heading_rad + turned_rad),
        };
        next.force_mps2
    }

    /// The nominal lags.
    fn actuate(&self, body: &mut Body, command: Command) {
        let (h, vehicle) = (self.step_secs, &self.vehicle);
        let wanted = command.acceleration_mps2.clamp(-vehicle.max_deceleration_mps2, vehicle.max_acceleration_mps2);
        body.drive_mps2 += h / (h + self.plant.traction.lag_secs) * (wanted - body.drive_mps2);
        let ego = &mut body.ego;
        let limit = vehicle.max_steering_rate_radps;
        let wanted = command.steering_rate_radps.clamp(-limit, limit);
        let share = h / (h + self.plant.steering.lag_secs);
        let rate = ego.steering_rate_radps + share * (wanted - ego.steering_rate_radps);
        let limit = vehicle.max_steering_rad;
        let steering_rad = (ego.steering_rad + rate.clamp(-20.0, 20.0) * h).clamp(-limit, limit);
        ego.steering_rate_radps = (steering_rad - ego.steering_rad) / h;
        ego.steering_rad = steering_rad;
        body.sensed_rad = steering_rad;
    }

    /// Returns what drives the car along and what holds it back, both over its mass, and the push of the wind aside.
    fn along(&self, forward_mps: f64, body: &Body, pushed: &Push) -> Along {
        let (car, road) = (&self.plant.vehicle, &self.plant.road);
        let drive_mps2 = held(body.drive_mps2 * (car.nominal_mass_kg / car.mass_kg), car.friction, GRAVITY_MPS2);
        let (sin, cos) = body.ego.pose.heading_rad.sin_cos();
        let [drag_n, side_n] = air_n(car, road, forward_mps, sin, cos);
        let slope_mps2 = slope_mps2(road.grade_rad);
        let standing = forward_mps.abs() <= STANDING_MPS && drive_mps2.abs() <= slope_mps2.abs();
        let pushed_mps2 = pushed.drive_mps2 * (car.nominal_mass_kg / car.mass_kg);
        Along {
            felt_mps2: drive_mps2 - rolling_mps2(car, forward_mps) - drag_n / car.mass_kg + pushed_mps2,
            slope_mps2: if standing { 0.0 } else { slope_mps2 },
            side_mps2: side_n / car.mass_kg,
        }
    }

    fn kinematic(&self, now: Rates, body: &Body, pushed: &Push) -> Rates {
        let push = self.along(now.forward_mps, body, pushed);
        let forward_mps = now.forward_mps + (push.felt_mps2 - push.slope_mps2) * self.step_secs;
        let yaw_radps = forward_mps * body.ego.steering_rad.tan() / self.vehicle.wheel_base_m;
        let force_mps2 = DVec2::new(push.felt_mps2, forward_mps * yaw_radps);
        Rates { forward_mps, lateral_mps: 0.0, yaw_radps, force_mps2 }
    }

    fn dynamic(&self, now: Rates, body: &mut Body, pushed: &Push) -> Rates {
        let (h, car) = (self.step_secs, &self.plant.vehicle);
        let (mass, inertia) = (car.mass_kg, car.yaw_inertia_kg_m2);
        let (front_arm, rear_arm) = (car.front_arm_m, car.rear_arm_m);
        let Rates { forward_mps: vx, yaw_radps: yaw, .. } = now;
        let centre_mps = now.lateral_mps + rear_arm * yaw;
        let steering_rad = body.ego.steering_rad;
        let (sin, cos) = steering_rad.sin_cos();
        let push = self.along(vx, body, pushed);
        let slip_rad =
            [slip_rad(steering_rad, centre_mps + front_arm * yaw, vx), slip_rad(0.0, centre_mps - rear_arm * yaw, vx)];
        let [mut front, mut rear] = self.side_forces(vx, slip_rad, body);
        front.force_n += pushed.front_n;
        rear.force_n += pushed.rear_n;

        let across = push.side_mps2 - slope_mps2(self.plant.road.bank_rad);
        let sideways = (front.force_n * cos + rear.force_n) / mass - vx * yaw + across;
        let spin = (front_arm * front.force_n * cos - rear_arm * rear.force_n) / inertia;
        // Jacobian of (sideways, spin) by (centre_mps, yaw), for the linearly implicit step.
        let (a, b) = (front.tangent_n * cos / vx, rear.tangent_n / vx);
        let sideways_by_centre = -(a + b) / mass;
        let sideways_by_yaw = -(front_arm * a - rear_arm * b) / mass - vx;
        let spin_by_centre = -(front_arm * a - rear_arm * b) / inertia;
        let spin_by_yaw = -(front_arm * front_arm * a + rear_arm * rear_arm * b) / inertia;
        let (m11, m12) = (1.0 - h * sideways_by_centre, -h * sideways_by_yaw);
        let (m21, m22) = (-h * spin_by_centre, 1.0 - h * spin_by_yaw);
        let determinant = (m11 * m22 - m12 * m21).max(0.1);
        let centre_change = h * (m22 * sideways - m12 * spin) / determinant;
        let yaw_change = h * (m11 * spin - m21 * sideways) / determinant;

        let felt_mps2 = push.felt_mps2 - front.force_n * sin / mass;
        let forward_mps = vx + h * (felt_mps2 - push.slope_mps2 + yaw * centre_mps);
        let yaw_radps = yaw + yaw_change;
        // What an accelerometer feels across: the whole change of motion but for gravity's share.
        let felt_across = centre_change / h + vx * yaw_radps - across + push.side_mps2;
        Rates {
            forward_mps,
            lateral_mps: centre_mps + centre_change - rear_arm * yaw_radps,
            yaw_radps,
            force_mps2: DVec2::new(felt_mps2, felt_across),
        }
    }

    /// Returns the side forces, front and rear, at slip angles that build up in the body.
    fn side_forces(&self, forward_mps: f64, slip_rad: [f64; 2], body: &mut Body) -> [Tyre; 2] {
        let car = &self.plant.vehicle;
        let share = built_share(car.relaxation_m, forward_mps, self.step_secs);
        for (built, slip) in body.slip_rad.iter_mut().zip(slip_rad) {
            *built = if share < 1.0 { *built + share * (slip - *built) } else { slip };
        }
        let axles = axles(car, body.drive_mps2);
        [0, 1].map(|k| {
            let tyre = axles[k].tyre(body.slip_rad[k], car.tyre_knee);
            Tyre { tangent_n: share * tyre.tangent_n, ..tyre }
        })
    }
}

/// Forces along and across the car, over its mass.
struct Along {
    /// Drive, rolling resistance and drag: what an accelerometer feels.
    felt_mps2: f64,
    slope_mps2: f64,
    side_mps2: f64,
}

fn smooth_step(value: f64, [from, to]: [f64; 2]) -> f64 {
    let t = ((value - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests;
