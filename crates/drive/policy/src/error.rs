//! Why a policy cannot be made or cannot answer.

use ds_world::TrajectoryError;

/// Says why a policy cannot be made or cannot answer.
#[derive(Debug, thiserror::Error)]
pub enum PolicyError {
    /// No built-in policy has this name.
    #[error("unknown policy {name:?}, known are {known}")]
    Unknown {
        /// The name that was asked for.
        name: String,
        /// The names that exist.
        known: String,
    },
    /// A privileged policy was asked without its view of the truth.
    #[error("policy {name:?} is privileged and was given no view of the scenario")]
    NeedsPrivilege {
        /// The policy.
        name: &'static str,
    },
    /// The policy tries its plans in copies of the world, and was asked for where there is no simulator.
    #[error("policy {name:?} needs a simulator, it is made by the policy stage")]
    NeedsSimulator {
        /// The policy.
        name: &'static str,
    },
    /// The snapshot of the world cannot be used.
    #[error("policy {name:?} cannot copy the world")]
    World {
        /// The policy.
        name: &'static str,
        /// Why.
        #[source]
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// A field of the observation is unusable.
    #[error("observation field {field:?} {problem}")]
    Observation {
        /// The field.
        field: &'static str,
        /// What is wrong with it, with the value.
        problem: String,
    },
    /// The policy needs weights and got none.
    #[error("policy {name:?} needs a weights file and none was given")]
    NeedsWeights {
        /// The policy.
        name: &'static str,
    },
    /// There are no weights where they should be.
    #[error(
        "policy {name:?} has no weights: `dreamstream train policy --kind {name}` trains them; looked for in {path:?}"
    )]
    Untrained {
        /// The policy.
        name: &'static str,
        /// The file.
        path: String,
    },
    /// The weights cannot be used.
    #[error("policy weights {path:?} cannot be used")]
    Weights {
        /// The file.
        path: String,
        /// Why.
        #[source]
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// The manifest or the network of a policy of one's own is refused, or the network failed.
    #[error(transparent)]
    Own(#[from] ds_onnx::OnnxError),
    /// A manifest gives its policy a name that another one has.
    #[error("{by} is called {name:?}, give yours another name")]
    Taken {
        /// The name.
        name: String,
        /// Who has it.
        by: &'static str,
    },
    /// A policy in another process did not answer, or not as it should.
    #[error("{fault}: {detail}")]
    Outside {
        /// What went wrong, such as `policy_left`.
        fault: String,
        /// Its words.
        detail: String,
    },
    /// A number of the answer is unusable.
    #[error("answer of policy {name:?} {problem}")]
    Answer {
        /// The policy.
        name: String,
        /// What is wrong with it, with the value.
        problem: String,
    },
    /// The plan breaks the rules of a trajectory.
    #[error("plan of policy {name:?} refused")]
    Plan {
        /// The policy.
        name: String,
        /// Why.
        #[source]
        source: TrajectoryError,
    },
}
