//! What can go wrong in an evaluation.

use std::path::Path;

/// Says why an evaluation ended early.
#[derive(Debug, thiserror::Error)]
pub enum EvaluationError {
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
    /// The configuration is not TOML of the expected keys.
    #[error("the evaluation's configuration cannot be read")]
    Syntax(#[from] toml::de::Error),
    /// A value of the configuration breaks a rule.
    #[error("the evaluation's configuration: {field}: {rule}")]
    Config {
        /// The field.
        field: String,
        /// The broken rule.
        rule: String,
    },
    /// An arm cannot be loaded.
    #[error("arm {arm:?} cannot be loaded")]
    Arm {
        /// The arm.
        arm: String,
        /// Why.
        #[source]
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// A rollout failed.
    #[error("arm {arm:?} failed on {drive}")]
    Rollout {
        /// The arm.
        arm: String,
        /// The drive.
        drive: String,
        /// Why.
        #[source]
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// First frames cannot be made.
    #[error("first frames cannot be made")]
    FirstFrames {
        /// Why.
        #[source]
        source: ds_train::TrainError,
    },
    /// A perception network cannot be used.
    #[error("a perception network cannot be used")]
    Perception(#[from] ds_perception::PerceptionError),
    /// Stills cannot be written.
    #[error("stills beside a video cannot be written")]
    Stills {
        /// Why.
        #[source]
        source: ds_train::TrainError,
    },
    /// A layout cannot be rendered.
    #[error("a layout cannot be rendered")]
    Layout(#[from] ds_layout::LayoutError),
    /// Features cannot be compared.
    #[error("features cannot be compared")]
    Fidelity(#[from] ds_stats::SampleError),
    /// Features of a policy cannot be compared.
    #[error(transparent)]
    Panel(#[from] ds_fidelity::FidelityError),
    /// A network that was given cannot look at frames.
    #[error("{network} cannot look at {frames}")]
    Given {
        /// What it was given for.
        network: String,
        /// Whose frames.
        frames: String,
        /// Why.
        #[source]
        source: ds_onnx::OnnxError,
    },
    /// A policy cannot look at a frame.
    #[error("policy {policy:?} cannot look at {frames}")]
    Policy {
        /// The policy.
        policy: String,
        /// Whose frames.
        frames: String,
        /// Why.
        #[source]
        source: ds_policy::PolicyError,
    },
    /// A scenario has no camera.
    #[error("scenario {scenario:?} has no camera")]
    NoCamera {
        /// The scenario.
        scenario: String,
    },
    /// A stored record or a report is not what it should be.
    #[error("record {path:?} cannot be read; remove it to have it made again")]
    Record {
        /// Where.
        path: String,
        /// Why.
        #[source]
        source: serde_json::Error,
    },
    /// An animation cannot be encoded.
    #[error("an animation cannot be encoded")]
    Film(#[from] gif::EncodingError),
    /// The description of a case cannot be written.
    #[error(transparent)]
    Case(#[from] ds_diagnosis::CaseError),
    /// A picture cannot be encoded.
    #[error("a picture cannot be encoded")]
    Picture(#[from] ds_raster::ImageError),
}

impl EvaluationError {
    pub(crate) fn io(what: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.display().to_string();
        move |source| Self::Io { what, path, source }
    }

    pub(crate) fn config(field: impl Into<String>, rule: impl Into<String>) -> Self {
        Self::Config { field: field.into(), rule: rule.into() }
    }
}
