//! Distances between sets of pictures: a fixed bank of features and the Fréchet distance between two feature matrices.
//!
//! The bank is multi-scale gradients and colour, documented in [`features`]; no trained network. [`frechet`] takes any
//! feature matrices, so that trained features can be put in later.

pub mod features;
mod frechet;

pub use frechet::{FidelityError, Interval, frechet, frechet_interval};
