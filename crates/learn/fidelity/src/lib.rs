//! Distances between sets of pictures: a fixed bank of features and the Fréchet distance between two feature matrices.
//!
//! The bank is multi-scale gradients and colour, documented in [`features`]; no trained network. [`frechet`] takes any
//! feature matrices, those of trained networks too, reduced by [`Principal`] where they have many columns.

pub mod features;
mod frechet;
mod principal;

pub use frechet::{FidelityError, Interval, frechet, frechet_interval};
pub use principal::Principal;
