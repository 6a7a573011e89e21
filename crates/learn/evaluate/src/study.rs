//! Studies: tables of the fidelity of frames for policies, over held-out scenarios.

pub mod config;
mod features;
mod fidelity;
mod frames;
pub mod outcome;
mod page;
mod panel;

pub use config::FidelityConfig;
pub use fidelity::{fidelity, write};
