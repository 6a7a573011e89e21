//! The encoders and autoencoders of published models, each with the reader of its published weights.
//!
//! A reader takes a checkpoint of [`ds_nn::checkpoint`], which knows files, formats and spellings of names; which files
//! make up a model stands in its configuration.

pub mod clip;
pub mod tae;
pub mod umt5;
pub mod wan_vae;
