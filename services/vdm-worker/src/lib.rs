//! layout → frame, cache: the video model and, in its place on the bus, the other observation sources.
//!
//! Owns weights, KV cache, encoder and decoder state; a successor replays the `cache` log and compares digests.

pub mod rendered;
pub mod rollout;
pub mod settings;
pub mod stage;

pub use settings::Settings;
pub use stage::VideoStage;

use std::path::PathBuf;
use std::sync::Arc;

use ds_process::Drain;

/// Runs the process until `drain`.
///
/// # Errors
/// If the bus or the orchestrator's address is bad.
pub async fn run(settings: Settings, drain: Drain) -> anyhow::Result<()> {
    let sections = (&settings.process, &settings.control, &settings.bus);
    let weights = Some(settings.video.weights.clone()).filter(|path| *path != PathBuf::new());
    let factory = Arc::new(VideoStage::new(settings.video.model.clone(), weights));
    ds_process::service::run_stage("vdm-worker", sections, factory, drain).await
}
