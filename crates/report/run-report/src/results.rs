//! The format of `results.json`: one entry per drive with its scores, and what was run.
//!
//! Scores are 0 to 1; `null` means not applicable, with a reason beside it. Fields that older files lack have
//! defaults, so that every results file ever written loads. Reading and its checks are in `load`.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

mod driven;
mod load;
mod merge;
mod screen;
#[cfg(test)]
mod tests;

pub use driven::hex;
pub use load::{MAX_EPISODES, MAX_FILE_BYTES, MAX_TERMS, ResultsError};
pub use merge::MergeError;
pub(crate) use merge::folder_of;

/// The name of a run's results file in its folder.
pub const RESULTS: &str = "results.json";

/// The whole file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Results {
    /// What was run.
    pub run: Run,
    /// One entry per episode, in order of submission.
    pub episodes: Vec<Episode>,
}

impl Results {
    /// Says whether any of it was driven by the wall clock: such results are never mixed with others.
    #[must_use]
    pub fn by_wall_clock(&self) -> bool {
        self.run.wall_clock || self.episodes.iter().any(|episode| episode.wall_clock.is_some())
    }
}

/// What was run, with which versions, weights and settings.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// The run's id.
    pub id: String,
    /// Version of the program.
    pub version: String,
    /// Version of the topic schemas.
    pub schema_version: u32,
    /// All seeds.
    pub seeds: Vec<u64>,
    /// Δr, in ticks.
    pub replan_period: u32,
    /// H, in seconds.
    pub horizon_secs: f64,
    /// K, in frames.
    pub history: u32,
    /// Which agents react.
    pub agents: String,
    /// The tracker.
    pub tracker: String,
    /// Look of the reference camera; of every episode that names none of its own.
    pub appearance: String,
    /// `embedded` or `processes`.
    pub mode: String,
    /// Digest over all settings above.
    pub configuration_digest: String,
    /// Digest of the video model's configuration and weights; empty without one.
    pub video_model_digest: String,
    /// Digest of the camera policy's weights; empty without one.
    pub policy_model_digest: String,
    /// What decides the bits of a result, per role.
    pub compute_classes: BTreeMap<String, String>,
    /// Whether the fleet ran without TLS and tokens on more than loopback.
    pub insecure: bool,
    /// Whether the policy had the time of the wall clock for each plan; what it drove then depends on the machine.
    #[serde(default)]
    pub wall_clock: bool,
    /// Wall time of the whole run, in seconds.
    pub wall_s: f64,
}

/// One drive.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Episode {
    /// The scenario's name.
    pub scenario: String,
    /// The scenario set, such as `base`, `behavior` or `appearance`; empty if it was given as a single file.
    #[serde(default)]
    pub set: String,
    /// The scenario's family; empty for imported logs.
    #[serde(default)]
    pub category: String,
    /// The policy's name.
    pub policy: String,
    /// The observation source.
    pub observation: String,
    /// Look of the reference camera; empty in a file means the run's.
    #[serde(default)]
    pub appearance: String,
    /// The seed.
    pub seed: u64,
    /// Attempts that it took.
    pub attempts: u32,
    /// `completed`, `failed` or `aborted`; `queued`, `running` or `unknown` in the file of a run that was cut off.
    pub status: String,
    /// A named reason; empty for a completed drive.
    pub reason: String,
    /// Ticks driven.
    pub ticks: u32,
    /// Who ranked the proposals: `learned`, `oracle` or `oracle-navsim`; empty in older files.
    #[serde(default)]
    pub scorer: String,
    /// Which definition of the score was used, such as `bridgesim` or `strict`.
    #[serde(default)]
    pub score_profile: String,
    /// Version of that definition.
    #[serde(default)]
    pub score_version: String,
    /// Route completion times mean score; null with a reason where it does not apply.
    pub driving_score: Option<f64>,
    /// Why the driving score is null.
    pub driving_score_reason: String,
    /// Share of the logged path that was driven; null where the expert stands still.
    pub route_completion: Option<f64>,
    /// Mean of the per-tick score.
    #[serde(default)]
    pub mean_score: Option<f64>,
    /// Lower-case names of the sub-metrics.
    pub sub_scores: BTreeMap<String, Option<f64>>,
    /// First tick at which a term was broken, for the terms that were.
    #[serde(default)]
    pub first_violations: BTreeMap<String, u32>,
    /// What each term took from the mean score, of 1.
    #[serde(default)]
    pub lost: BTreeMap<String, f64>,
    /// What the oracle says of the policy's proposals; null where none were scored.
    #[serde(default)]
    pub proposals: Option<ProposalStats>,
    /// How the policy kept the time of the wall clock; absent where it was not driven by it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wall_clock: Option<WallClock>,
    /// Simulated frames per second of wall time, set-up left out.
    pub frames_per_second: f64,
    /// Wall time, in seconds.
    pub wall_s: f64,
    /// Shares of the wall time; they sum to 1.
    pub time_share: TimeShare,
    /// BLAKE3 over the payloads of `world`, tick by tick.
    pub world_digest: String,
    /// BLAKE3 over width, height and RGB rows of `layout`, tick by tick and camera by camera.
    pub layout_digest: String,
    /// The same of `frame`.
    pub frame_digest: String,
    /// The recording, relative to the results file.
    pub recording: String,
}

/// How good a policy's proposals are under the oracle scorer.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct ProposalStats {
    /// Mean over the scored ticks of the best proposal's score, 0 to 1.
    pub best_mean: f64,
    /// Scored ticks at which no proposal scored above 0.
    pub ticks_without_positive: u32,
    /// Ticks at which proposals were scored.
    pub ticks: u32,
}

/// How a policy kept the time of the wall clock.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct WallClock {
    /// Plans that were due.
    pub plans: u32,
    /// Plans for which no answer came in time: an earlier one was driven on.
    pub late: u32,
    /// Median time from an observation to its answer, in seconds; 0 without any.
    pub latency_median_s: f64,
    /// The 99th percentile.
    pub latency_p99_s: f64,
    /// The longest.
    pub latency_max_s: f64,
}

impl std::fmt::Display for WallClock {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { plans, late, latency_median_s, latency_p99_s, latency_max_s } = self;
        write!(
            f,
            "by the wall clock: {late} of {plans} plans late; answers took {latency_median_s:.3} s in the median, \
             {latency_p99_s:.3} s at 99 %, {latency_max_s:.3} s at most"
        )
    }
}

/// Where the wall time of a drive went.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct TimeShare {
    /// sim-server.
    pub sim: f64,
    /// layout-render.
    pub layout: f64,
    /// vdm-worker.
    pub video: f64,
    /// policy-bridge and the policy.
    pub policy: f64,
    /// Messages under way and waiting for them.
    pub bus: f64,
    /// Journal, scoring, start and end.
    pub other: f64,
}

/// How a drive ended, as far as aggregation cares.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Outcome {
    /// Driven to its end and scored.
    Completed,
    /// Ended by the policy's fault: counts 0 in every metric of the headline.
    Failed,
    /// Ended by the infrastructure, or not ended at all: left out of every mean, but counted.
    Aborted,
}

impl Episode {
    /// Returns how the drive ended; whatever is neither completed nor failed counts as aborted.
    #[must_use]
    pub fn outcome(&self) -> Outcome {
        match self.status.as_str() {
            "completed" => Outcome::Completed,
            "failed" => Outcome::Failed,
            _ => Outcome::Aborted,
        }
    }

    /// Returns score profile and version in one, such as `bridgesim 1`; empty in older files.
    #[must_use]
    pub fn profile(&self) -> String {
        format!("{} {}", self.score_profile, self.score_version).trim().to_owned()
    }
}
