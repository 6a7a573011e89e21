//! world → layout: draws every state as a condition image, one per camera. Owns nothing but the static map.

pub mod settings;
pub mod stage;

pub use settings::Settings;
pub use stage::LayoutStage;

use std::sync::Arc;

use ds_process::Drain;
use ds_process::service::{StageSections, run_stage};

/// Runs the process until `drain`.
///
/// # Errors
/// If the bus or the orchestrator's address is bad.
pub async fn run(settings: Settings, drain: Drain) -> anyhow::Result<()> {
    let Settings { process, control, security, bus, metrics, .. } = &settings;
    let sections = StageSections { process, control, security, bus, metrics };
    let factory = Arc::new(LayoutStage { probe: settings.layout.probe });
    run_stage("layout-render", sections, factory, drain).await
}
