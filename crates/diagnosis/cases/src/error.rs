//! Why a case cannot be made, read or diagnosed.

use std::path::PathBuf;

use ds_diagnosis::CaseError;
use ds_fidelity::FidelityError;
use ds_frames::FramesError;
use ds_policy::PolicyError;
use ds_record::RecordError;
use ds_scenario::ScenarioError;
use ds_simulator::SimulatorError;
use ds_traffic::TrafficError;

/// What is wrong with a case or with what it is made of.
#[derive(Debug, thiserror::Error)]
pub enum CasesError {
    /// A case holds no logs of a vehicle, of which alone there are baselines.
    #[error("no logs of a vehicle in {path:?}")]
    NoVehicle {
        /// The case.
        path: PathBuf,
    },
    /// A file of the case is refused, or a log of a vehicle makes no sense.
    #[error(transparent)]
    Case(#[from] CaseError),
    /// A simulator of somebody else cannot be used.
    #[error(transparent)]
    Simulator(#[from] SimulatorError),
    /// A simulator was given for what is no log of a vehicle.
    #[error("--simulator is for logs of a vehicle; this case holds frames or traffic")]
    SimulatorWithoutVehicle,
    /// A pair of frame streams makes no sense.
    #[error(transparent)]
    Frames(#[from] FramesError),
    /// Recorded traffic makes no sense.
    #[error(transparent)]
    Traffic(#[from] TrafficError),
    /// A recording or vehicle log cannot be read or written.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// A scenario is refused.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// A picture cannot be encoded.
    #[error("cannot encode a frame")]
    Picture(#[from] image::ImageError),
    /// A file or folder cannot be read or written.
    #[error("cannot use {path:?}")]
    File {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// There is no case at a path.
    #[error("{} is no case and holds none: a case has a meta.json", path.display())]
    NoCase {
        /// The path.
        path: PathBuf,
    },
    /// A policy cannot look at the frames of a case.
    #[error(transparent)]
    Policy(#[from] PolicyError),
    /// A policy has no features of frames.
    #[error(
        "policy {policy:?} tells of nothing that it attends to: name camera, one of the panel, or the manifest of a \
         network with a [feature]"
    )]
    TellsNothing {
        /// The policy.
        policy: String,
    },
    /// What a policy attends to has no unit for differences.
    #[error(transparent)]
    Fidelity(#[from] FidelityError),
    /// There is no diagnosis at a path.
    #[error("{} holds no diagnosis.json: `gap diagnose` writes them", path.display())]
    NoDiagnosis {
        /// The path.
        path: PathBuf,
    },
    /// A folder of vehicle logs is empty.
    #[error("{} lists no drives", path.display())]
    NoDrives {
        /// The folder.
        path: PathBuf,
    },
    /// Frames cannot be placed without their camera.
    #[error("{} names no camera: the log was made by an older version", path.display())]
    NoCamera {
        /// The folder.
        path: PathBuf,
    },
    /// A reference has nothing to compare with.
    #[error("{} holds no readings: drive it with --vehicle-log", path.display())]
    NoReadings {
        /// The file.
        path: PathBuf,
    },
    /// Other road users did not decide for themselves.
    #[error("agents drove as {agents:?}: drive with --agents idm-all or interactive to judge them")]
    Scripted {
        /// How they drove.
        agents: &'static str,
    },
    /// A configuration of a run is none.
    #[error("{} is no run configuration", path.display())]
    Config {
        /// The file.
        path: PathBuf,
        /// Why.
        source: Box<toml::de::Error>,
    },
    /// An effect is not written as it should be.
    #[error("--effect {text:?} is not ID=VALUE")]
    Flag {
        /// What was given.
        text: String,
    },
    /// A law is refused.
    #[error("{0}; docs/gap-discover.md has the grammar")]
    Law(String),
    /// There is no such effect, or its values are out of range.
    #[error("{0}; `dreamstream gap effects` lists them")]
    Effect(String),
    /// A corrected model has no value.
    #[error("{id} has no value in {case}: diagnose once more")]
    NoValue {
        /// The effect.
        id: String,
        /// The case.
        case: String,
    },
    /// A sealed answer cannot be made or opened.
    #[error("{}: {problem}", path.display())]
    Seal {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problem: &'static str,
    },
}

/// Says which file could not be used.
pub(crate) fn at(path: &std::path::Path) -> impl Fn(std::io::Error) -> CasesError + use<'_> {
    move |source| CasesError::File { path: path.to_path_buf(), source }
}
