//! Effects of camera and image: mounting, lens, shutter, exposure, sensor, encoder, and the air and light in between.
//! One file each; a file holds what is known beforehand and the change it makes.

pub(crate) mod defocus;
pub(crate) mod exposure_lag;
pub(crate) mod focal_error;
pub(crate) mod fog_haze;
pub(crate) mod gamma;
pub(crate) mod jpeg_loss;
pub(crate) mod lens_dirt;
pub(crate) mod motion_blur;
pub(crate) mod mount_pitch;
pub(crate) mod mount_position;
pub(crate) mod mount_roll;
pub(crate) mod mount_yaw;
pub(crate) mod night_illumination;
pub(crate) mod obs_latency;
pub(crate) mod radial_distortion;
pub(crate) mod rain_streaks;
pub(crate) mod rolling_shutter;
pub(crate) mod sensor_noise;
pub(crate) mod vignetting;
pub(crate) mod white_balance;
