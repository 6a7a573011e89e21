//! Small networks that look at a frame and say what it shows, and how they are trained on frames of the reference camera.
//!
//! [`segmenter`] names every pixel, [`lights`] reads the state of a traffic light whose place is known, [`look`] names
//! light, weather and road surface and gives features for distances between sets of frames. None of them sees a layout,
//! a map or a place in the world. Their truth comes from the camera and the map ([`label`], [`lights`]).

mod error;
pub mod frames;
pub mod label;
pub mod lights;
pub mod look;
pub mod overlap;
pub mod reader;
pub mod segmenter;
pub mod soften;
pub mod training;

pub use error::PerceptionError;
pub use label::Label;
