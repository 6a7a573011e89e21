//! Effects on what other road users decide: lane changes, yielding, walking, reacting at all.
//! One file each; a file holds what is known beforehand and the change it makes.

pub(crate) mod lane_change_politeness;
pub(crate) mod log_replay_not_reactive;
pub(crate) mod non_yielding;
pub(crate) mod pedestrian_behaviour;
