//! What an open-loop plan is scored against: map areas, route, agents, red lights, the ego and its past.
//!
//! Plain data in the world frame, SI units. [`PreparedScene`] checks it once and indexes it; then plans cost
//! microseconds.

mod governed;
mod input;
mod prepared;
mod traffic;
mod world;

pub use governed::GovernedLanes;
pub use input::{
    AgentTrack, AreaKind, MapArea, MovingBox, ObjectClass, OpenLoopMap, OpenLoopScene, PastState, SceneNow,
};
pub use prepared::{PreparedMap, PreparedScene};
pub use traffic::{Traffic, TrafficAgent};

pub use world::{expert_path, log_tracks, open_loop_map, scene_now};

pub(crate) use prepared::AreaIndex;
pub(crate) use world::{lies_along, route_line, surface_of};
