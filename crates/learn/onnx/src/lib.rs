//! Networks of others: an ONNX file with a manifest that says what goes in and what comes out.
//!
//! [`Manifest`] is read and checked from TOML; it names inputs and outputs of the network with shapes, units and axes.
//! [`Network`] is computed by tract, which this crate alone names, on one thread and with fixed shapes. Nothing here knows
//! of policies: `ds_policy::own` makes one of the two. An [`Encoder`] only looks: frames become features.

mod encoder;
pub mod error;
mod form;
#[cfg(test)]
mod made;
pub mod manifest;
pub mod network;
mod operators;

pub use encoder::Encoder;
pub use error::OnnxError;
pub use manifest::Manifest;
pub use network::{Named, Network};
