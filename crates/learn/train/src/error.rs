//! What can go wrong while training.

/// Says why a stage ended early.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// A file cannot be read or written.
    #[error("{what} {path:?} cannot be used")]
    Io {
        /// What the file is.
        what: &'static str,
        /// Where.
        path: String,
        /// The system's answer.
        #[source]
        source: std::io::Error,
    },
    /// The training configuration is wrong.
    #[error("training configuration: field {field:?}: {rule}")]
    Config {
        /// The field.
        field: &'static str,
        /// The broken rule.
        rule: String,
    },
    /// The training configuration is not TOML of the expected keys.
    #[error("training configuration cannot be read")]
    Syntax(#[from] toml::de::Error),
    /// The model configuration is wrong.
    #[error("the model configuration is refused")]
    Model(#[from] ds_video::ConfigError),
    /// A weights file is wrong.
    #[error("a weights file is refused")]
    File(#[from] ds_nn::safetensors::FileError),
    /// The device that is to compute is absent.
    #[error("the back end is refused")]
    Device(#[from] ds_graph::device::DeviceError),
    /// Weights do not fit the model.
    #[error("weights do not fit the model")]
    Weights(#[from] ds_nn::WeightsError),
    /// The video model refuses its input.
    #[error("the video model refuses its input")]
    Video(#[from] ds_video::VideoError),
    /// Something that was made is not finite.
    #[error("the {what} is not finite")]
    NotFinite {
        /// What was made.
        what: &'static str,
    },
    /// A clip set cannot be used.
    #[error("a clip set cannot be used")]
    Clips(#[from] ds_clips::ClipsError),
    /// A clip cannot be made.
    #[error("clip {index} cannot be made: {reason}")]
    Clip {
        /// The clip's index.
        index: u64,
        /// Why.
        reason: String,
    },
    /// A checkpoint holds something else than expected.
    #[error("checkpoint {path:?}: {reason}")]
    Checkpoint {
        /// Where.
        path: String,
        /// What is wrong.
        reason: String,
    },
    /// A checkpoint was made by another recipe.
    #[error(
        "checkpoint {path:?} was made by another recipe: {differences}; give the keys back, or remove the checkpoint or name another folder to train anew"
    )]
    Recipe {
        /// Where.
        path: String,
        /// The keys that differ, with what they were and are.
        differences: String,
    },
    /// The loss is not finite.
    #[error("the loss of step {step} is {loss}")]
    Diverged {
        /// The step.
        step: u32,
        /// The loss.
        loss: f32,
    },
}

impl TrainError {
    pub(crate) fn no_stage(field: &'static str) -> Self {
        Self::Config { field, rule: "the recipe does not describe this stage".to_owned() }
    }

    pub(crate) fn empty_sets() -> Self {
        Self::Config { field: "sets", rule: "the clip sets of this stage hold no clips".to_owned() }
    }

    pub(crate) fn io(what: &'static str, path: &std::path::Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.display().to_string();
        move |source| Self::Io { what, path, source }
    }
}
