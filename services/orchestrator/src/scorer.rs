//! Scores the committed states of a drive as they come.

use std::collections::BTreeMap;

use ds_score::ScoreTracker;
use ds_space::Tick;
use ds_topic::{Envelope, SceneMessage, Score, World};
use ds_wire::{Body, WireError};

/// The scores of a whole drive.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct EpisodeScores {
    /// Share of the logged path; `None` where the expert stands still.
    pub(crate) route_completion: Option<f64>,
    /// Sub-metrics by lower-case name.
    pub(crate) sub_scores: BTreeMap<String, Option<f64>>,
}

/// Feeds `world` messages to the score tracker.
pub(crate) struct Scorer(ScoreTracker);

impl Scorer {
    pub(crate) fn new(message: &SceneMessage) -> Self {
        Self(ScoreTracker::new(&message.scene))
    }

    /// Takes the next state and returns the sub-metrics so far.
    pub(crate) fn observe(&mut self, envelope: &Envelope) -> Result<(Tick, Score), WireError> {
        let world = World::from_bytes(&envelope.body)?;
        self.0.observe(&world.state);
        Ok((world.state.tick, Score { values: named(&self.0.finish()).into_iter().collect() }))
    }

    /// Returns the scores of the whole drive.
    pub(crate) fn finish(&self) -> EpisodeScores {
        let score = self.0.finish();
        let mut sub_scores = named(&score);
        let route_completion = sub_scores.remove("route_completion").flatten();
        EpisodeScores { route_completion, sub_scores }
    }
}

fn named(score: &ds_score::EpisodeScore) -> BTreeMap<String, Option<f64>> {
    let values = [
        ("collision", score.collision),
        ("drivable_area", score.drivable_area),
        ("progress", score.progress),
        ("route_completion", score.route_completion),
    ];
    values.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
}
