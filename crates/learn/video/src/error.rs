//! What can be wrong with a model's files, inputs or recovery log.

use ds_space::Digest;

use crate::config::ConfigError;

/// Says why the video model refuses.
#[derive(Debug, thiserror::Error)]
pub enum VideoError {
    /// The configuration is wrong.
    #[error("the model configuration is refused")]
    Config(#[from] ConfigError),
    /// The weights file is wrong.
    #[error("the weights file is refused")]
    File(#[from] ds_nn::safetensors::FileError),
    /// The weights do not fit the configuration.
    #[error("the weights do not fit the configuration")]
    Weights(#[from] ds_nn::WeightsError),
    /// Only own models can do without a part.
    #[error("nothing can be taken from a published model")]
    Ablation,
    /// The device is not there.
    #[error("the device is refused")]
    Device(#[from] ds_graph::device::DeviceError),
    /// A file of a published model is wrong.
    #[error("{key} is refused")]
    Checkpoint {
        /// The configuration's key that names it.
        key: &'static str,
        /// What is wrong.
        #[source]
        source: ds_nn::checkpoint::CheckpointError,
    },
    /// The tokeniser of a published model is wrong.
    #[error("weights.tokeniser is refused")]
    Tokeniser(#[from] ds_nn::sentencepiece::TokeniserError),
    /// The tokeniser has tokens that the prompt encoder does not know.
    #[error("weights.tokeniser has {tokens} tokens, text_encoder.vocabulary is {vocabulary}")]
    Vocabulary {
        /// Tokens of the tokeniser.
        tokens: usize,
        /// Tokens of the encoder.
        vocabulary: usize,
    },
    /// The prompt encoder's table of embeddings cannot be read.
    #[error("the prompt cannot be encoded")]
    Prompt(#[source] ds_nn::checkpoint::CheckpointError),
    /// A replay was given too few layouts for the encoder's memory of them.
    #[error("{found} layouts before the last commit, {expected} expected")]
    Remembered {
        /// Layouts given.
        found: usize,
        /// Layouts needed.
        expected: usize,
    },
    /// The weights were trained for another configuration.
    #[error("weights belong to configuration {found:?}, not to {expected:?}")]
    OtherConfig {
        /// Digest of the configuration given.
        expected: String,
        /// Digest named by the weights file.
        found: String,
    },
    /// A call without layouts.
    #[error("generation was asked for without layouts")]
    NoLayouts,
    /// The network gave a value that is not finite.
    #[error("chunk {chunk} of the video model is not finite")]
    NotFinite {
        /// The chunk.
        chunk: u32,
    },
    /// An entry of a cache log cannot belong to this rollout.
    #[error("cache entry {chunk}: field {field:?} {reason}")]
    Entry {
        /// The chunk it claims.
        chunk: u32,
        /// The field.
        field: &'static str,
        /// What is wrong.
        reason: String,
    },
    /// Replaying a cache log gave another state than the log says.
    #[error("recovery mismatch at chunk {chunk}: {what} is {found}, the log says {expected}")]
    RecoveryMismatch {
        /// The chunk.
        chunk: u32,
        /// Which digest.
        what: &'static str,
        /// The digest of the log.
        expected: Digest,
        /// The digest after the replay.
        found: Digest,
    },
}
