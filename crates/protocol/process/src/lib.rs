//! What every process does: settings, logging, draining, joining the fleet, hosting the makers of its role.
//!
//! A service of a stage is a [`maker::MakerFactory`]; everything between it and the bus is here, once.

pub mod beside;
pub mod certs;
pub mod children;
pub mod clock;
pub mod drain;
pub mod exposition;
pub mod heard;
pub mod hold;
pub mod logging;
pub mod maker;
pub mod member;
pub mod metrics;
pub mod onlooker;
pub mod run_folder;
pub mod runs;
pub mod section;
pub mod security;
pub mod service;
pub mod settings;
pub mod shipped;
pub mod tally;
pub mod terminal;
pub mod workbench;

pub use member::{Member, MemberError};
pub use tokio_util::sync::CancellationToken as Drain;
