//! Effects of the video model and of the transport of its frames: drift, flicker, washing, lost and invented objects,
//! late and repeated frames. One file each; a file holds what is known beforehand and the change it makes.

pub(crate) mod condition_delay;
pub(crate) mod dropped_frames;
pub(crate) mod identity_switch;
pub(crate) mod layout_misalignment;
pub(crate) mod object_dropout;
pub(crate) mod object_hallucination;
pub(crate) mod patch;
pub(crate) mod rollout_drift;
pub(crate) mod temporal_flicker;
pub(crate) mod texture_washing;
