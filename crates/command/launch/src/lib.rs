//! A run on a fleet of its own: what is driven how, the services inside or beside this process, results and pictures.

pub mod children;
pub mod choice;
pub mod embed;
pub mod fleet_plan;
pub mod guest;
pub mod networks;
pub mod onlooker;
pub mod own;
mod pictures;
pub mod request;
pub mod run;
pub mod run_plan;
pub mod scenarios;

pub use fleet_plan::FleetPlan;
pub use networks::Networks;
pub use run_plan::{Align, RunPlan, SubmitArgs};

/// Returns the runtime of a command that talks to a fleet.
///
/// # Errors
/// If the system gives no threads.
pub fn runtime() -> anyhow::Result<tokio::runtime::Runtime> {
    Ok(tokio::runtime::Builder::new_multi_thread().enable_all().worker_threads(4).build()?)
}
