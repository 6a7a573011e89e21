//! What can be wrong with perception networks and their training.

use std::path::Path;

/// Says why a network cannot be used or trained.
#[derive(Debug, thiserror::Error)]
pub enum PerceptionError {
    /// A recipe holds a wrong value.
    #[error("perception recipe: field {field:?}: {rule}")]
    Recipe {
        /// The field.
        field: &'static str,
        /// The broken rule.
        rule: &'static str,
    },
    /// A recipe is not TOML of the expected keys.
    #[error("perception recipe cannot be read")]
    Syntax(#[from] toml::de::Error),
    /// A weights file is wrong.
    #[error("the weights file {path:?} is refused")]
    File {
        /// Where.
        path: String,
        /// What is wrong.
        #[source]
        source: ds_nn::safetensors::FileError,
    },
    /// Weights do not fit the network.
    #[error("weights do not fit the network")]
    Weights(#[from] ds_nn::WeightsError),
    /// A checkpoint belongs to another recipe or holds no step.
    #[error("checkpoint {path:?} {reason}")]
    Checkpoint {
        /// Where.
        path: String,
        /// What is wrong.
        reason: &'static str,
    },
    /// A frame cannot be rendered.
    #[error("a frame of scenario {scenario:?} cannot be rendered")]
    Frame {
        /// The scenario.
        scenario: String,
        /// What the camera says.
        #[source]
        source: ds_raster::ImageError,
    },
    /// The map cannot be rendered.
    #[error("the map of scenario {scenario:?} cannot be rendered")]
    Layout {
        /// The scenario.
        scenario: String,
        /// What the renderer says.
        #[source]
        source: ds_layout::LayoutError,
    },
    /// A scenario has no camera.
    #[error("scenario {scenario:?} has no camera")]
    NoCamera {
        /// The scenario.
        scenario: String,
    },
    /// The loss is not finite.
    #[error("the loss of step {step} is {loss}")]
    Diverged {
        /// The step.
        step: u32,
        /// The loss.
        loss: f64,
    },
}

impl PerceptionError {
    /// Wraps what is wrong with a weights file.
    pub(crate) fn file(path: &Path) -> impl FnOnce(ds_nn::safetensors::FileError) -> Self {
        let path = path.display().to_string();
        move |source| Self::File { path, source }
    }
}
