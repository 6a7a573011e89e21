//! Effects on the way from the controller to the actuators.
//! One file each; a file holds what is known beforehand and the change it makes.

pub(crate) mod accel_delay;
pub(crate) mod cmd_hold_rate;
pub(crate) mod deadzone_accel;
pub(crate) mod steer_delay;
