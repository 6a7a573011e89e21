//! Tensors, layers, optimisers and weight files: the only crate that names the machine-learning framework (burn).
//!
//! Everything that crosses this crate's border is a plain [`Array`] or [`Weights`] (row-major f32 and a shape), so
//! that callers are free of the framework. The networks are the patch diffusion transformer ([`dit`]) and the tiny
//! streaming autoencoder ([`tiny_ae`]); one training step of each lives in [`step`]. Computation runs on the
//! `flex` back end; initial values come from counter-based draws, never from a global generator.

pub mod array;
pub mod attention;
pub mod cache;
pub mod dit;
mod graph;
pub mod optimiser;
pub mod planner;
pub mod safetensors;
pub mod segmenter;
pub mod step;
pub mod tiny_ae;

pub use array::{Array, Declared, Initial, Weights, WeightsError};
