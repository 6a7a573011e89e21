//! Tensors, layers, optimisers and weight files: the only crate that names the machine-learning framework (burn).
//!
//! Everything that crosses this crate's border is a plain [`Array`] or [`Weights`] (row-major f32 and a shape), so
//! that callers are free of the framework. The networks are the patch diffusion transformer ([`dit`]) and the tiny
//! streaming autoencoder ([`tiny_ae`]); one training step of each lives in [`step`]. Training runs on the `flex` back
//! end; inference has a second body of plain loops ([`fast`]) behind the traits of [`body`]. Initial values come from
//! counter-based draws, never from a global generator.

#![expect(unsafe_code, reason = "published weights are mapped into memory instead of being read whole")]

pub mod array;
pub mod attention;
pub mod body;
pub mod cache;
pub mod checkpoint;
pub mod classifier;
pub mod clip;
pub mod device;
pub mod dit;
pub mod fast;
mod graph;
pub mod optimiser;
pub mod planner;
pub mod safetensors;
pub mod segmenter;
pub mod sentencepiece;
pub mod step;
pub mod tae;
pub mod team;
pub mod tiny_ae;
pub mod training;
pub mod umt5;
pub mod wan_vae;

pub use array::{Array, Declared, Initial, Weights, WeightsError};
