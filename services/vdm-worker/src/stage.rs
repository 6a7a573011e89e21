//! The video stage: picks the episode's observation source.

use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use ds_process::maker::{Abilities, Fault, Maker, MakerFactory, chain};
use ds_topic::{ObservationSource, Role, SceneMessage};
use ds_video::{Backend, ModelConfig, VideoModel};

use crate::rendered::Rendered;
use crate::rollout::Rollouts;

/// Reads and checks a model's configuration.
///
/// # Errors
/// The text names the file and what is wrong with it.
pub fn load_config(path: &Path) -> Result<ModelConfig, String> {
    let text = std::fs::read_to_string(path).map_err(|error| format!("{error}: {path:?}"))?;
    ModelConfig::parse(&text).map_err(|error| format!("{error}: {path:?}"))
}

/// Opens an observation source for each episode that the instance is given; the weights are loaded once.
pub struct VideoStage {
    config: PathBuf,
    weights: Option<PathBuf>,
    devices: Vec<String>,
    shares_device: bool,
    backend: Backend,
    model: OnceLock<Result<Arc<VideoModel>, String>>,
}

impl VideoStage {
    /// Names the model's configuration; its weights lie where [`ModelConfig::weights_beside`] says unless named.
    #[must_use]
    pub fn new(config: PathBuf, weights: Option<PathBuf>) -> Self {
        let backend = Backend::default();
        Self { config, weights, devices: Vec::new(), shares_device: false, backend, model: OnceLock::new() }
    }

    /// Names what computes.
    #[must_use]
    pub fn with_backend(self, backend: Backend) -> Self {
        Self { backend, ..self }
    }

    /// Names the accelerators that it may be given, and whether it takes one that another worker holds.
    #[must_use]
    pub fn with_devices(self, devices: Vec<String>, shares_device: bool) -> Self {
        Self { devices, shares_device, ..self }
    }

    /// Loads the model at the first call and returns it.
    ///
    /// # Errors
    /// If configuration or weights are refused.
    pub fn model(&self) -> Result<Arc<VideoModel>, Fault> {
        let load = || {
            let config = load_config(&self.config)?;
            let weights = self.weights.clone().unwrap_or_else(|| config.weights_beside(&self.config));
            if config.weights.drawn {
                tracing::warn!(model = config.name, "the weights are drawn, frames mean nothing");
            }
            let loaded = VideoModel::load_on(self.backend, &config, &weights);
            loaded.map(Arc::new).map_err(|error| format!("weights {weights:?}: {}", chain(&error)))
        };
        self.model.get_or_init(load).clone().map_err(|text| Fault::infrastructure("no_model", text))
    }
}

impl VideoStage {
    /// Returns what it can do without a model.
    fn bare(&self) -> Abilities {
        Abilities { devices: self.devices.clone(), shares_device: self.shares_device, ..Abilities::default() }
    }
}

impl MakerFactory for VideoStage {
    fn role(&self) -> Role {
        Role::Video
    }

    fn compute_class(&self) -> String {
        let wide = if avx512() { "avx512" } else { "baseline" };
        let how = match self.backend {
            // Its results are the same for any number of threads.
            Backend::Cpu => "backend cpu".to_owned(),
            Backend::Framework => {
                let threads = std::env::var_os("RAYON_NUM_THREADS");
                let threads = threads.map_or("all".to_owned(), |n| n.to_string_lossy().into_owned());
                format!("backend framework, threads {threads}")
            }
            Backend::Vulkan | Backend::Cuda => format!("backend {}", self.backend.name()),
        };
        format!("video {} {wide}, {how}, model {}", std::env::consts::ARCH, self.abilities().video_model)
    }

    fn abilities(&self) -> Abilities {
        match self.model() {
            Ok(model) => Abilities {
                video_model: model.digest(),
                chunk_ticks: u32::try_from(model.config().frames_per_chunk()).unwrap_or(u32::MAX),
                frame_px: [model.config().video.width_px, model.config().video.height_px],
                layout_memory_ticks: u32::try_from(model.config().layout_memory_ticks()).unwrap_or(u32::MAX),
                ..self.bare()
            },
            Err(fault) => {
                tracing::warn!(%fault, "no video model; the other observation sources still work");
                self.bare()
            }
        }
    }

    fn open(&self, scene: Arc<SceneMessage>) -> Result<Box<dyn Maker>, Fault> {
        match scene.spec.observation {
            ObservationSource::Dreamstream => {
                let model = self.model()?;
                if model.digest() != scene.spec.video_model {
                    return Err(Fault::infrastructure(
                        "other_model",
                        format!(
                            "the episode asks for video model {:?}, this worker has {:?}",
                            scene.spec.video_model,
                            model.digest()
                        ),
                    ));
                }
                Ok(Box::new(Rollouts::new(model, scene)))
            }
            ObservationSource::Reference | ObservationSource::SimRgb | ObservationSource::Layout => {
                Ok(Box::new(Rendered::new(scene)?))
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
fn avx512() -> bool {
    std::arch::is_x86_feature_detected!("avx512f")
}

#[cfg(not(target_arch = "x86_64"))]
fn avx512() -> bool {
    false
}
