//! Cases of every kind: made of the vehicle logs of runs, read from folders, handed to the diagnoser that takes them;
//! the worlds that such runs drive in, and the windows of a drive that goes on.
//!
//! [`Case::read`] tells the kinds apart, [`diagnose`] and [`evaluate`] are the one place that knows all diagnosers.

pub mod alarms;
pub mod attended;
pub mod baseline;
pub mod case;
pub mod closing;
mod error;
pub mod finished;
pub mod fleet;
pub mod folder;
pub mod localised;
pub mod logs;
pub mod message;
pub mod pairs;
pub mod reference;
pub mod scenes;
pub mod seal;
pub mod stamps;
pub mod window;
pub mod world;

pub use case::{Case, Options, Unseen, diagnose, evaluate};
pub use error::CasesError;
pub use world::{EffectLine, RunConfig};
