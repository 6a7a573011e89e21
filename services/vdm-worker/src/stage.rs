//! The video stage: picks the episode's observation source.

use std::path::PathBuf;
use std::sync::Arc;

use ds_process::maker::{Abilities, Fault, Maker, MakerFactory};
use ds_topic::{ObservationSource, Role, SceneMessage};
use ds_video::{Backend, VideoModel};

use crate::models::Models;
use crate::per_frame::OneByOne;
use crate::rendered::Rendered;
use crate::rollout::Rollouts;

/// Opens an observation source for each episode that the instance is given; the weights are loaded once.
pub struct VideoStage {
    models: Models,
    devices: Vec<String>,
    shares_device: bool,
}

impl VideoStage {
    /// Names the model's configuration; its weights lie where [`ds_video::ModelConfig::weights_beside`] says unless named.
    #[must_use]
    pub fn new(config: PathBuf, weights: Option<PathBuf>) -> Self {
        Self { models: Models::new(config, weights), devices: Vec::new(), shares_device: false }
    }

    /// Names what computes.
    #[must_use]
    pub fn with_backend(mut self, backend: Backend) -> Self {
        self.models.backend = backend;
        self
    }

    /// Names the transformer of the source without guidance; without it `arms/no_guidance.safetensors` beside the model.
    #[must_use]
    pub fn with_no_guidance(mut self, file: Option<PathBuf>) -> Self {
        self.models.no_guidance = file;
        self
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
        self.models.own()
    }

    /// Loads what the frames of a source are generated with, at the first call.
    ///
    /// # Errors
    /// If configuration or weights are refused or not there; the text says what makes them.
    pub fn model_of(&self, source: ObservationSource) -> Result<Arc<VideoModel>, Fault> {
        Ok(self.models.of(source)?.0)
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
        let how = match self.models.backend {
            // Its results are the same for any number of threads.
            Backend::Cpu => "backend cpu".to_owned(),
            Backend::Framework => {
                let threads = std::env::var_os("RAYON_NUM_THREADS");
                let threads = threads.map_or("all".to_owned(), |n| n.to_string_lossy().into_owned());
                format!("backend framework, threads {threads}")
            }
            Backend::Vulkan | Backend::Cuda => format!("backend {}", self.models.backend.name()),
        };
        format!("video {} {wide}, {how}, model {}", std::env::consts::ARCH, self.abilities().video_model)
    }

    fn abilities(&self) -> Abilities {
        match self.model() {
            Ok(model) => Abilities {
                video_model: model.digest(),
                source_models: self.models.digests().iter().map(|(source, digest)| (source.name(), *digest)).collect(),
                chunk_ticks: u32::try_from(model.config().frames_per_chunk()).unwrap_or(u32::MAX),
                frame_px: [model.config().video.width_px, model.config().video.height_px],
                layout_memory_ticks: u32::try_from(model.config().layout_memory_ticks()).unwrap_or(u32::MAX),
                layout_geometry: model.config().control.carried,
                ..self.bare()
            },
            Err(fault) => {
                tracing::warn!(%fault, "no video model; the other observation sources still work");
                self.bare()
            }
        }
    }

    fn open(&self, scene: Arc<SceneMessage>) -> Result<Box<dyn Maker>, Fault> {
        let source = scene.spec.observation;
        if !source.is_generated() {
            return Ok(Box::new(Rendered::new(scene)?));
        }
        let (model, digest) = self.models.of(source)?;
        let asked = scene.spec.video_model;
        if digest != asked {
            let text = format!("the episode asks for video model {asked:?}, this worker has {digest:?}");
            return Err(Fault::infrastructure("other_model", text));
        }
        if source.has_cache() {
            Ok(Box::new(Rollouts::new(model, scene)))
        } else {
            Ok(Box::new(OneByOne::new(&model, &scene)?))
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
