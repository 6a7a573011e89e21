//! The viewer's data in rerun: recordings, drives under way, finished diagnoses, trainings.
//!
//! An onlooker like anybody else: it reads recordings, hears the bus as station `viewer` and puts nothing there. The window
//! itself is not part of it: it opens an `.rrd` file or is connected to. World frame in metres: map (once), agents as
//! boxes, ego with its path, plan and proposals as lines. Per camera the frame with the projected boxes over it, and the
//! layout, as JPEG. Scores and speed as curves, events as text, a running diagnosis as curves and text.

mod arrangement;
mod boxes;
mod diagnosis;
mod error;
pub mod explained;
pub mod follow;
pub mod live;
mod logger;
mod map;
pub mod recording;
pub mod stream;
pub mod training;

pub use error::ViewError;
pub use live::{LiveCounts, LiveView};
pub use logger::Logger;
