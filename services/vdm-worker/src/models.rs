//! The video models of the generated sources: the worker's own, and what its ablations are made of, each loaded once.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use ds_process::maker::{Fault, chain};
use ds_space::Digest;
use ds_topic::ObservationSource;
use ds_video::ablation::per_frame_digest;
use ds_video::{Ablated, Ablation, Backend, ModelConfig, VideoModel};

/// Reads and checks a model's configuration.
///
/// # Errors
/// The text names the file and what is wrong with it.
pub fn load_config(path: &Path) -> Result<ModelConfig, String> {
    let text = std::fs::read_to_string(path).map_err(|error| format!("{error}: {path:?}"))?;
    ModelConfig::parse(&text).map_err(|error| format!("{error}: {path:?}"))
}

type Loaded = Result<Arc<VideoModel>, String>;

/// The models of a worker.
pub(crate) struct Models {
    pub(crate) config: PathBuf,
    pub(crate) weights: Option<PathBuf>,
    /// The transformer of the source without guidance; beside the model unless named.
    pub(crate) no_guidance: Option<PathBuf>,
    pub(crate) backend: Backend,
    own: OnceLock<Loaded>,
    ablated: Mutex<BTreeMap<ObservationSource, Loaded>>,
    digests: OnceLock<Vec<(ObservationSource, Digest)>>,
}

impl Models {
    pub(crate) fn new(config: PathBuf, weights: Option<PathBuf>) -> Self {
        let (own, ablated, digests) = (OnceLock::new(), Mutex::default(), OnceLock::new());
        Self { config, weights, no_guidance: None, backend: Backend::default(), own, ablated, digests }
    }

    /// Returns the worker's own model.
    pub(crate) fn own(&self) -> Result<Arc<VideoModel>, Fault> {
        let load = || {
            let config = load_config(&self.config)?;
            let weights = self.weights_file(&config);
            if config.weights.drawn {
                tracing::warn!(model = config.name, "the weights are drawn, frames mean nothing");
            }
            let loaded = VideoModel::load_on(self.backend, &config, &weights);
            loaded.map(Arc::new).map_err(|error| format!("weights {weights:?}: {}", chain(&error)))
        };
        self.own.get_or_init(load).clone().map_err(missing)
    }

    /// Returns the model of a source and the digest that an episode names it by.
    pub(crate) fn of(&self, source: ObservationSource) -> Result<(Arc<VideoModel>, Digest), Fault> {
        let own = self.own()?;
        match source {
            ObservationSource::PerFrame => {
                let digest = per_frame_digest(&own.digest());
                Ok((own, digest))
            }
            _ if self.ablation(source).is_none() => {
                let digest = own.digest();
                Ok((own, digest))
            }
            _ => {
                let mut ablated = self.ablated.lock().unwrap_or_else(PoisonError::into_inner);
                let load = || {
                    let found = self.ablated(source).and_then(|ablated| Ok(ablated.model(self.backend)?));
                    found.map(Arc::new).map_err(|error: Cause| said(source, &*error))
                };
                let model = ablated.entry(source).or_insert_with(load).clone().map_err(missing)?;
                let digest = model.digest();
                Ok((model, digest))
            }
        }
    }

    /// Returns the digests of the sources other than the own model's; those whose files are not there are left out.
    pub(crate) fn digests(&self) -> &[(ObservationSource, Digest)] {
        self.digests.get_or_init(|| {
            let digest = |source: ObservationSource| match source {
                ObservationSource::Dreamstream => None,
                ObservationSource::PerFrame => self.own().ok().map(|own| per_frame_digest(&own.digest())),
                _ => self.ablated(source).ok().map(|ablated| ablated.digest()),
            };
            let generated = ObservationSource::ALL.into_iter().filter(|source| source.is_generated());
            generated.filter_map(|source| Some((source, digest(source)?))).collect()
        })
    }

    fn weights_file(&self, config: &ModelConfig) -> PathBuf {
        self.weights.clone().unwrap_or_else(|| config.weights_beside(&self.config))
    }

    fn ablation(&self, source: ObservationSource) -> Option<Ablation> {
        match source {
            ObservationSource::DreamstreamCleanCache => Some(Ablation::CleanCache),
            ObservationSource::DreamstreamNoLayout => Some(Ablation::NoLayout),
            ObservationSource::DreamstreamNoGuidance => Some(Ablation::Transformer(self.unguided())),
            _ => None,
        }
    }

    /// Returns where the transformer of the source without guidance lies.
    fn unguided(&self) -> PathBuf {
        let beside = || self.config.parent().unwrap_or(Path::new("")).join("arms/no_guidance.safetensors");
        self.no_guidance.clone().unwrap_or_else(beside)
    }

    fn ablated(&self, source: ObservationSource) -> Result<Ablated, Cause> {
        let ablation = self.ablation(source).ok_or("nothing is taken from it")?;
        if let Ablation::Transformer(path) = &ablation
            && !path.is_file()
        {
            return Err(format!(
                "there is no student of a training without guidance at {path:?}; `just arms` trains it, and the worker's \
                 setting video.no_guidance names another file"
            )
            .into());
        }
        let config = load_config(&self.config)?;
        Ok(Ablated::read(&config, &self.weights_file(&config), &ablation)?)
    }
}

type Cause = Box<dyn std::error::Error + Send + Sync>;

fn missing(text: String) -> Fault {
    Fault::infrastructure("no_model", text)
}

fn said(source: ObservationSource, error: &(dyn std::error::Error + 'static)) -> String {
    format!("source {:?}: {}", source.name(), chain(error))
}
