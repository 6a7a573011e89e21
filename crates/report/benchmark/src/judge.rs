//! States of a drive → its scores in both profiles, and how it ended for whoever sat in the car.
//!
//! Outcomes are those of profile `strict` over the scored ticks, whatever profile a table shows: fault classes, the map's
//! drivable surface, red connectors of the route. Distances in metres.

use std::collections::BTreeMap;

use ds_score::{DriveScore, DriveScorer, Profile};
use ds_space::{AgentId, Tick};
use ds_world::{Scene, WorldState};
use serde::{Deserialize, Serialize};

/// Share of what the expert drove in the scored ticks that counts as having arrived.
pub const ARRIVED: f64 = 0.9;
/// The profiles, by name.
pub const PROFILES: [&str; 2] = ["bridgesim", "strict"];

/// Scores of a drive in one profile, 0 to 1; nothing where one does not apply.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Scores {
    /// Version of the definition.
    pub version: String,
    /// Route completion times mean score (DS).
    pub driving_score: Option<f64>,
    /// Mean of the per-tick score (EPDMS of the executed drive).
    pub mean_score: Option<f64>,
    /// Share of the expert's path (RC).
    pub route_completion: Option<f64>,
    /// Means of the terms.
    pub terms: BTreeMap<String, Option<f64>>,
}

/// How a drive went.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// At least [`ARRIVED`] of what the expert drove, or the end of its path, without leaving the route.
    pub arrived: bool,
    /// The ego touched somebody by its own fault.
    pub collision_at_fault: bool,
    /// The ego touched somebody who did not touch it when the policy took over.
    pub contact: bool,
    /// A corner was off the drivable surface.
    pub off_road: bool,
    /// A red light was crossed.
    pub red_light: bool,
    /// The first tick at which the ego was at fault in a collision or off the road.
    pub first_fault: Option<u32>,
    /// How far the ego drove, in metres.
    pub driven_m: f64,
}

impl Outcome {
    /// Arrived, on the road, without a collision by own fault.
    #[must_use]
    pub fn success(&self) -> bool {
        self.arrived && !self.collision_at_fault && !self.off_road
    }
}

/// What is said of a drive.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Judged {
    /// Scores by profile.
    pub scores: BTreeMap<String, Scores>,
    /// How it went.
    pub outcome: Outcome,
}

/// Judges a drive from its states, in order of ticks; the policy drives from `start` on, the drive is to end at `last`.
#[must_use]
pub fn judge(scene: &Scene, start: Tick, last: Tick, states: &[&WorldState]) -> Judged {
    let mut scores = BTreeMap::new();
    let mut strict = None;
    for name in PROFILES {
        let profile = Profile::named(name).expect("both profiles are known");
        let mut scorer = DriveScorer::new(scene, profile, start, last);
        for state in states {
            drop(scorer.observe(state));
        }
        let score = scorer.finish();
        scores.insert(name.to_owned(), named(&score));
        strict = Some(score);
    }
    let scored: Vec<&WorldState> = states.iter().copied().filter(|state| state.tick >= start).collect();
    let outcome = strict.map(|score| outcome(&score, &scored)).unwrap_or_default();
    Judged { scores, outcome }
}

fn named(score: &DriveScore) -> Scores {
    Scores {
        version: score.version.to_owned(),
        driving_score: score.driving_score,
        mean_score: score.mean,
        route_completion: score.route_completion,
        terms: score.sub_scores.iter().map(|(term, value)| ((*term).to_owned(), *value)).collect(),
    }
}

fn outcome(score: &DriveScore, states: &[&WorldState]) -> Outcome {
    let first = |term: &str| score.first_violations.get(term).copied();
    let (collision, off_road) = (first("no_at_fault_collision"), first("drivable_area"));
    let left_out: Vec<AgentId> =
        states.first().map(|state| state.contacts.iter().map(|contact| contact.agent).collect()).unwrap_or_default();
    let touches = |state: &&WorldState| state.contacts.iter().any(|contact| !left_out.contains(&contact.agent));
    let arrived = match score.ended {
        Some((_, ending)) => ending == "arrived",
        None => score.route_completion.is_none_or(|share| share >= ARRIVED),
    };
    let steps = states.windows(2).map(|pair| pair[0].ego.pose.position.distance(pair[1].ego.pose.position));
    Outcome {
        arrived: arrived && score.mean.is_some(),
        collision_at_fault: collision.is_some(),
        contact: states.iter().any(touches),
        off_road: off_road.is_some(),
        red_light: first("traffic_light").is_some(),
        first_fault: collision.into_iter().chain(off_road).min(),
        driven_m: steps.sum(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ds_scenario::Family;

    /// States of the logged drive, moved `left_m` to the left from `tick` on.
    fn states(scene: &Scene, tick: u32, left_m: f64) -> Vec<WorldState> {
        let state = |k: u32| {
            let mut state = scene.logged_world(Tick(k));
            state.agents.clear();
            if k >= tick {
                state.ego.pose = state.ego.pose.compose(&ds_space::PoseSe2::new(0.0, left_m, 0.0));
            }
            state
        };
        (0..=100).map(state).collect()
    }

    fn judged(tick: u32, left_m: f64) -> Judged {
        let scene = ds_scenario::generate(Family::FreeCurve, 1);
        let states = states(&scene, tick, left_m);
        judge(&scene, Tick(20), Tick(100), &states.iter().collect::<Vec<_>>())
    }

    #[test]
    fn the_log_succeeds_and_who_leaves_the_road_does_not() {
        let log = judged(1000, 0.0);
        assert!(log.outcome.success() && log.outcome.first_fault.is_none(), "{:?}", log.outcome);
        assert!(log.outcome.driven_m > 20.0 && log.scores.len() == 2, "{log:?}");
        assert!(log.scores["strict"].driving_score.is_some_and(|score| score > 0.9), "{log:?}");
        let away = judged(50, 30.0);
        assert!(away.outcome.off_road && !away.outcome.success(), "{:?}", away.outcome);
        assert_eq!(away.outcome.first_fault, Some(50));
        let before = judged(5, 0.0);
        assert_eq!(before, log);
    }
}
