//! `results.json` and the table on screen. Scores are 0 to 1; `null` means not applicable, with a reason beside it.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};

/// The whole file.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Results {
    /// What was run.
    pub run: Run,
    /// One entry per episode, in order of submission.
    pub episodes: Vec<Episode>,
}

/// What was run, with which versions, weights and settings.
#[derive(Debug, Clone, Serialize, Deserialize)]
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
    /// Look of the reference camera.
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
    /// Wall time of the whole run, in seconds.
    pub wall_s: f64,
}

/// One drive.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Episode {
    /// The scenario's name.
    pub scenario: String,
    /// The policy's name.
    pub policy: String,
    /// The observation source.
    pub observation: String,
    /// The seed.
    pub seed: u64,
    /// Attempts that it took.
    pub attempts: u32,
    /// `completed`, `failed` or `aborted`.
    pub status: String,
    /// A named reason; empty for a completed drive.
    pub reason: String,
    /// Ticks driven.
    pub ticks: u32,
    /// Null with a reason until the exact metric is computed.
    pub driving_score: Option<f64>,
    /// Why the driving score is null.
    pub driving_score_reason: String,
    /// Share of the logged path that was driven; null where the expert stands still.
    pub route_completion: Option<f64>,
    /// Lower-case names of the sub-metrics.
    pub sub_scores: BTreeMap<String, Option<f64>>,
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

impl TimeShare {
    /// Divides the work of each stage by the wall time; what the stages did not use is split between bus and journal.
    #[must_use]
    pub fn of(stage_secs: [f64; 4], journal_secs: f64, wall_s: f64) -> Self {
        let total = wall_s.max(stage_secs.iter().sum::<f64>() + journal_secs).max(1e-9);
        let [sim, layout, video, policy] = stage_secs.map(|secs| secs / total);
        let other = journal_secs / total;
        Self { sim, layout, video, policy, bus: 1.0 - sim - layout - video - policy - other, other }
    }
}

impl Results {
    /// Writes the file atomically.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn save(&self, path: &Path) -> Result<()> {
        let text = serde_json::to_string_pretty(self).context("results as JSON")?;
        let part = path.with_extension("json.partial");
        std::fs::write(&part, text + "\n").with_context(|| format!("write {}", part.display()))?;
        std::fs::rename(&part, path).with_context(|| format!("rename to {}", path.display()))
    }

    /// Reads the file of an earlier run.
    ///
    /// # Errors
    /// If it cannot be read or is not a results file.
    pub fn load(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).with_context(|| format!("read {}", path.display()))?;
        serde_json::from_str(&text).with_context(|| format!("{} is not a results file", path.display()))
    }

    /// Returns the table for the screen, failed and aborted drives counted below it.
    #[must_use]
    pub fn table(&self) -> String {
        let mut text = format!(
            "{:<26} {:<18} {:<12} {:>4} {:<9} {:>6} {:>6} {:>6} {:>6} {:>6}\n",
            "scenario", "policy", "observation", "seed", "status", "route", "coll.", "drive", "progr.", "fps"
        );
        for episode in &self.episodes {
            let score = |name: &str| cell(episode.sub_scores.get(name).copied().flatten());
            text += &format!(
                "{:<26} {:<18} {:<12} {:>4} {:<9} {:>6} {:>6} {:>6} {:>6} {:>6.1}\n",
                episode.scenario,
                episode.policy,
                episode.observation,
                episode.seed,
                episode.status,
                cell(episode.route_completion),
                score("collision"),
                score("drivable_area"),
                score("progress"),
                episode.frames_per_second
            );
            if !episode.reason.is_empty() {
                text += &format!("  └ {}\n", episode.reason);
            }
        }
        let count = |status: &str| self.episodes.iter().filter(|episode| episode.status == status).count();
        text += &format!(
            "{} episodes: {} completed, {} failed, {} aborted",
            self.episodes.len(),
            count("completed"),
            count("failed"),
            count("aborted")
        );
        text
    }
}

fn cell(value: Option<f64>) -> String {
    value.map_or_else(|| "n/a".to_owned(), |value| format!("{value:.3}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_shares_sum_to_one() {
        for (stages, journal, wall) in [([0.1, 0.2, 3.0, 0.4], 0.1, 5.0), ([1.0; 4], 1.0, 2.0), ([0.0; 4], 0.0, 0.0)] {
            let s = TimeShare::of(stages, journal, wall);
            assert!((s.sim + s.layout + s.video + s.policy + s.bus + s.other - 1.0).abs() < 1e-12, "{s:?}");
        }
    }
}
