//! The table on the terminal: one line a drive, its reason below it, the counts at the end.
//!
//! Scores are 0 to 1, `n/a` where they do not apply.

use super::Results;

impl Results {
    /// Returns the table for the screen, failed and aborted drives counted below it.
    #[must_use]
    pub fn table(&self) -> String {
        let mut text = format!(
            "{:<26} {:<18} {:<12} {:>4} {:<9} {:>13} {:>16} {:>10} {:>6}\n",
            "scenario",
            "policy",
            "observation",
            "seed",
            "status",
            "driving score",
            "route completion",
            "mean score",
            "fps"
        );
        for episode in &self.episodes {
            text += &format!(
                "{:<26} {:<18} {:<12} {:>4} {:<9} {:>13} {:>16} {:>10} {:>6.1}\n",
                episode.scenario,
                episode.policy,
                episode.observation,
                episode.seed,
                episode.status,
                cell(episode.driving_score),
                cell(episode.route_completion),
                cell(episode.mean_score),
                episode.frames_per_second
            );
            if let Some(kept) = &episode.wall_clock {
                text += &format!("  └ {kept}\n");
            }
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
