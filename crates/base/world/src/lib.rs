//! The scene and the states that live in it: map, tracks, lights, agents, ego, trajectory. Values only.
//!
//! World frame, SI units, radians. No file formats, no messages; no behaviour beyond look-ups
//! and the houses and trees of scenes that name none.

pub mod adversary;
pub mod agent;
pub mod choice;
pub mod condition;
mod distance;
pub mod ego;
pub mod map;
pub mod reading;
pub mod scene;
pub mod state;
pub mod structure;
pub mod surroundings;
pub mod trajectory;
pub mod wording;

pub use adversary::{Adversary, AdversaryMode, Budget, CrashClass};
pub use agent::{AgentClass, AgentState, Size, Track, TrackPoint};
pub use choice::{AgentMode, Anchor, LayoutBackend, TrackerKind};
pub use condition::{Condition, ConditionError, Lighting, RoadSurface, Weather};
pub use ego::{EgoState, RouteCommand, VehicleParameters};
pub use map::{
    Crosswalk, Lane, LaneId, LaneKind, LightState, LineColour, LineKind, LineMarking, Map, Polygon, RoadEdge, StopLine,
    TrafficLight,
};
pub use reading::Reading;
pub use scene::{Family, Origin, Scene};
pub use state::{Contact, ContactKind, WorldState};
pub use structure::{Structure, StructureKind};
pub use trajectory::{Proposal, Trajectory, TrajectoryError, TrajectoryPoint};
pub use wording::Wording;
