//! Effects of the road and the air.
//! One file each; a file holds what is known beforehand and the change it makes.

pub(crate) mod bank;
pub(crate) mod grade;
pub(crate) mod wind_steady;
