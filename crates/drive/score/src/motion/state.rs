//! The state of the ego as NAVSIM holds it: eleven columns, pose of the rear axle.

use ds_space::{DVec2, PoseSe2};
use ds_world::EgoState;

/// One state of the ego. The pose is that of the rear axle in the world; vx, vy, ax, ay are in the body frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct VehicleState {
    /// Position of the rear axle, in metres.
    pub x_m: f64,
    /// Position of the rear axle, in metres.
    pub y_m: f64,
    /// Heading, in radians.
    pub heading_rad: f64,
    /// Forward speed, in metres per second.
    pub vx_mps: f64,
    /// Speed to the left, in metres per second.
    pub vy_mps: f64,
    /// Forward acceleration, in metres per second squared.
    pub ax_mps2: f64,
    /// Acceleration to the left, in metres per second squared.
    pub ay_mps2: f64,
    /// Road-wheel angle, in radians, left positive.
    pub steering_rad: f64,
    /// Road-wheel rate, in radians per second.
    pub steering_rate_radps: f64,
    /// Yaw rate, in radians per second.
    pub yaw_rate_radps: f64,
    /// Yaw acceleration, in radians per second squared.
    pub yaw_acceleration_radps2: f64,
}

/// The names of the columns, in order.
pub(crate) const COLUMNS: [&str; 11] = [
    "x",
    "y",
    "heading",
    "vx",
    "vy",
    "ax",
    "ay",
    "steering",
    "steering_rate",
    "angular_velocity",
    "angular_acceleration",
];

impl VehicleState {
    /// Makes a state of its columns, in the order of the fields.
    #[must_use]
    pub fn from_columns(columns: [f64; 11]) -> Self {
        let [x_m, y_m, heading_rad, vx_mps, vy_mps, ax_mps2, ay_mps2, steering_rad, rate, yaw_rate, yaw_acceleration] =
            columns;
        Self {
            x_m,
            y_m,
            heading_rad,
            vx_mps,
            vy_mps,
            ax_mps2,
            ay_mps2,
            steering_rad,
            steering_rate_radps: rate,
            yaw_rate_radps: yaw_rate,
            yaw_acceleration_radps2: yaw_acceleration,
        }
    }

    /// Returns the columns, in the order of the fields.
    #[must_use]
    pub fn columns(&self) -> [f64; 11] {
        [
            self.x_m,
            self.y_m,
            self.heading_rad,
            self.vx_mps,
            self.vy_mps,
            self.ax_mps2,
            self.ay_mps2,
            self.steering_rad,
            self.steering_rate_radps,
            self.yaw_rate_radps,
            self.yaw_acceleration_radps2,
        ]
    }

    /// Returns the pose of the rear axle in the world.
    #[must_use]
    pub fn pose(&self) -> PoseSe2 {
        PoseSe2::new(self.x_m, self.y_m, self.heading_rad)
    }

    /// Returns the position of the rear axle in the world, in metres.
    #[must_use]
    pub fn position(&self) -> DVec2 {
        DVec2::new(self.x_m, self.y_m)
    }

    /// Returns the size of the velocity, in metres per second.
    #[must_use]
    pub fn speed_mps(&self) -> f64 {
        self.vx_mps.hypot(self.vy_mps)
    }

    /// Returns the name of the first column that is not finite, with its value.
    #[must_use]
    pub fn not_finite(&self) -> Option<(&'static str, f64)> {
        COLUMNS.into_iter().zip(self.columns()).find(|(_, value)| !value.is_finite())
    }
}

impl From<&EgoState> for VehicleState {
    /// Takes what the simulator knows; it keeps no yaw acceleration, which becomes 0.
    fn from(ego: &EgoState) -> Self {
        Self {
            x_m: ego.pose.position.x,
            y_m: ego.pose.position.y,
            heading_rad: ego.pose.heading_rad,
            vx_mps: ego.velocity_mps.x,
            vy_mps: ego.velocity_mps.y,
            ax_mps2: ego.acceleration_mps2.x,
            ay_mps2: ego.acceleration_mps2.y,
            steering_rad: ego.steering_rad,
            steering_rate_radps: ego.steering_rate_radps,
            yaw_rate_radps: ego.yaw_rate_radps,
            yaw_acceleration_radps2: 0.0,
        }
    }
}
