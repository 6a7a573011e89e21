//! What pictures are compared by: a fixed bank of features, and principal directions of any feature matrix.
//!
//! The bank is multi-scale gradients and colour, documented in [`features`]; no trained network. [`Principal`] reduces
//! feature matrices of many columns, those of trained networks too, to what [`ds_stats::frechet`] compares.

pub mod features;
mod principal;

pub use principal::Principal;
