//! Effects inside the actuators and between them and the wheels.
//! One file each; a file holds what is known beforehand and the change it makes.

pub(crate) mod accel_jerk_limit;
pub(crate) mod accel_lag;
pub(crate) mod brake_fade;
pub(crate) mod brake_gain;
pub(crate) mod drive_gain;
pub(crate) mod power_limit;
pub(crate) mod servo_order;
pub(crate) mod steer_backlash;
pub(crate) mod steer_gain;
pub(crate) mod steer_lag;
pub(crate) mod steer_offset;
pub(crate) mod steer_rate;
pub(crate) mod steer_saturation;
