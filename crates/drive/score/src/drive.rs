//! A drive scored state by state under names: what the `score` topic, results and re-scoring all carry.
//!
//! One function over the same states gives the same bits, live or from a recording. The points that a state falls short
//! of 1 are shared out between the terms, so that they sum to 1 minus the mean score.

use std::collections::BTreeMap;

use ds_space::Tick;
use ds_world::{Scene, WorldState};
use serde::Serialize;

use crate::closed_loop::{LiveScorer, Profile, Window};
use crate::constants::CLOSED_LOOP_VERSION;
use crate::driving_score::{DrivingScore, LoopScore, TERMS, Term};
use crate::error::ScoreError;

use self::collision::Collision;
use self::progress::Progress;

mod collision;
mod progress;

/// The score of a drive under names, as files of scores hold it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DriveScore {
    /// The profile.
    #[serde(rename = "score_profile")]
    pub profile: &'static str,
    /// The score definition.
    #[serde(rename = "score_version")]
    pub version: &'static str,
    /// Route completion times mean score; `None` with a reason where it does not apply.
    pub driving_score: Option<f64>,
    /// Why there is no driving score, or what is special about it; empty if nothing is.
    #[serde(rename = "driving_score_reason")]
    pub reason: String,
    /// Mean of the per-tick score.
    #[serde(rename = "mean_score")]
    pub mean: Option<f64>,
    /// Share of the expert's path that was driven; `None` if the expert stands still.
    pub route_completion: Option<f64>,
    /// Mean of each term over the ticks in which it applies; `None` if it never does.
    pub sub_scores: BTreeMap<&'static str, Option<f64>>,
    /// What each term took from the mean score, of 1; terms that took nothing are left out.
    pub lost: BTreeMap<&'static str, f64>,
    /// First tick at which each broken term was below 1.
    pub first_violations: BTreeMap<&'static str, u32>,
    /// The tick at which scoring ended before the drive did, and why.
    pub ended: Option<(u32, &'static str)>,
}

/// Scores one drive through one scene.
#[derive(Debug, Clone)]
pub struct DriveScorer {
    profile: Profile,
    /// The tick at which the policy takes over.
    start: Tick,
    scorer: Result<LiveScorer, String>,
    collision: Collision,
    progress: Progress,
    lost: [f64; TERMS],
    scored: u32,
}

impl DriveScorer {
    /// Prepares to score the ticks from `start` to `last`; what cannot be scored is said by [`DriveScore::reason`].
    #[must_use]
    pub fn new(scene: &Scene, profile: Profile, start: Tick, last: Tick) -> Self {
        let whole = start == Tick(0) && last >= scene.last_tick();
        let window = (!whole).then_some(Window { start, ticks: last.0.saturating_sub(start.0) });
        let scorer = LiveScorer::new(scene, profile, window).map_err(|error| told(&error));
        let (collision, progress) = (Collision::default(), Progress::new(scene));
        Self { profile, start, scorer, collision, progress, lost: [0.0; TERMS], scored: 0 }
    }

    /// Takes the next state and returns named values in rising order: the terms of this tick and the totals so far.
    pub fn observe(&mut self, world: &WorldState) -> Vec<(String, Option<f64>)> {
        self.collision.observe(world);
        self.progress.observe(world.tick, world.ego.pose.position);
        let mut values: BTreeMap<&'static str, Option<f64>> = BTreeMap::new();
        if world.tick >= self.start
            && let Ok(scorer) = &mut self.scorer
        {
            match scorer.observe(world) {
                Ok(Some(score)) => {
                    self.note(&score);
                    values.extend(Term::ALL.map(|term| (term.name(), score.term(term))));
                    values.insert("epdms", score.epdms());
                }
                Ok(None) => {}
                Err(error) => self.scorer = Err(told(&error)),
            }
        }
        let score = self.finish();
        values.insert("driving_score", score.driving_score);
        values.insert("mean_score", score.mean);
        values.insert("route_completion", score.route_completion);
        for name in ["collision", "progress"] {
            values.insert(name, score.sub_scores.get(name).copied().flatten());
        }
        values.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
    }

    fn note(&mut self, score: &LoopScore) {
        self.scored += u32::from(score.epdms().is_some());
        for (sum, lost) in self.lost.iter_mut().zip(score.lost()) {
            *sum += lost;
        }
    }

    /// Returns the score of all states observed so far.
    #[must_use]
    pub fn finish(&self) -> DriveScore {
        let mut score = DriveScore {
            version: CLOSED_LOOP_VERSION,
            profile: self.profile.label(),
            driving_score: None,
            reason: String::new(),
            mean: None,
            route_completion: None,
            sub_scores: Term::ALL.map(|term| (term.name(), None)).into(),
            lost: BTreeMap::new(),
            first_violations: BTreeMap::new(),
            ended: None,
        };
        match self.scorer.as_ref().map(LiveScorer::finish) {
            Ok(Ok(driven)) => self.fill(&mut score, &driven),
            Ok(Err(error)) => score.reason = told(&error),
            Err(reason) => score.reason.clone_from(reason),
        }
        score.sub_scores.insert("collision", self.collision.score());
        score.sub_scores.insert("progress", self.progress.score());
        score
    }

    fn fill(&self, score: &mut DriveScore, driven: &DrivingScore) {
        let share = |value: f64| value.clamp(0.0, 1.0);
        score.driving_score = driven.driving_score.map(share);
        score.mean = driven.mean_epdms.map(share);
        score.route_completion = driven.route_completion.map(share);
        score.ended = driven.ended.map(|(tick, ending)| (tick, ending.name()));
        if driven.expert_stands_still {
            "route completion does not apply: the expert stands still; the driving score is the mean score"
                .clone_into(&mut score.reason);
        }
        for ((term, summary), lost) in Term::ALL.into_iter().zip(&driven.terms).zip(self.lost) {
            score.sub_scores.insert(term.name(), summary.mean);
            if lost > 0.0 {
                score.lost.insert(term.name(), share(lost / f64::from(self.scored.max(1))));
            }
            if let Some(tick) = summary.first_lost {
                score.first_violations.insert(term.name(), tick);
            }
        }
    }
}

fn told(error: &ScoreError) -> String {
    format!("not scored: {error}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lost_points_sum_to_what_is_missing() {
        let term = |values: [Option<f64>; TERMS]| LoopScore {
            tick: 1,
            terms: values,
            at_fault_object: None,
            ttc_object: None,
            route_share: None,
            ending: None,
        };
        let cases = [
            [Some(1.0); TERMS],
            [Some(0.0); TERMS],
            [Some(1.0), Some(1.0), Some(1.0), Some(1.0), Some(0.0), Some(1.0), Some(1.0), Some(1.0)],
            [Some(0.5), Some(0.0), None, Some(1.0), Some(1.0), None, Some(0.0), Some(1.0)],
            [Some(0.0), None, None, None, Some(1.0), None, None, None],
        ];
        for values in cases {
            let score = term(values);
            let missing = 1.0 - score.epdms().expect("a weighted term applies");
            assert!((score.lost().iter().sum::<f64>() - missing).abs() < 1e-12, "{values:?}");
        }
        // Worked out by hand: TTC weighs 5 of 11, then the collision takes what was left.
        let lost =
            term([Some(0.0), Some(1.0), Some(1.0), Some(1.0), Some(0.0), Some(1.0), Some(1.0), Some(1.0)]).lost();
        assert!((lost[4] - 5.0 / 11.0).abs() < 1e-12 && (lost[0] - 6.0 / 11.0).abs() < 1e-12, "{lost:?}");
    }
}
