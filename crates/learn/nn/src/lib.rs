//! Networks as values: arrays, weights and their files, published checkpoints, shapes, and what a training step takes
//! and gives.
//!
//! Everything is a plain [`Array`] or [`Weights`] (row-major f32 and a shape), so that users are free of whatever
//! computes. The networks are the patch diffusion transformer ([`dit`]) and the tiny streaming autoencoder
//! ([`tiny_ae`]); the traits of [`body`] are what computes them, [`cache`] is what a rollout keeps between chunks.
//! Bodies live in crates above: `ds_graph` on the machine-learning framework, `ds_kernel` as loops of this project.
//! Initial values come from counter-based draws, never from a global generator.

#![expect(unsafe_code, reason = "published weights are mapped into memory instead of being read whole")]

pub mod array;
pub mod body;
pub mod cache;
pub mod checkpoint;
pub mod discriminator;
pub mod dit;
pub mod optimiser;
pub mod safetensors;
pub mod sentencepiece;
pub mod step;
pub mod team;
pub mod tiny_ae;
pub mod work;

pub use array::{Array, Declared, Initial, Weights, WeightsError};
