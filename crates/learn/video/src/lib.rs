//! The autoregressive video diffusion model: layouts of coming ticks and the past go in, frames come out.
//!
//! [`ModelConfig`] describes a model, [`VideoModel`] holds its weights, [`Rollout`] is the state of one camera of one
//! episode: a cache of early-timestep keys and values with a permanent sink, and the memory of the streaming decoder.
//! Everything is a pure function of weights, draw key, prompt, first frame and layouts; no clock, no files but weights.

pub mod ablation;
mod backend;
mod codec;
mod conditions;
pub mod config;
mod denoising;
mod entry;
mod error;
mod layout;
mod model;
mod per_frame;
pub mod prompt;
mod published;
mod rollout;
pub mod sampler;
pub mod sampling;
#[cfg(test)]
mod tests;
pub mod tokens;
pub mod workload;

pub use ablation::{Ablated, Ablation};
pub use backend::{Backend, WholeClips};
pub use denoising::Denoising;

pub use config::{CacheSource, ConfigError, ModelConfig};
pub use error::VideoError;
pub use layout::{Carry, Layout, Paint, brightness, relit};
pub use model::VideoModel;
pub use per_frame::PerFrame;
pub use rollout::{Generated, Replay, Rollout};
