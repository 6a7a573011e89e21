//! Effects on the drivers that follow the ego vehicle.
//! One file each; a file holds what is known beforehand and the change it makes.

pub(crate) mod tr_accel;
pub(crate) mod tr_brake;
pub(crate) mod tr_delay;
pub(crate) mod tr_headway;
pub(crate) mod tr_lag;
pub(crate) mod tr_min_gap;
pub(crate) mod tr_v0;
