//! Any simulator as the nominal one: a command that speaks JSON lines → motions of windows → the diagnosis of
//! `ds_dynamics`, with few rollouts.
//!
//! Command path, actuators, sensors and clocks stay outside; vehicle and road are changed through parameters that the
//! simulator declares, else through forces at its ports. SI units, x forward, y left. No clock but for time-outs, and no
//! machine code of others in this process. The manual is `docs/simulators.md`.

mod diagnose;
mod drive;
mod error;
mod fields;
mod foreign;
mod message;
mod process;
mod reality;
mod serve;
mod twins;

pub use diagnose::{Explored, evaluate, healthy};
pub use error::SimulatorError;
pub use message::{Hello, ParameterEntry, Reply, Request};
pub use process::Process;
pub use reality::Reality;
pub use serve::{Served, serve};
