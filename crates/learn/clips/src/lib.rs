//! Clips for training and evaluation: frames, layouts, classes and prompts of scenarios, in sharded files with an index.
//!
//! A recipe (TOML) says which scenarios are seen in which conditions; [`render`] makes its clips on all processor
//! cores, shard by shard, and goes on where it stopped; [`ClipSet`] reads them. A clip is a pure function of its plan:
//! the same recipe gives the same bytes, whatever the number of cores.

mod clip;
mod drive;
mod error;
mod geometry;
mod hook;
mod index;
mod make;
mod network;
mod outline;
mod pattern;
mod plan;
mod recipe;
mod render;
mod set;
mod shard;
mod sheet;

pub use clip::Clip;
pub use drive::Drive;
pub use error::ClipsError;
pub use index::{CameraInfo, ClipInfo, ConditionInfo, DriveInfo, INDEX_FILE, Index};
pub use make::scene_of;
pub use network::network_id;
pub use outline::outline;
pub use pattern::Pattern;
pub use plan::{ClipPlan, PlannedClip, ScenarioKey};
pub use recipe::{AppearanceConfig, EditConfig, Generator, HookConfig, Recipe, ScenarioConfig, Source, Split};
pub use render::{Progress, Rendered, render};
pub use set::ClipSet;
pub use sheet::contact_sheet;
