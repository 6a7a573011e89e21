//! Puts the trained parts into one weights file of half precision, next to the model's configuration.

use std::path::Path;

use ds_nn::safetensors::WeightsFile;

use crate::Progress;
use crate::config::TrainConfig;
use crate::decoder::student_weights;
use crate::error::TrainError;
use crate::sets::stored_autoencoder;

/// Writes the student, or the transformer that another stage left, with the autoencoder to `out`, or beside the model's
/// configuration, with the digest of the configuration.
///
/// # Errors
/// If a part is missing or the file cannot be written.
pub fn run(
    config: &TrainConfig,
    (of, out): (Option<&str>, Option<&Path>),
    progress: &mut dyn Progress,
) -> Result<(), TrainError> {
    let model = config.model()?;
    let mut file = WeightsFile::default();
    let stage = if model.control.decoder_layers > 0 { "decoder" } else { "autoencoder" };
    file.weights.absorb("vae.", &stored_autoencoder(config, stage)?);
    let transformer = of.map_or_else(|| student_weights(config), |stage| config.weights_of(stage))?;
    file.weights.absorb("dit.", &transformer);
    file.weights.check(&ds_video::VideoModel::declare(&model))?;
    let mut note = |key: &str, value: String| file.metadata.insert(key.to_owned(), value);
    note("config_digest", model.digest().to_string());
    note("licence", "Apache-2.0".to_owned());
    let path = out.map_or_else(|| config.base.join(&config.model).with_extension("safetensors"), Path::to_path_buf);
    file.write_half(&path)?;
    progress.note(&format!("{} parameters in {}", file.weights.parameters(), path.display()));
    Ok(())
}
