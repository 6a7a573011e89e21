//! world → layout: draws every state as a condition image, one per camera. Owns nothing but the static map.

pub mod settings;
pub mod stage;

pub use settings::Settings;
pub use stage::LayoutStage;

use std::sync::Arc;

use ds_process::Drain;

/// Runs the process until `drain`.
///
/// # Errors
/// If the bus or the orchestrator's address is bad.
pub async fn run(settings: Settings, drain: Drain) -> anyhow::Result<()> {
    let sections = (&settings.process, &settings.control, &settings.security, &settings.bus);
    let factory = Arc::new(LayoutStage { probe: settings.layout.probe });
    ds_process::service::run_stage("layout-render", sections, factory, drain).await
}
