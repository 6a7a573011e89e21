//! The ego's motion: actuator lags and a dynamic single-track car, kinematic at low speed, in sub-steps.
//!
//! Tyre force = clamp(C·slip angle, ±μ·load) per axle, no combined slip; C is proportional to the static load (14 per
//! radian in front, 20 behind: mild understeer), μ = 1, centre of gravity midway between the axles, yaw inertia of a
//! uniform box. Lateral speed and yaw rate are stepped with a linearly implicit Euler rule, stable at all speeds.
//! Lags: 0.2 s for acceleration, 0.05 s for the steering rate. Rig frame; lateral speed is that of the rear axle.

use ds_space::angle::wrap;
use ds_space::{DVec2, PoseSe2};
use ds_world::{EgoState, VehicleParameters};

use crate::settings::DynamicsKind;
use crate::tracker::Command;

const GRAVITY_MPS2: f64 = 9.81;
const FRONT_STIFFNESS_PER_RAD: f64 = 14.0;
const REAR_STIFFNESS_PER_RAD: f64 = 20.0;
const FRICTION: f64 = 1.0;
const ACCELERATION_LAG_SECS: f64 = 0.2;
const STEERING_LAG_SECS: f64 = 0.05;
/// Kinematic up to the first speed, dynamic from the second.
const BLEND_MPS: [f64; 2] = [2.0, 4.0];
/// Forward and reverse speeds that no command exceeds.
pub(crate) const MAX_SPEED_MPS: f64 = 70.0;
pub(crate) const MAX_REVERSE_MPS: f64 = 5.0;
/// Yaw rate that stability control does not let through.
const MAX_YAW_RATE_RADPS: f64 = 3.0;

/// The ego's body and what its actuators do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Body {
    pub(crate) ego: EgoState,
    /// Acceleration that drive and brakes produce now, in metres per second squared.
    pub(crate) drive_mps2: f64,
}

/// A car ready to be stepped.
#[derive(Debug, Clone)]
pub(crate) struct Chassis {
    vehicle: VehicleParameters,
    kind: DynamicsKind,
    substeps: u32,
    step_secs: f64,
    yaw_inertia_kgm2: f64,
    axle_load_n: f64,
}

/// Forward speed, lateral speed of the rear axle, yaw rate.
#[derive(Debug, Clone, Copy)]
struct Rates {
    forward_mps: f64,
    lateral_mps: f64,
    yaw_radps: f64,
}

impl Chassis {
    pub(crate) fn new(vehicle: VehicleParameters, kind: DynamicsKind, substeps: u32, dt_secs: f64) -> Self {
        let size = vehicle.size;
        Self {
            vehicle,
            kind,
            substeps,
            step_secs: dt_secs / f64::from(substeps),
            yaw_inertia_kgm2: vehicle.mass_kg * (size.length_m.powi(2) + size.width_m.powi(2)) / 12.0,
            axle_load_n: 0.5 * vehicle.mass_kg * GRAVITY_MPS2,
        }
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
        Body { ego, drive_mps2 }
    }

    /// Returns the wheel base of the kinematic car that turns as much at this speed: L + K·v² with the understeer
    /// gradient K. Trackers steer by it.
    pub(crate) fn wheel_base_m(&self, speed_mps: f64) -> f64 {
        let gradient = (1.0 / FRONT_STIFFNESS_PER_RAD - 1.0 / REAR_STIFFNESS_PER_RAD) / GRAVITY_MPS2;
        self.vehicle.wheel_base_m + self.dynamic_share(speed_mps) * gradient * speed_mps * speed_mps
    }

    fn dynamic_share(&self, speed_mps: f64) -> f64 {
        match self.kind {
            DynamicsKind::Kinematic => 0.0,
            DynamicsKind::SingleTrack => smooth_step(speed_mps, BLEND_MPS),
        }
    }

    /// Moves the body one tick under a constant command.
    pub(crate) fn step(&self, body: &mut Body, command: Command) {
        let before = body.ego.velocity_mps;
        for _ in 0..self.substeps {
            self.substep(body, command);
        }
        let ego = &mut body.ego;
        let change = (ego.velocity_mps - before) / (self.step_secs * f64::from(self.substeps));
        ego.acceleration_mps2 = change + ego.yaw_rate_radps * ego.velocity_mps.perp();
    }

    fn substep(&self, body: &mut Body, command: Command) {
        let h = self.step_secs;
        self.actuate(body, command);
        let ego = &mut body.ego;
        let now =
            Rates { forward_mps: ego.velocity_mps.x, lateral_mps: ego.velocity_mps.y, yaw_radps: ego.yaw_rate_radps };
        let mut next = self.kinematic(now, ego.steering_rad, body.drive_mps2);
        let share = self.dynamic_share(now.forward_mps);
        if share > 0.0 {
            let slipping = self.dynamic(now, ego.steering_rad, body.drive_mps2);
            next.forward_mps += share * (slipping.forward_mps - next.forward_mps);
            next.lateral_mps += share * (slipping.lateral_mps - next.lateral_mps);
            next.yaw_radps += share * (slipping.yaw_radps - next.yaw_radps);
        }
        if now.forward_mps * next.forward_mps < 0.0 {
            // Brakes hold at a stand; the direction changes only under a new command from there.
            next = Rates { forward_mps: 0.0, lateral_mps: 0.0, yaw_radps: 0.0 };
            body.drive_mps2 = 0.0;
        }
        next.forward_mps = next.forward_mps.clamp(-MAX_REVERSE_MPS, MAX_SPEED_MPS);
        next.yaw_radps = next.yaw_radps.clamp(-MAX_YAW_RATE_RADPS, MAX_YAW_RATE_RADPS);
        next.lateral_mps = next.lateral_mps.clamp(-next.forward_mps.abs(), next.forward_mps.abs());
        let turned_rad = next.yaw_radps * h;
        let midway = PoseSe2 { heading_rad: ego.pose.heading_rad + 0.5 * turned_rad, ..ego.pose };
        ego.velocity_mps = DVec2::new(next.forward_mps, next.lateral_mps);
        ego.yaw_rate_radps = next.yaw_radps;
        ego.pose = PoseSe2 {
            position: midway.to_outer(ego.velocity_mps * h),
            heading_rad: wrap(ego.pose.heading_rad + turned_rad),
        };
    }

    fn actuate(&self, body: &mut Body, command: Command) {
        let (h, vehicle) = (self.step_secs, &self.vehicle);
        let wanted = command.acceleration_mps2.clamp(-vehicle.max_deceleration_mps2, vehicle.max_acceleration_mps2);
        body.drive_mps2 += h / (h + ACCELERATION_LAG_SECS) * (wanted - body.drive_mps2);
        let ego = &mut body.ego;
        let limit = vehicle.max_steering_rate_radps;
        let wanted = command.steering_rate_radps.clamp(-limit, limit);
        let rate = ego.steering_rate_radps + h / (h + STEERING_LAG_SECS) * (wanted - ego.steering_rate_radps);
        let limit = vehicle.max_steering_rad;
        let steering_rad = (ego.steering_rad + rate.clamp(-20.0, 20.0) * h).clamp(-limit, limit);
        ego.steering_rate_radps = (steering_rad - ego.steering_rad) / h;
        ego.steering_rad = steering_rad;
    }

    fn kinematic(&self, now: Rates, steering_rad: f64, drive_mps2: f64) -> Rates {
        let forward_mps = now.forward_mps + drive_mps2 * self.step_secs;
        let yaw_radps = forward_mps * steering_rad.tan() / self.vehicle.wheel_base_m;
        Rates { forward_mps, lateral_mps: 0.0, yaw_radps }
    }

    fn dynamic(&self, now: Rates, steering_rad: f64, drive_mps2: f64) -> Rates {
        let (h, mass, inertia) = (self.step_secs, self.vehicle.mass_kg, self.yaw_inertia_kgm2);
        let arm = 0.5 * self.vehicle.wheel_base_m;
        let Rates { forward_mps: vx, yaw_radps: yaw, .. } = now;
        let centre_mps = now.lateral_mps + arm * yaw;
        let (sin, cos) = steering_rad.sin_cos();
        let front = tyre(steering_rad - (centre_mps + arm * yaw).atan2(vx), FRONT_STIFFNESS_PER_RAD, self.axle_load_n);
        let rear = tyre(-now.lateral_mps.atan2(vx), REAR_STIFFNESS_PER_RAD, self.axle_load_n);

        let push = (front.force_n * cos + rear.force_n) / mass - vx * yaw;
        let spin = arm * (front.force_n * cos - rear.force_n) / inertia;
        // Jacobian of (push, spin) by (centre_mps, yaw), for the linearly implicit step.
        let (a, b) = (front.stiffness_n * cos / vx, rear.stiffness_n / vx);
        let push_by_centre = -(a + b) / mass;
        let push_by_yaw = -arm * (a - b) / mass - vx;
        let spin_by_centre = -arm * (a - b) / inertia;
        let spin_by_yaw = -arm * arm * (a + b) / inertia;
        let (m11, m12) = (1.0 - h * push_by_centre, -h * push_by_yaw);
        let (m21, m22) = (-h * spin_by_centre, 1.0 - h * spin_by_yaw);
        let determinant = (m11 * m22 - m12 * m21).max(0.1);
        let centre_change = h * (m22 * push - m12 * spin) / determinant;
        let yaw_change = h * (m11 * spin - m21 * push) / determinant;

        let forward_mps = vx + h * (drive_mps2 + yaw * centre_mps - front.force_n * sin / mass);
        let yaw_radps = yaw + yaw_change;
        Rates { forward_mps, lateral_mps: centre_mps + centre_change - arm * yaw_radps, yaw_radps }
    }
}

struct Tyre {
    force_n: f64,
    /// Change of the force with the slip angle; 0 when saturated.
    stiffness_n: f64,
}

fn tyre(slip_rad: f64, stiffness_per_rad: f64, load_n: f64) -> Tyre {
    let limit_n = FRICTION * load_n;
    let linear_n = stiffness_per_rad * load_n * slip_rad;
    if linear_n.abs() <= limit_n {
        Tyre { force_n: linear_n, stiffness_n: stiffness_per_rad * load_n }
    } else {
        Tyre { force_n: limit_n.copysign(linear_n), stiffness_n: 0.0 }
    }
}

fn smooth_step(value: f64, [from, to]: [f64; 2]) -> f64 {
    let t = ((value - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn body(speed_mps: f64, steering_rad: f64) -> Body {
        let ego = EgoState { velocity_mps: DVec2::new(speed_mps, 0.0), steering_rad, ..EgoState::default() };
        Body { ego, drive_mps2: 0.0 }
    }

    fn chassis(kind: DynamicsKind, substeps: u32) -> Chassis {
        Chassis::new(VehicleParameters::ZOE, kind, substeps, 0.1)
    }

    /// Holds speed and steering until the motion is steady.
    fn steady_yaw_rate(kind: DynamicsKind, speed_mps: f64, steering_rad: f64) -> (f64, f64) {
        let (chassis, mut body) = (chassis(kind, 10), body(speed_mps, steering_rad));
        for _ in 0..80 {
            let acceleration_mps2 = 3.0 * (speed_mps - body.ego.speed_mps());
            chassis.step(&mut body, Command { acceleration_mps2, steering_rate_radps: 0.0 });
        }
        (body.ego.yaw_rate_radps, body.ego.speed_mps())
    }

    #[test]
    fn steady_circles_have_the_analytic_understeer() {
        let wheel_base_m = VehicleParameters::ZOE.wheel_base_m;
        let gradient = (1.0 / FRONT_STIFFNESS_PER_RAD - 1.0 / REAR_STIFFNESS_PER_RAD) / GRAVITY_MPS2;
        for (speed_mps, steering_rad) in [(5.0, 0.05), (10.0, 0.03), (15.0, -0.02), (25.0, 0.01)] {
            let (yaw_rate, v) = steady_yaw_rate(DynamicsKind::SingleTrack, speed_mps, steering_rad);
            let expected = v * steering_rad / (wheel_base_m + gradient * v * v);
            assert!((yaw_rate / expected - 1.0).abs() < 0.02, "{speed_mps} m/s: {yaw_rate}, expected {expected}");
            let (yaw_rate, v) = steady_yaw_rate(DynamicsKind::Kinematic, speed_mps, steering_rad);
            assert!((yaw_rate - v * steering_rad.tan() / wheel_base_m).abs() < 1e-9);
        }
    }

    #[test]
    fn lateral_acceleration_stays_within_friction() {
        for speed_mps in [10.0, 20.0, 40.0] {
            let (chassis, mut body) = (chassis(DynamicsKind::SingleTrack, 10), body(speed_mps, 0.0));
            for _ in 0..50 {
                chassis.step(&mut body, Command { acceleration_mps2: 0.0, steering_rate_radps: 5.0 });
                let lateral = body.ego.speed_mps() * body.ego.yaw_rate_radps;
                assert!(body.ego.is_finite() && lateral.abs() < 2.5 * GRAVITY_MPS2, "{:?}", body.ego);
            }
            assert!(body.ego.speed_mps() < speed_mps, "cornering costs speed");
        }
    }

    #[test]
    fn any_number_of_substeps_is_stable() {
        for substeps in [1, 2, 5, 100] {
            for speed_mps in [2.5, 4.0, 8.0, 30.0, 65.0] {
                let (chassis, mut body) = (chassis(DynamicsKind::SingleTrack, substeps), body(speed_mps, 0.01));
                for _ in 0..100 {
                    chassis.step(&mut body, Command::default());
                }
                let expected = body.ego.speed_mps() * 0.01 / VehicleParameters::ZOE.wheel_base_m;
                let yaw_rate = body.ego.yaw_rate_radps;
                assert!(yaw_rate > 0.0 && yaw_rate < 1.1 * expected, "{substeps} at {speed_mps} m/s: {yaw_rate}");
            }
        }
    }

    #[test]
    fn brakes_hold_at_a_stand() {
        for kind in [DynamicsKind::SingleTrack, DynamicsKind::Kinematic] {
            let (chassis, mut body) = (chassis(kind, 10), body(6.0, 0.1));
            let mut before = body.ego.pose.position;
            for tick in 0..30 {
                let braking = if body.ego.speed_mps() > 0.0 { -6.0 } else { 0.0 };
                chassis.step(&mut body, Command { acceleration_mps2: braking, steering_rate_radps: 0.0 });
                assert!(body.ego.speed_mps() >= 0.0, "tick {tick}");
                if tick == 20 {
                    before = body.ego.pose.position;
                }
            }
            assert_eq!(body.ego.speed_mps(), 0.0);
            assert_eq!(body.ego.pose.position, before);
        }
    }

    #[test]
    fn steering_keeps_its_rate_and_angle_limits() {
        let (chassis, mut body) = (chassis(DynamicsKind::SingleTrack, 10), body(5.0, 0.0));
        for _ in 0..20 {
            let before = body.ego.steering_rad;
            chassis.step(&mut body, Command { acceleration_mps2: 0.0, steering_rate_radps: 9.0 });
            assert!(body.ego.steering_rad - before <= 0.08 + 1e-12 && body.ego.steering_rad <= 0.6);
        }
        assert_eq!(body.ego.steering_rad, 0.6);
    }

    #[test]
    fn a_log_without_steering_gets_it_from_its_yaw_rate() {
        let ego = EgoState { velocity_mps: DVec2::new(10.0, 0.0), yaw_rate_radps: 0.2, ..EgoState::default() };
        for (kind, wheel_base_m) in [(DynamicsKind::Kinematic, 2.588), (DynamicsKind::SingleTrack, 2.588 + 0.2184)] {
            let body = chassis(kind, 10).take_over(&ego);
            assert!((body.ego.steering_rad.tan() * 10.0 / wheel_base_m - 0.2).abs() < 1e-4, "{kind:?}");
        }
    }
}
