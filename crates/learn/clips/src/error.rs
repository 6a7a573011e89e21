//! What can go wrong while clips are made or read.

use std::path::{Path, PathBuf};

/// Says why clips cannot be made or read.
#[derive(Debug, thiserror::Error)]
pub enum ClipsError {
    /// A file or folder cannot be read or written.
    #[error("{what} {} cannot be used", path.display())]
    Io {
        /// What it is.
        what: &'static str,
        /// Where.
        path: PathBuf,
        /// The system's answer.
        #[source]
        source: std::io::Error,
    },
    /// The recipe is not TOML of the expected keys.
    #[error("clip recipe {} cannot be read", path.display())]
    Syntax {
        /// Where.
        path: PathBuf,
        /// What is wrong.
        #[source]
        source: Box<toml::de::Error>,
    },
    /// A value of the recipe is out of bounds.
    #[error("clip recipe: field {field:?}: {rule}")]
    Recipe {
        /// The field.
        field: &'static str,
        /// The broken rule, with the value.
        rule: String,
    },
    /// The model preset that gives the size is refused.
    #[error("the model preset is refused")]
    Model(#[from] ds_video::ConfigError),
    /// A scenario file is refused.
    #[error("a scenario is refused")]
    Scenario(#[from] ds_scenario::ScenarioError),
    /// A recorded drive is refused.
    #[error("a recorded drive is refused")]
    Import(#[from] ds_import::ImportError),
    /// A clip cannot be made.
    #[error("clip {index} cannot be made: {reason}")]
    Clip {
        /// The clip's index.
        index: u64,
        /// Why.
        reason: String,
    },
    /// The folder holds clips of another recipe.
    #[error("folder holds clips of recipe {found}, not of {expected}: choose another folder or remove it ({})", path.display())]
    Foreign {
        /// The folder.
        path: PathBuf,
        /// Digest of the recipe that is being rendered.
        expected: String,
        /// Digest of the recipe that the folder was made with.
        found: String,
    },
    /// A file of clips or an index is broken.
    #[error("{} is broken: {reason}", path.display())]
    Broken {
        /// Where.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A clip or frame beyond the last one is asked for.
    #[error("{what} {asked} is asked for, there are {count}")]
    Beyond {
        /// What.
        what: &'static str,
        /// Which.
        asked: usize,
        /// How many there are.
        count: usize,
    },
    /// An external program failed.
    #[error("{program:?} failed: {reason}")]
    Hook {
        /// The program.
        program: String,
        /// What happened.
        reason: String,
    },
}

impl ClipsError {
    pub(crate) fn io(what: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_path_buf();
        move |source| Self::Io { what, path, source }
    }

    pub(crate) fn broken(path: &Path, reason: impl ToString) -> Self {
        Self::Broken { path: path.to_path_buf(), reason: reason.to_string() }
    }
}
