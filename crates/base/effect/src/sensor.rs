//! Effects on the sensors' readings.
//! One file each; a file holds what is known beforehand and the change it makes.

pub(crate) mod ax_bias;
pub(crate) mod ay_bias;
pub(crate) mod gyro_bias;
pub(crate) mod gyro_scale;
pub(crate) mod imu_misalignment;
pub(crate) mod lever_arm;
pub(crate) mod suspension_roll;
pub(crate) mod wheel_scale;
pub(crate) mod wheel_slip;
