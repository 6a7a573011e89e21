//! What an iteration costs outside the video model: its wall time from commit to commit without the model's own work.
//!
//! Work is told by heartbeats beside the bus: where one comes after its commit, the time goes to the iteration before it.

use std::time::Instant;

/// The iterations of an attempt.
#[derive(Debug, Default)]
pub(crate) struct Pace {
    /// The last commit, and how long the video model had worked by then, in seconds.
    last: Option<(Instant, f64)>,
    /// Of each iteration after the first, in microseconds.
    pub(crate) overhead_micros: Vec<u32>,
}

impl Pace {
    /// Notes that an iteration is committed, when the video model had worked so long on the episode.
    pub(crate) fn committed(&mut self, at: Instant, video_secs: f64) {
        if let Some((before, worked)) = self.last.replace((at, video_secs)) {
            let secs = at.duration_since(before).as_secs_f64() - (video_secs - worked);
            // No negative time: the cast saturates.
            self.overhead_micros.push((secs * 1e6).round() as u32);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn the_first_commit_is_the_beginning_and_work_is_taken_off() {
        let mut pace = Pace::default();
        let began = Instant::now();
        for (millis, work_secs) in [(0, 0.7), (100, 0.78), (300, 0.78), (310, 0.9)] {
            pace.committed(began + Duration::from_millis(millis), work_secs);
        }
        assert_eq!(pace.overhead_micros, [20_000, 200_000, 0]);
    }
}
