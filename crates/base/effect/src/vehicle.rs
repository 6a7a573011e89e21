//! Effects of masses, tyres and resistances.
//! One file each; a file holds what is known beforehand and the change it makes.

pub(crate) mod cg_shift;
pub(crate) mod drag_add;
pub(crate) mod drive_split;
pub(crate) mod front_grip;
pub(crate) mod kinematic_only;
pub(crate) mod load_transfer;
pub(crate) mod mu;
pub(crate) mod payload;
pub(crate) mod rear_grip;
pub(crate) mod roll_add;
pub(crate) mod tyre_knee;
pub(crate) mod tyre_relaxation;
pub(crate) mod yaw_inertia;
