//! Published models from their files, each checked by names and shapes before a value is read, or with drawn weights.

use std::path::{Path, PathBuf};

use ds_graph::dit::Dit;
use ds_graph::published::clip::Clip;
use ds_graph::published::tae::{self, Tae};
use ds_graph::published::umt5::Umt5;
use ds_graph::published::wan_vae::{WanVae, WanVaeShape};
use ds_nn::WeightsError;
use ds_nn::body::Transformer;
use ds_nn::checkpoint::{Checkpoint, CheckpointError, Finite, Naming};
use ds_nn::sentencepiece::Tokeniser;
use ds_space::{Digest, DigestWriter};

use crate::backend::Backend;
use crate::codec::Codec;
use crate::conditions::{Conditions, PromptEncoder};
use crate::config::{ConfigError, ModelConfig};
use crate::error::VideoError;

/// The networks of a model.
pub(crate) struct Parts {
    pub(crate) dit: Box<dyn Transformer>,
    pub(crate) codec: Codec,
    pub(crate) conditions: Conditions,
    pub(crate) digest: Digest,
}

/// Reads the files of a published configuration, which lie in a folder.
pub(crate) fn load(backend: Backend, config: &ModelConfig, folder: &Path) -> Result<Parts, VideoError> {
    ready(backend)?;
    let linear = config.precision.linear.into();
    let mut files = Files { folder, digest: DigestWriter::new() };
    files.digest.digest(&config.digest());
    let (weights, shape, vae_shape) = (&config.weights, config.dit(), sizes(config));
    let dit = files.network("weights.transformer", &weights.transformer, |file| {
        Dit::load(&shape, &file.fit(&shape.declare(), Naming::Transformer)?, Finite::Checked, linear)
    })?;
    let naming = if vae_shape.folded { Naming::Vae22 } else { Naming::Vae21 };
    let vae = files.network("weights.vae", &weights.vae, |file| {
        let fitted = file.fit(&vae_shape.declare(), naming)?;
        WanVae::load(&vae_shape, &fitted, Finite::Checked, config.precision.vae_decode.into())
    })?;
    let tiny = (config.vae.kind == "taew21").then(|| {
        files.network("weights.decoder", &weights.decoder, |file| {
            Tae::load(&file.fit(&tae::declare(), Naming::Plain)?, Finite::Checked)
        })
    });
    let tiny = tiny.transpose()?;
    let text = (config.model.text_len > 0).then(|| prompt_encoder(&mut files, config)).transpose()?;
    let image = (config.model.clip_dim > 0).then(|| {
        let shape = config.clip();
        files.network("weights.image", &weights.image, |file| {
            Clip::load(&shape, &file.fit(&shape.declare(), Naming::Clip)?, Finite::Checked, linear)
        })
    });
    let conditions = Conditions::Encoded { text, image: image.transpose()? };
    Ok(Parts { dit: Box::new(dit), codec: Codec::wan(vae, tiny), conditions, digest: files.digest.finish() })
}

fn prompt_encoder(files: &mut Files<'_>, config: &ModelConfig) -> Result<PromptEncoder, VideoError> {
    let (weights, shape) = (&config.weights, config.umt5());
    let precision = config.precision.linear.into();
    let encoder =
        files.network("weights.text", &weights.text, |file| Umt5::load(&shape, file, Finite::Checked, precision))?;
    let path = files.path("weights.tokeniser", &weights.tokeniser)?;
    let tokeniser = Tokeniser::load(&path)?;
    if tokeniser.size() as usize > shape.vocabulary {
        return Err(VideoError::Vocabulary { tokens: tokeniser.size() as usize, vocabulary: shape.vocabulary });
    }
    files.digest.text("weights.tokeniser").digest(&tokeniser.digest());
    Ok(PromptEncoder { encoder, tokeniser })
}

/// Makes the networks of a published configuration of drawn weights.
pub(crate) fn drawn(backend: Backend, config: &ModelConfig) -> Result<Parts, VideoError> {
    ready(backend)?;
    let tiny = (config.vae.kind == "taew21").then(Tae::drawn);
    let codec = Codec::wan(WanVae::drawn(&sizes(config), config.precision.vae_decode.into()), tiny);
    let dit = Box::new(Dit::drawn(&config.dit(), config.precision.linear.into()));
    let digest = DigestWriter::new().digest(&config.digest()).text("drawn").finish();
    Ok(Parts { dit, codec, conditions: Conditions::Hashed, digest })
}

fn ready(backend: Backend) -> Result<(), VideoError> {
    if backend == Backend::Cpu {
        return Err(WeightsError::Backend { backend: backend.name() }.into());
    }
    backend.ready()?;
    Ok(())
}

fn sizes(config: &ModelConfig) -> WanVaeShape {
    config.wan_vae().expect("the configuration is of a published model")
}

/// The folder of the files, and the digest over what was read of it.
struct Files<'a> {
    folder: &'a Path,
    digest: DigestWriter,
}

impl Files<'_> {
    fn path(&self, key: &'static str, file: &Path) -> Result<PathBuf, VideoError> {
        if file.as_os_str().is_empty() {
            let rule = "this model needs a file here, or weights.drawn";
            return Err(ConfigError::Field { field: key, value: "empty".to_owned(), rule }.into());
        }
        Ok(self.folder.join(file))
    }

    /// Opens a checkpoint and binds a network to it.
    fn network<N>(
        &mut self,
        key: &'static str,
        file: &Path,
        bind: impl FnOnce(Checkpoint) -> Result<N, CheckpointError>,
    ) -> Result<N, VideoError> {
        let path = self.path(key, file)?;
        let refused = |source| VideoError::Checkpoint { key, source };
        let checkpoint = Checkpoint::open(&path).map_err(refused)?;
        self.digest.text(key).digest(&checkpoint.digest());
        bind(checkpoint).map_err(refused)
    }
}
