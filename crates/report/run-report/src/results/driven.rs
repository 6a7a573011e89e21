//! What an orchestrator says of a run, as results.

use std::collections::BTreeMap;
use std::path::Path;

use ds_stats::quantile;
use ds_wire::control as pb;

use super::{Episode, ProposalStats, TimeShare, WallClock};

/// Writes bytes as hexadecimal digits.
#[must_use]
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Sums up how a policy kept the time.
fn kept_time(told: &pb::WallClock) -> WallClock {
    let mut latencies = told.latency_secs.clone();
    let mut quantile = |share| if told.latency_secs.is_empty() { 0.0 } else { quantile(&mut latencies, share) };
    let [latency_median_s, latency_p99_s, latency_max_s] = [0.5, 0.99, 1.0].map(&mut quantile);
    WallClock { plans: told.plans, late: told.late, latency_median_s, latency_p99_s, latency_max_s }
}

impl Episode {
    /// Returns a drive as the orchestrator told it, of a scenario set; recordings are named from `out`.
    #[must_use]
    pub fn driven(result: &pb::EpisodeResult, set: &str, out: &Path) -> Self {
        let share = |name: &str| result.time_share.get(name).copied().unwrap_or_default();
        let mut sub_scores: BTreeMap<String, Option<f64>> =
            result.sub_scores.iter().map(|(name, value)| (name.clone(), Some(*value))).collect();
        for name in ds_score::Term::ALL.map(ds_score::Term::name).into_iter().chain(["collision", "progress"]) {
            sub_scores.entry(name.to_owned()).or_insert(None);
        }
        let recording = Path::new(&result.recording);
        Self {
            scenario: result.scenario.clone(),
            policy: result.policy.clone(),
            observation: pb::observation_of(result.observation)
                .map_or("", ds_topic::ObservationSource::name)
                .to_owned(),
            seed: result.seed,
            attempts: result.attempts,
            status: pb::status_name(result.status).to_owned(),
            reason: result.reason.clone(),
            ticks: result.ticks,
            driving_score: result.driving_score,
            driving_score_reason: result.score_reason.clone(),
            set: set.to_owned(),
            category: result.category.clone(),
            appearance: result.appearance.clone(),
            scorer: result.scorer.clone(),
            score_profile: result.score_profile.clone(),
            score_version: result.score_version.clone(),
            mean_score: result.mean_score,
            first_violations: result.first_violations.iter().map(|(term, tick)| (term.clone(), *tick)).collect(),
            lost: result.lost.iter().map(|(term, points)| (term.clone(), *points)).collect(),
            proposals: result.proposals.map(|stats| ProposalStats {
                best_mean: stats.best_mean,
                ticks_without_positive: stats.ticks_without_positive,
                ticks: stats.ticks,
            }),
            wall_clock: result.wall_clock.as_ref().map(kept_time),
            route_completion: result.route_completion,
            sub_scores,
            frames_per_second: result.frames_per_second,
            wall_s: result.wall_secs,
            time_share: TimeShare {
                sim: share("sim"),
                layout: share("layout"),
                video: share("video"),
                policy: share("policy"),
                bus: share("bus"),
                other: share("other"),
            },
            world_digest: hex(&result.world_digest),
            layout_digest: hex(&result.layout_digest),
            frame_digest: hex(&result.frame_digest),
            recording: recording.strip_prefix(out).unwrap_or(recording).display().to_string(),
        }
    }
}
