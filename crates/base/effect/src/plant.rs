//! The simulator as plain values: command paths, actuators, vehicle, road, sensors, clock, the following driver, what
//! others decide and the map.
//!
//! Effects edit these values at their insertion point; whoever integrates the equations reads them. SI units;
//! x forward, y left, angles counter-clockwise. Nothing is integrated here.

use crate::law::Law;
use crate::signal::{Operator, Place};

/// The steering chain, command to road wheel.
#[derive(Default)]
pub struct Steering {
    /// First-order time constant of the servo, seconds.
    pub lag_secs: f64,
    /// Operators on the command, on the servo's output and on the linkage behind the position sensor, in this order.
    pub operators: Vec<(Place, Operator)>,
}

/// The drive and brake chain, requested to realised force over nominal mass, m/s².
#[derive(Default)]
pub struct Traction {
    /// First-order time constant, seconds.
    pub lag_secs: f64,
    /// Operators on the request and on the realised acceleration.
    pub operators: Vec<(Place, Operator)>,
}

/// A single-track vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vehicle {
    /// Mass that turns a request into a force, kg.
    pub nominal_mass_kg: f64,
    /// Mass that is moved, kg.
    pub mass_kg: f64,
    /// Inertia about the vertical axis, kg m².
    pub yaw_inertia_kg_m2: f64,
    /// Front axle to centre of gravity, m.
    pub front_arm_m: f64,
    /// Rear axle to centre of gravity, m.
    pub rear_arm_m: f64,
    /// Cornering stiffness of the front axle, N/rad.
    pub front_stiffness_n: f64,
    /// Cornering stiffness of the rear axle, N/rad.
    pub rear_stiffness_n: f64,
    /// Friction coefficient; an axle's side force saturates at friction times load.
    pub friction: f64,
    /// Sharpness of the passage from linear to saturated side force: 2 is gradual, 4 is nearly a clip.
    pub tyre_knee: f64,
    /// Height over which drive and brake force shift axle load (times the tyre's load exponent), m.
    pub load_height_m: f64,
    /// Distance over which side force builds up, m.
    pub relaxation_m: f64,
    /// How drive and brakes share the friction with the side force; absent where they leave it alone.
    pub friction_circle: Option<FrictionCircle>,
    /// Deceleration without drive force at rest, m/s².
    pub rolling_mps2: f64,
    /// Drag force over squared air speed, N s²/m².
    pub drag_n_s2_m2: f64,
}

/// Drive and brake force take their part of each axle's friction; of the side force at any slip what is left remains
/// (friction ellipse: `F_y = F_y0 sqrt(1 - (F_x / F_max)^2)`; Pacejka, Tire and Vehicle Dynamics, section 4.2).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrictionCircle {
    /// Front axle's share of the drive force: 0 driven at the rear, 1 at the front.
    pub front_drive: f64,
}

impl FrictionCircle {
    /// Front axle's share of the brake force, much the same in all cars.
    const FRONT_BRAKE: f64 = 0.62;
    /// Largest share that is taken before the side force vanishes; a locked wheel still has a little.
    const LARGEST_TAKEN: f64 = 0.95;

    /// Returns the factors on the side forces, front and rear, under a drive force and the axles' limits, N.
    #[must_use]
    pub fn left(&self, force_n: f64, limits_n: [f64; 2]) -> [f64; 2] {
        let front = if force_n > 0.0 { self.front_drive } else { Self::FRONT_BRAKE };
        let forces_n = [front * force_n, (1.0 - front) * force_n];
        std::array::from_fn(|axle| {
            let taken = (forces_n[axle] / limits_n[axle]).abs().min(Self::LARGEST_TAKEN);
            (1.0 - taken * taken).sqrt()
        })
    }
}

impl Default for FrictionCircle {
    fn default() -> Self {
        Self { front_drive: 0.5 }
    }
}

/// The road and the air.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Road {
    /// Slope along the path, uphill positive, rad.
    pub grade_rad: f64,
    /// Slope across, left side higher, rad.
    pub bank_rad: f64,
    /// Wind velocity east, m/s.
    pub wind_x_mps: f64,
    /// Wind velocity north, m/s.
    pub wind_y_mps: f64,
}

/// What the sensors do to the truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensors {
    /// Added to the gyro, rad/s.
    pub gyro_bias_rad_s: f64,
    /// Factor on the gyro.
    pub gyro_factor: f64,
    /// Added to the forward accelerometer, m/s².
    pub ax_bias_mps2: f64,
    /// Added to the left accelerometer, m/s².
    pub ay_bias_mps2: f64,
    /// Factor on the left accelerometer by body roll.
    pub roll_factor: f64,
    /// Rotation of the accelerometers about the vertical axis, rad.
    pub misalignment_rad: f64,
    /// Factor on wheel speed.
    pub wheel_factor: f64,
    /// Relative wheel speed per m/s² of drive or brake force over mass, s²/m.
    pub wheel_slip_s2_m: f64,
    /// Reference point ahead of the centre of gravity, m.
    pub lever_arm_m: f64,
}

/// When samples were really taken.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Clock {
    /// Age of pose and speed samples, s.
    pub pose_latency_secs: f64,
    /// Growth of that age per second of the drive.
    pub pose_drift: f64,
    /// Age of gyro and accelerometer samples, s.
    pub imu_latency_secs: f64,
    /// Age of steering position samples, s.
    pub encoder_latency_secs: f64,
    /// Age of wheel speed samples, s.
    pub wheel_latency_secs: f64,
    /// Age of the observation a policy acts on, s.
    pub observation_latency_secs: f64,
    /// Standard deviation of the sampling instants, s.
    pub jitter_secs: f64,
    /// Share of samples that repeat the one before.
    pub repeated_share: f64,
}

/// A following driver: the intelligent driver model (Treiber, Hennecke, Helbing 2000) with a reaction time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Follower {
    /// Time headway, s.
    pub headway_secs: f64,
    /// Gap at rest, m.
    pub min_gap_m: f64,
    /// Acceleration on a free road, m/s².
    pub max_accel_mps2: f64,
    /// Comfortable deceleration, m/s².
    pub comfort_decel_mps2: f64,
    /// Exponent of the free-road term.
    pub exponent: f64,
    /// Factor on the desired speed of the drive.
    pub desired_speed_factor: f64,
    /// Reaction time, s.
    pub delay_secs: f64,
    /// First-order lag of the follower's drive, s.
    pub lag_secs: f64,
}

/// Weight of others in the nominal driver's lane changes.
pub const NOMINAL_POLITENESS: f64 = 0.25;

/// What other road users decide.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Agents {
    /// Whether vehicles change lanes.
    pub changes_lanes: bool,
    /// Weight of others' accelerations in a lane change, 0 to 1.
    pub politeness: f64,
    /// Whether vehicles yield where others have the right of way.
    pub yields: bool,
    /// Share of drivers who do not.
    pub non_yielding: f64,
    /// Whether people on foot walk by themselves instead of as logged.
    pub walks: bool,
    /// Factor on their speed.
    pub walking_factor: f64,
    /// Time gap before a vehicle that they accept, s.
    pub walking_gap_secs: f64,
    /// Whether anybody reacts at all.
    pub reactive: bool,
}

impl Default for Agents {
    fn default() -> Self {
        Self {
            changes_lanes: false,
            politeness: NOMINAL_POLITENESS,
            yields: false,
            non_yielding: 0.0,
            walks: false,
            walking_factor: 1.0,
            walking_gap_secs: 2.0,
            reactive: true,
        }
    }
}

/// How the road differs from the map.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Chart {
    /// Lanes lie so far to the left of where the map says, m.
    pub lane_offset_m: f64,
    /// Whether there is a lane to the right that the map lacks.
    pub lane_missing: bool,
    /// Whether people cross by right where the map has no crosswalk.
    pub crosswalk_missing: bool,
    /// Stop lines lie so much farther along the road, m.
    pub stop_line_shift_m: f64,
}

/// Everything a nominal simulator is made of; effects edit it.
pub struct Plant {
    /// Steering chain.
    pub steering: Steering,
    /// Drive and brake chain.
    pub traction: Traction,
    /// Ego vehicle.
    pub vehicle: Vehicle,
    /// Road and air.
    pub road: Road,
    /// Sensors.
    pub sensors: Sensors,
    /// Clocks and transport.
    pub clock: Clock,
    /// Following drivers.
    pub follower: Follower,
    /// What other road users decide.
    pub agents: Agents,
    /// How the road differs from the map.
    pub chart: Chart,
    /// Laws that no effect of the library is.
    pub laws: Vec<Law>,
}

impl Default for Sensors {
    fn default() -> Self {
        Self {
            gyro_bias_rad_s: 0.0,
            gyro_factor: 1.0,
            ax_bias_mps2: 0.0,
            ay_bias_mps2: 0.0,
            roll_factor: 1.0,
            misalignment_rad: 0.0,
            wheel_factor: 1.0,
            wheel_slip_s2_m: 0.0,
            lever_arm_m: 0.0,
        }
    }
}
