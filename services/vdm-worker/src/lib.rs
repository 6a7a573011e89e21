//! layout → frame, cache: the video model and, in its place on the bus, the other observation sources.
//!
//! Owns weights, KV cache, encoder and decoder state; a successor replays the `cache` log and compares digests.

pub mod device;
pub mod lens;
mod models;
pub mod per_frame;
pub mod rendered;
pub mod rollout;
pub mod settings;
pub mod simulated;
pub mod stage;

pub use models::load_config;
pub use settings::Settings;
pub use simulated::SimulatedStage;
pub use stage::VideoStage;

use std::path::PathBuf;
use std::sync::Arc;

use ds_process::Drain;
use ds_process::maker::MakerFactory;
use ds_process::service::{StageSections, run_stage};

/// Runs the process until `drain`.
///
/// # Errors
/// If the bus or the orchestrator's address is bad.
pub async fn run(settings: Settings, drain: Drain) -> anyhow::Result<()> {
    let Settings { process, control, security, bus, metrics, .. } = &settings;
    let sections = StageSections { process, control, security, bus, metrics };
    let factory = factory(&settings)?;
    run_stage("vdm-worker", sections, factory, drain).await
}

/// Returns what makes the frames: the video model, or what only waits in its place.
fn factory(settings: &Settings) -> anyhow::Result<Arc<dyn MakerFactory>> {
    let video = &settings.video;
    if video.simulated_secs != 0.0 {
        tracing::warn!(secs = video.simulated_secs, "simulated: frames are grey and mean nothing");
        return Ok(Arc::new(SimulatedStage::new(&video.model, video.simulated_secs)?));
    }
    let weights = Some(video.weights.clone()).filter(|path| *path != PathBuf::new());
    let devices = if video.devices.is_empty() { device::detected() } else { video.devices.clone() };
    tracing::info!(?devices, shares = video.share_device, "accelerators");
    tracing::info!(backend = settings.device.backend.name(), "the video model's back end");
    let factory = VideoStage::new(video.model.clone(), weights)
        .with_no_guidance(Some(video.no_guidance.clone()).filter(|path| *path != PathBuf::new()))
        .with_devices(devices, video.share_device)
        .with_backend(settings.device.backend);
    Ok(Arc::new(factory))
}
