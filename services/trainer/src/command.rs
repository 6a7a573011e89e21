//! The commands, one file each.

pub(crate) mod data;
pub(crate) mod study;
pub(crate) mod train;
pub(crate) mod video;
