//! Ids, ticks, simulation time, coordinate frames, poses, plane geometry, cameras, digests and counter-based random draws.
//!
//! Frames: `World` (x east, y north, z up, fixed per scenario), `Rig` (x forward, y left, z up, origin on
//! the ground under the rear axle), `Camera` (x right, y down, z forward), `Image` (pixels, origin top left).
//! SI units and radians throughout. No serde here: files and wire have structs of their own.

pub mod angle;
pub mod camera;
pub mod digest;
pub mod draw;
pub mod id;
pub mod plane;
pub mod pose;
pub mod time;

pub use camera::{CameraModel, Framing, Intrinsics};
pub use digest::{Digest, DigestWriter};
pub use draw::Draws;
pub use glam::{DMat3, DMat4, DQuat, DVec2, DVec3, DVec4, Mat4, Vec2, Vec3, Vec4};
pub use id::{AgentId, AttemptId, CameraId, EpisodeId, IdError, InstanceId, RunId};
pub use pose::{Camera, Frame, Pose, PoseSe2, Rig, World};
pub use time::{SimTime, Tick};
