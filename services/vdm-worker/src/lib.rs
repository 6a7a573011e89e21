//! layout → frame, cache: the video model and, in its place on the bus, the other observation sources.
//!
//! Owns weights, KV cache, encoder and decoder state; a successor replays the `cache` log and compares digests.

pub mod device;
pub mod lens;
pub mod rendered;
pub mod rollout;
pub mod settings;
pub mod stage;

pub use settings::Settings;
pub use stage::VideoStage;

use std::path::PathBuf;
use std::sync::Arc;

use ds_process::Drain;
use ds_process::service::{StageSections, run_stage};

/// Runs the process until `drain`.
///
/// # Errors
/// If the bus or the orchestrator's address is bad.
pub async fn run(settings: Settings, drain: Drain) -> anyhow::Result<()> {
    let Settings { process, control, security, bus, .. } = &settings;
    let sections = StageSections { process, control, security, bus };
    let weights = Some(settings.video.weights.clone()).filter(|path| *path != PathBuf::new());
    let video = &settings.video;
    let devices = if video.devices.is_empty() { device::detected() } else { video.devices.clone() };
    tracing::info!(?devices, shares = video.share_device, "accelerators");
    tracing::info!(backend = settings.device.backend.name(), "the video model's back end");
    let factory = VideoStage::new(video.model.clone(), weights)
        .with_devices(devices, video.share_device)
        .with_backend(settings.device.backend);
    let factory = Arc::new(factory);
    run_stage("vdm-worker", sections, factory, drain).await
}
