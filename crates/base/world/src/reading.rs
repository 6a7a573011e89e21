//! What a car records of itself between ticks: commands, positioning, inertial and wheel sensors.

/// One sample of a vehicle log. Positions are those of the centre of gravity; stamps are the receiver's.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Reading {
    /// Stamp since the start of the scenario, in seconds.
    pub secs: f64,
    /// Commanded road-wheel angle, in radians.
    pub cmd_steer_rad: f64,
    /// Commanded force at the wheels over nominal mass, in metres per second squared.
    pub cmd_accel_mps2: f64,
    /// East, in metres.
    pub x_m: f64,
    /// North, in metres.
    pub y_m: f64,
    /// Heading, in radians, not wrapped at the log's own steps.
    pub yaw_rad: f64,
    /// Forward speed of the positioning system, in metres per second.
    pub speed_mps: f64,
    /// Gyro, in radians per second.
    pub yaw_rate_radps: f64,
    /// Accelerometers, body axes, specific force, in metres per second squared.
    pub ax_mps2: f64,
    /// Left accelerometer.
    pub ay_mps2: f64,
    /// Position sensor of the steering, as road-wheel angle in radians.
    pub steering_rad: f64,
    /// Mean wheel speed times nominal radius, in metres per second.
    pub wheel_speed_mps: f64,
}

impl Reading {
    /// Number of fields.
    pub const FIELDS: usize = 12;

    /// Returns all fields, in the order of declaration.
    #[must_use]
    pub fn to_array(&self) -> [f64; Self::FIELDS] {
        [
            self.secs,
            self.cmd_steer_rad,
            self.cmd_accel_mps2,
            self.x_m,
            self.y_m,
            self.yaw_rad,
            self.speed_mps,
            self.yaw_rate_radps,
            self.ax_mps2,
            self.ay_mps2,
            self.steering_rad,
            self.wheel_speed_mps,
        ]
    }

    /// Makes a reading of its fields in the order of declaration.
    #[must_use]
    pub fn from_array(fields: [f64; Self::FIELDS]) -> Self {
        let [
            secs,
            cmd_steer_rad,
            cmd_accel_mps2,
            x_m,
            y_m,
            yaw_rad,
            speed_mps,
            yaw_rate_radps,
            ax_mps2,
            ay_mps2,
            steering_rad,
            wheel_speed_mps,
        ] = fields;
        Self {
            secs,
            cmd_steer_rad,
            cmd_accel_mps2,
            x_m,
            y_m,
            yaw_rad,
            speed_mps,
            yaw_rate_radps,
            ax_mps2,
            ay_mps2,
            steering_rad,
            wheel_speed_mps,
        }
    }
}
