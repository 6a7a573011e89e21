//! advance → world, ego: executes each work order in the simulator and publishes every state.
//!
//! Owns the world state of its episodes; a successor restores the last committed border snapshot exactly.

pub mod settings;
pub mod stage;

pub use settings::Settings;
pub use stage::SimStage;

use std::sync::Arc;

use ds_process::Drain;
use ds_process::service::{StageSections, run_stage};

/// Runs the process until `drain`.
///
/// # Errors
/// If the bus or the orchestrator's address is bad.
pub async fn run(settings: Settings, drain: Drain) -> anyhow::Result<()> {
    let Settings { process, control, security, bus, metrics } = &settings;
    let sections = StageSections { process, control, security, bus, metrics };
    run_stage("sim-server", sections, Arc::new(SimStage), drain).await
}
