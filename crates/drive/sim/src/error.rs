//! Why a simulation cannot start or a snapshot cannot be restored.

/// Says why a simulation cannot start.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SimError {
    /// The scene has no logged ego state.
    #[error("scene {scene:?} has an empty ego log")]
    EmptyLog {
        /// The scene's name.
        scene: String,
    },
    /// The first tick lies after the log.
    #[error("start tick {start} lies after the last logged tick {last}")]
    StartBeyondLog {
        /// The tick asked for.
        start: u32,
        /// The last tick of the log.
        last: u32,
    },
    /// The time between ticks is not usable.
    #[error("scene time step is {dt_secs} s, need 0.001 to 1 s")]
    TimeStep {
        /// The scene's time step, in seconds.
        dt_secs: f64,
    },
    /// A law at a port that a run does not have.
    #[error("a law at port \"follower\" acts in diagnoses alone, not in a run")]
    FollowerLaw,
    /// A number of the configuration or the vehicle is out of range.
    #[error("field {field:?} is {value}, need {need}")]
    Field {
        /// The field.
        field: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        need: &'static str,
    },
    /// The snapshot was refused.
    #[error("snapshot refused")]
    Snapshot(#[from] SnapshotError),
}

/// Says why a snapshot is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SnapshotError {
    /// The bytes end early or go on after the end.
    #[error("snapshot has {bytes} bytes, which does not fit its content")]
    Length {
        /// How many bytes came.
        bytes: usize,
    },
    /// The first bytes are not those of a snapshot.
    #[error("not a snapshot of a simulation")]
    Magic,
    /// The version is not known.
    #[error("snapshot version is {version}, this build reads {known}")]
    Version {
        /// The version found.
        version: u32,
        /// The version that is read.
        known: u32,
    },
    /// The bytes were changed.
    #[error("snapshot checksum does not match its {bytes} bytes")]
    Checksum {
        /// How many bytes came.
        bytes: usize,
    },
    /// It was taken of another scene.
    #[error("snapshot is of another scene")]
    Scene,
    /// It was taken under another configuration.
    #[error("snapshot was taken under another configuration")]
    Config,
    /// A value is out of range.
    #[error("snapshot field {field:?} is {value}")]
    Field {
        /// The field.
        field: &'static str,
        /// Its value.
        value: f64,
    },
}
