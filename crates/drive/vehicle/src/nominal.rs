//! The nominal car and driver as plain values that effects may change.

use ds_effect::plant::{Agents, Chart, Clock, Follower, Plant, Road, Sensors, Steering, Traction, Vehicle};
use ds_world::VehicleParameters;

use crate::force::GRAVITY_MPS2;
use crate::idm::{EXPONENT, IdmParameters};

/// Cornering stiffness over static axle load, per radian.
const FRONT_STIFFNESS_PER_RAD: f64 = 14.0;
const REAR_STIFFNESS_PER_RAD: f64 = 20.0;
const FRICTION: f64 = 1.0;
const ACCELERATION_LAG_SECS: f64 = 0.2;
const STEERING_LAG_SECS: f64 = 0.05;

/// Understeer gradient K of the nominal car: in steady motion it turns like a kinematic one of wheel base L + K·v².
pub const UNDERSTEER_S2_PER_M: f64 = (1.0 / FRONT_STIFFNESS_PER_RAD - 1.0 / REAR_STIFFNESS_PER_RAD) / GRAVITY_MPS2;

/// Returns the nominal car and the nominal follower, every effect absent.
#[must_use]
pub fn nominal(vehicle: &VehicleParameters, idm: &IdmParameters) -> Plant {
    let mass_kg = vehicle.mass_kg;
    let axle_load_n = 0.5 * mass_kg * GRAVITY_MPS2;
    let arm_m = 0.5 * vehicle.wheel_base_m;
    Plant {
        steering: Steering { lag_secs: STEERING_LAG_SECS, operators: Vec::new() },
        traction: Traction { lag_secs: ACCELERATION_LAG_SECS, operators: Vec::new() },
        vehicle: Vehicle {
            nominal_mass_kg: mass_kg,
            mass_kg,
            yaw_inertia_kg_m2: mass_kg * (vehicle.size.length_m.powi(2) + vehicle.size.width_m.powi(2)) / 12.0,
            front_arm_m: arm_m,
            rear_arm_m: arm_m,
            front_stiffness_n: FRONT_STIFFNESS_PER_RAD * axle_load_n,
            rear_stiffness_n: REAR_STIFFNESS_PER_RAD * axle_load_n,
            friction: FRICTION,
            tyre_knee: f64::INFINITY,
            load_height_m: 0.0,
            relaxation_m: 0.0,
            friction_circle: None,
            rolling_mps2: 0.0,
            drag_n_s2_m2: 0.0,
        },
        road: Road::default(),
        sensors: Sensors::default(),
        clock: Clock::default(),
        follower: Follower {
            headway_secs: idm.headway_secs,
            min_gap_m: idm.minimum_gap_m,
            max_accel_mps2: idm.acceleration_mps2,
            comfort_decel_mps2: idm.deceleration_mps2,
            exponent: f64::from(EXPONENT),
            desired_speed_factor: 1.0,
            delay_secs: 0.0,
            lag_secs: 0.0,
        },
        agents: Agents::default(),
        chart: Chart::default(),
        laws: Vec::new(),
    }
}
