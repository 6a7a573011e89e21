//! Effects of a map that is not the world: where others really drive, stop and cross.
//! One file each; a file holds what is known beforehand and the change it makes.

pub(crate) mod lane_offset;
pub(crate) mod missing_crosswalk;
pub(crate) mod missing_lane;
pub(crate) mod stop_line_shift;
