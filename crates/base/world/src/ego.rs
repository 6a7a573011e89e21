//! The vehicle under test: its parameters, state and route command.

use ds_space::{DVec2, PoseSe2};

use crate::agent::{Size, corners};

/// Dimensions and dynamics of the ego vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VehicleParameters {
    /// Body size.
    pub size: Size,
    /// Distance between the axles, in metres.
    pub wheel_base_m: f64,
    /// From the rear axle forward to the centre of the body, in metres.
    pub rear_axle_to_centre_m: f64,
    /// Largest road-wheel angle, in radians.
    pub max_steering_rad: f64,
    /// Largest road-wheel rate, in radians per second.
    pub max_steering_rate_radps: f64,
    /// Largest acceleration, in metres per second squared.
    pub max_acceleration_mps2: f64,
    /// Largest deceleration (positive), in metres per second squared.
    pub max_deceleration_mps2: f64,
    /// Mass, in kilograms.
    pub mass_kg: f64,
}

impl VehicleParameters {
    /// A mid-size car (Chrysler Pacifica as in nuPlan): the default ego.
    pub const PACIFICA: Self = Self {
        size: Size { length_m: 5.176, width_m: 2.297, height_m: 1.777 },
        wheel_base_m: 3.089,
        rear_axle_to_centre_m: 1.461,
        max_steering_rad: 0.6,
        max_steering_rate_radps: 0.8,
        max_acceleration_mps2: 4.0,
        max_deceleration_mps2: 8.0,
        mass_kg: 2000.0,
    };

    /// A mid-size car (Ford Fusion as in Argoverse 2).
    pub const FUSION: Self = Self {
        size: Size { length_m: 4.87, width_m: 1.85, height_m: 1.48 },
        wheel_base_m: 2.85,
        rear_axle_to_centre_m: 1.35,
        max_steering_rad: 0.6,
        max_steering_rate_radps: 0.8,
        max_acceleration_mps2: 4.0,
        max_deceleration_mps2: 8.0,
        mass_kg: 1700.0,
    };

    /// A small car (Renault Zoe as in nuScenes).
    pub const ZOE: Self = Self {
        size: Size { length_m: 4.084, width_m: 1.730, height_m: 1.562 },
        wheel_base_m: 2.588,
        rear_axle_to_centre_m: 1.21,
        max_steering_rad: 0.6,
        max_steering_rate_radps: 0.8,
        max_acceleration_mps2: 4.0,
        max_deceleration_mps2: 8.0,
        mass_kg: 1500.0,
    };
}

/// The true state of the ego vehicle at one tick.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct EgoState {
    /// The rig (ground point under the rear axle) in the world.
    pub pose: PoseSe2,
    /// Velocity in the rig, in metres per second (x forward, y left).
    pub velocity_mps: DVec2,
    /// Yaw rate, in radians per second, left positive.
    pub yaw_rate_radps: f64,
    /// Acceleration in the rig, in metres per second squared.
    pub acceleration_mps2: DVec2,
    /// Road-wheel angle, in radians, left positive.
    pub steering_rad: f64,
    /// Road-wheel rate, in radians per second.
    pub steering_rate_radps: f64,
}

impl EgoState {
    /// Returns the forward speed, in metres per second.
    #[must_use]
    pub fn speed_mps(&self) -> f64 {
        self.velocity_mps.x
    }

    /// Returns the pose of the centre of the body in the world.
    #[must_use]
    pub fn centre(&self, vehicle: &VehicleParameters) -> PoseSe2 {
        PoseSe2 {
            position: self.pose.to_outer(DVec2::new(vehicle.rear_axle_to_centre_m, 0.0)),
            heading_rad: self.pose.heading_rad,
        }
    }

    /// Returns the four corners of the body in the world, counter-clockwise from front left.
    #[must_use]
    pub fn corners(&self, vehicle: &VehicleParameters) -> [DVec2; 4] {
        corners(&self.centre(vehicle), vehicle.size.length_m, vehicle.size.width_m)
    }

    /// Says whether all numbers are finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.pose.is_finite()
            && self.velocity_mps.is_finite()
            && self.acceleration_mps2.is_finite()
            && self.yaw_rate_radps.is_finite()
            && self.steering_rad.is_finite()
            && self.steering_rate_radps.is_finite()
    }
}

/// What a navigation system tells the driver about the next manoeuvre.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub enum RouteCommand {
    /// Follow the road.
    #[default]
    Straight,
    /// Turn left.
    Left,
    /// Turn right.
    Right,
}
