//! Scores the committed states of a drive as they come.

use ds_score::{DriveScore, DriveScorer, Profile};
use ds_space::Tick;
use ds_topic::{Envelope, SceneMessage, Score, Verdict, World};
use ds_wire::{Body, WireError};

/// What the oracle said of the proposals of a drive.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Proposals {
    /// Sum of the best proposals' scores.
    sum: f64,
    pub(crate) ticks: u32,
    pub(crate) without_positive: u32,
}

impl Proposals {
    fn note(&mut self, verdict: &Verdict) {
        let best = verdict.scores.iter().copied().fold(0.0, f64::max);
        self.sum += best;
        self.ticks += 1;
        self.without_positive += u32::from(best <= 0.0);
    }

    pub(crate) fn best_mean(&self) -> f64 {
        self.sum / f64::from(self.ticks.max(1))
    }
}

/// Feeds `world` messages to the score.
pub(crate) struct Scorer {
    scorer: DriveScorer,
    proposals: Proposals,
}

impl Scorer {
    pub(crate) fn new(message: &SceneMessage) -> Self {
        let spec = &message.spec;
        let profile = Profile::named(spec.score_profile.name()).expect("every profile of a run is known to the score");
        let scorer = DriveScorer::new(&message.scene, profile, spec.taken_over_at(), spec.last_tick);
        Self { scorer, proposals: Proposals::default() }
    }

    /// Takes the next state and returns the sub-metrics so far.
    pub(crate) fn observe(&mut self, envelope: &Envelope) -> Result<(Tick, Score), WireError> {
        let world = World::from_bytes(&envelope.body)?;
        if let Some(verdict) = &world.verdict {
            self.proposals.note(verdict);
        }
        Ok((world.state.tick, Score { values: self.scorer.observe(&world.state) }))
    }

    /// Returns the scores of the whole drive.
    pub(crate) fn finish(&self) -> (DriveScore, Proposals) {
        (self.scorer.finish(), self.proposals)
    }
}
