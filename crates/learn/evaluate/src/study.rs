//! Studies: tables of the fidelity of frames for policies, over held-out scenarios.
//!
//! All studies over frames share one engine: declared sources ([`config`]), features that are kept, distances with
//! resamples. `parts` asks of plans on those frames, `closed_loop` of drives, what the others ask of frames.

mod anchor;
mod attended;
pub mod closed_loop;
pub mod config;
mod correlation;
mod crew;
mod drives;
mod engine;
mod features;
mod found;
mod frames;
mod given;
mod moment;
pub mod outcome;
mod page;
mod panel;
mod parts;
mod pictures;
mod plans;
mod recorded;
mod rollout;
mod sensitivity;
mod source;
mod under_way;

pub use config::{Study, StudyConfig};
pub use crew::Means;
pub use drives::{DriveOf, RecordedDrive, drives};
pub use engine::{run, write, write_json};
pub use page::closed::write_drives;
pub use panel::Guests;
pub use pictures::pictures;
