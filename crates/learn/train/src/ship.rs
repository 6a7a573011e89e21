//! Puts the trained parts together: into a model, or into one weights file of half precision, next to the model's configuration, and takes such a
//! file apart again, so that other recipes can go on from weights that ship.

use std::path::Path;

use ds_nn::safetensors::WeightsFile;
use ds_nn::{Declared, Weights};
use ds_video::{ModelConfig, VideoModel};

use crate::Progress;
use crate::config::TrainConfig;
use crate::error::TrainError;
use crate::sets::stored_autoencoder;

/// Layers of the decoder that see the layout.
const GUIDE: &str = "decoder.guide.";
/// The stage whose weights are no transformer.
const AUTOENCODER: &str = "autoencoder";
const DECODER: &str = "decoder";

/// Writes the student, or the transformer that another stage left, with the autoencoder to `out`, or beside the model's
/// configuration, with the digest of the configuration. `of` may be `autoencoder`: that alone is written then, for recipes
/// that go on from it whatever transformer they train.
///
/// # Errors
/// If a part is missing or the file cannot be written.
pub fn run(
    config: &TrainConfig,
    of: Option<&str>,
    out: Option<&Path>,
    progress: &mut dyn Progress,
) -> Result<(), TrainError> {
    let model = config.model()?;
    let mut file = WeightsFile::default();
    let path = || out.map_or_else(|| config.base.join(&config.model).with_extension("safetensors"), Path::to_path_buf);
    file.metadata.insert("licence".to_owned(), "Apache-2.0".to_owned());
    if of == Some(AUTOENCODER) {
        // A decoder that knew no student is still the autoencoder's own.
        let own = config.decoder.as_ref().is_some_and(|decoder| decoder.rollouts == 0);
        let stage = if own && config.folder.join("decoder.safetensors").exists() { DECODER } else { AUTOENCODER };
        file.weights.absorb("vae.", &stored_autoencoder(config, stage)?);
        file.weights.check(&alone(&model))?;
        file.metadata.insert("trained".to_owned(), stage.to_owned());
        return write(&file, &path(), progress);
    }
    let stage = if model.control.decoder_layers > 0 { "decoder" } else { "autoencoder" };
    file.weights.absorb("vae.", &config.averaged(stored_autoencoder(config, stage)?)?);
    let transformer = of.map_or_else(|| student_weights(config), |stage| config.weights_of(stage))?;
    file.weights.absorb("dit.", &transformer);
    file.weights.check(&VideoModel::declare(&model))?;
    file.metadata.insert("config_digest".to_owned(), model.digest().to_string());
    write(&file, &path(), progress)
}

fn write(file: &WeightsFile, path: &Path, progress: &mut dyn Progress) -> Result<(), TrainError> {
    file.write_half(path)?;
    progress.note(&format!("{} parameters in {}", file.weights.parameters(), path.display()));
    Ok(())
}

/// Lists the weights of a file that holds an autoencoder alone: without the decoder's guidance, as its stage trains it.
fn alone(model: &ModelConfig) -> Vec<Declared> {
    let mut list = VideoModel::declare(model);
    list.retain(|weight| weight.name.strip_prefix("vae.").is_some_and(|name| !name.starts_with(GUIDE)));
    list
}

/// Returns the weights of the most refined student.
pub(crate) fn student_weights(config: &TrainConfig) -> Result<Weights, TrainError> {
    let refined = config.finished("self_forcing.safetensors").exists();
    config.weights_of(if refined { "self_forcing" } else { "ode" })
}

/// Puts a student and the autoencoder of a stage together.
pub(crate) fn assembled(config: &TrainConfig, student: &Weights, stage: &str) -> Result<VideoModel, TrainError> {
    let mut weights = Weights::default();
    weights.absorb("vae.", &stored_autoencoder(config, stage)?);
    weights.absorb("dit.", student);
    Ok(VideoModel::new_on(config.backend, &preset(config, stage)?, &weights)?)
}

/// Returns the preset with the decoder's guidance switched as the named stage has it.
fn preset(config: &TrainConfig, stage: &str) -> Result<ModelConfig, TrainError> {
    let mut model = config.model()?;
    if stage != DECODER {
        model.control.decoder_layers = 0;
        model.control.carried = false;
    }
    Ok(model)
}

/// Takes a shipped file apart into what its stages leave in the work folder: the autoencoder, without the decoder's
/// guidance, unless there is one, and the transformer as that of stage `of`; with `autoencoder` for `of` nothing but that,
/// whether or not the file holds more, with `decoder` also the guided decoder.
///
/// # Errors
/// If the file is of another preset, the stage has weights already or another autoencoder is there.
pub fn unpack(config: &TrainConfig, of: &str, shipped: &Path, progress: &mut dyn Progress) -> Result<(), TrainError> {
    let model = config.model()?;
    let weights = VideoModel::read(&model, shipped)?;
    let mut autoencoder = weights.part("vae.");
    let guided = autoencoder.clone();
    if of != AUTOENCODER {
        weights.check(&VideoModel::declare(&model))?;
    }
    let guides: Vec<String> =
        autoencoder.iter().map(|(name, _)| name.to_owned()).filter(|name| name.starts_with(GUIDE)).collect();
    for name in guides {
        autoencoder.remove(&name);
    }
    let mut named = Weights::default();
    named.absorb("vae.", &autoencoder);
    named.check(&alone(&model))?;
    std::fs::create_dir_all(&config.folder).map_err(TrainError::io("work folder", &config.folder))?;
    let further = match of {
        AUTOENCODER => None,
        DECODER => Some((DECODER, guided)),
        transformer => Some((transformer, weights.part("dit."))),
    };
    for (stage, weights) in std::iter::once((AUTOENCODER, autoencoder)).chain(further) {
        let path = config.folder.join(format!("{stage}.safetensors"));
        if path.exists() {
            if WeightsFile::read(&path)?.weights.digest() == weights.digest() {
                continue;
            }
            let reason = "the work folder has other weights of this stage already".to_owned();
            return Err(TrainError::Checkpoint { path: path.display().to_string(), reason });
        }
        WeightsFile { weights, ..WeightsFile::default() }.write(&path)?;
        progress.note(&format!("{stage} in {}", path.display()));
    }
    Ok(())
}
