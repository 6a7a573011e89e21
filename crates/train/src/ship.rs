//! Puts the trained parts into the one weights file that ships, next to the model's configuration.

use ds_nn::safetensors::WeightsFile;

use crate::Progress;
use crate::checkpoint::Run;
use crate::config::TrainConfig;
use crate::error::TrainError;
use crate::latents::stored_autoencoder;

/// Writes `<model>.safetensors` beside the model's configuration, with the digest of the configuration.
///
/// # Errors
/// If a part is missing or the file cannot be written.
pub fn run(config: &TrainConfig, progress: &mut dyn Progress) -> Result<(), TrainError> {
    let model = config.model()?;
    let student = WeightsFile::read(&Run::weights_path(&config.folder, "student"))?;
    let mut file = WeightsFile::default();
    let stage = if model.control.decoder { "decoder" } else { "autoencoder" };
    file.weights.absorb("vae.", &stored_autoencoder(config, stage)?);
    file.weights.absorb("dit.", &student.weights);
    file.weights.check(&ds_video::VideoModel::declare(&model))?;
    let mut note = |key: &str, value: String| file.metadata.insert(key.to_owned(), value);
    note("config_digest", model.digest().to_string());
    note("student_steps", student.metadata.get("step").cloned().unwrap_or_default());
    note("licence", "Apache-2.0".to_owned());
    let path = config.base.join(&config.model).with_extension("safetensors");
    file.write(&path)?;
    progress.note(&format!("{} parameters in {}", file.weights.parameters(), path.display()));
    Ok(())
}
