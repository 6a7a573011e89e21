//! Why a manifest or a network is refused, or an answer failed.

/// Says why a manifest or a network is refused, or an answer failed.
#[derive(Debug, thiserror::Error)]
pub enum OnnxError {
    /// A file cannot be read.
    #[error("read {path}")]
    Read {
        /// The file.
        path: String,
        /// Why.
        #[source]
        source: std::io::Error,
    },
    /// The manifest is no TOML of the known form.
    #[error("manifest {path}")]
    Form {
        /// The file.
        path: String,
        /// Where and why.
        #[source]
        source: Box<toml::de::Error>,
    },
    /// A field of the manifest has a value that it cannot have.
    #[error("manifest field {field:?} {problem}")]
    Field {
        /// The field, with its table.
        field: String,
        /// What is wrong with it, with the value.
        problem: String,
    },
    /// The file is not the one that the manifest means.
    #[error("{path} has digest {found}, the manifest says {expected}")]
    Digest {
        /// The network's file.
        path: String,
        /// What its bytes give.
        found: String,
        /// What the manifest says.
        expected: String,
    },
    /// The network needs operators that are not known.
    #[error("network {path}: {operators}")]
    Operators {
        /// The network's file.
        path: String,
        /// Which, and how many nodes have each.
        operators: String,
    },
    /// Inputs or outputs do not fit the manifest.
    #[error("network {path}: {problem}")]
    Shape {
        /// The network's file.
        path: String,
        /// Which, and what there is instead.
        problem: String,
    },
    /// The library that computes networks refused one or failed in it.
    #[error("network {path}: {doing}: {why}")]
    Compute {
        /// The network's file.
        path: String,
        /// What was being done.
        doing: &'static str,
        /// Its words.
        why: String,
    },
}
