//! Effects on when samples were taken and how they arrive.
//! One file each; a file holds what is known beforehand and the change it makes.

pub(crate) mod clock_drift;
pub(crate) mod dropped_frames;
pub(crate) mod encoder_latency;
pub(crate) mod imu_latency;
pub(crate) mod obs_latency;
pub(crate) mod pose_latency;
pub(crate) mod timestamp_jitter;
pub(crate) mod wheel_latency;
