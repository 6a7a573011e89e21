//! What can be wrong with a published checkpoint; every variant names the file or the tensor.

use ds_pickle::PickleError;

use crate::safetensors::FileError;

/// Says why a checkpoint is refused.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// Reading failed.
    #[error("checkpoint cannot be {doing}: {path:?}")]
    Io {
        /// What was being done.
        doing: &'static str,
        /// The file.
        path: String,
        /// The system's answer.
        #[source]
        source: std::io::Error,
    },
    /// The file is none of the known kinds.
    #[error("checkpoint is {reason}: {path:?}")]
    Kind {
        /// What it looks like.
        reason: String,
        /// The file.
        path: String,
    },
    /// A safetensors file is broken.
    #[error("safetensors file is refused: {path:?}")]
    Safetensors {
        /// The file.
        path: String,
        /// What is wrong.
        #[source]
        source: FileError,
    },
    /// The index of a sharded checkpoint is broken.
    #[error("index of shards: {reason}: {path:?}")]
    Index {
        /// What is wrong.
        reason: String,
        /// The file.
        path: String,
    },
    /// A zip archive is broken or not of the kind that PyTorch writes.
    #[error("zip archive: {reason}: {path:?}")]
    Zip {
        /// What is wrong.
        reason: String,
        /// The file.
        path: String,
    },
    /// The pickle inside an archive is broken.
    #[error("{refusal}: {path:?}")]
    Pickle {
        /// What is wrong, and where in `data.pkl`.
        refusal: PickleError,
        /// The file.
        path: String,
    },
    /// The pickle asks for code beyond the rebuilding of tensors.
    #[error("pickle names the code {global:?}, which no set of tensors needs; nothing was executed: {path:?}")]
    Code {
        /// Module and name.
        global: String,
        /// The file.
        path: String,
    },
    /// A tensor of a pickle lies outside its storage.
    #[error("weight {name:?} of shape {shape:?} asks for {asked} values of a storage of {available}")]
    Storage {
        /// The weight.
        name: String,
        /// Its stated shape.
        shape: Vec<usize>,
        /// Values asked for.
        asked: String,
        /// Values there are.
        available: usize,
    },
    /// Two tensors have one name once prefixes are off.
    #[error("weights {first:?} and {second:?} are both {name:?}")]
    Ambiguous {
        /// One.
        first: String,
        /// The other.
        second: String,
        /// What both are called without prefixes.
        name: String,
    },
    /// A tensor has a type that cannot be weights.
    #[error("weight {name:?} has type {dtype:?}, F32, F16 or BF16 expected")]
    Type {
        /// The weight.
        name: String,
        /// Its type.
        dtype: String,
    },
    /// A declared weight is absent.
    #[error("weight {name:?} is missing, looked for as {looked_for:?}")]
    Missing {
        /// Its name.
        name: String,
        /// Its names in this file's convention.
        looked_for: Vec<String>,
    },
    /// A weight that the model does not have.
    #[error("weight {name:?} is not part of the model")]
    Unexpected {
        /// Its name in the file.
        name: String,
    },
    /// A weight has another shape.
    #[error("weight {name:?} has shape {found:?}, {expected:?} expected")]
    Shape {
        /// Its name.
        name: String,
        /// The declared shape.
        expected: Vec<usize>,
        /// The shape found.
        found: Vec<usize>,
    },
    /// A weight holds a value that is not finite.
    #[error("weight {name:?} holds {value} at index {index}")]
    NotFinite {
        /// Its name.
        name: String,
        /// Index of the first such value.
        index: usize,
        /// That value.
        value: f32,
    },
}
