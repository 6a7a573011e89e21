//! The closed-loop score, state by state: `observe` each state, then `finish` (`scoring.md` §7).
//!
//! Scores what was driven among the live agents; no plan, no log, no human filter. Not the NAVSIM EPDMS: a relative of
//! it with other rules, which the [`Profile`] chooses. Same states, same bits, whether live or from a recording.

mod collision;
mod comfort;
mod direction;
mod drivable;
mod keeping;
mod lane;
mod light;
mod live;
mod moment;
mod profile;
mod route;
mod tick;
mod time_to_collision;

pub use live::{LiveScorer, LoopAdapter, Window, loop_scene};
pub use profile::{
    CollisionRule, CompletionRule, DirectionRule, DrivableRule, EgoSize, FirstStateRule, KeepingRule, LightRule,
    LightTick, LoopComfortRule, MissingRule, OverlapRule, Profile, ShortExpertRule, TtcRule,
};
pub use route::Ending;
pub use tick::{LoopEgo, LoopLane, LoopObject, LoopScene, LoopState, window_share};

use self::collision::Collisions;
use self::comfort::Comfort;
use self::direction::Direction;
use self::keeping::Keeping;
use self::moment::Surroundings;
use self::route::Route;
use crate::driving_score::{DrivingScore, LoopScore, Summary};
use crate::error::ScoreError;
use crate::lane_marks::LaneMarks;

/// Returns 1 if nothing was violated, else 0.
fn unless(violated: bool) -> f64 {
    if violated { 0.0 } else { 1.0 }
}

/// Scores one drive.
#[derive(Debug, Clone)]
pub struct ClosedLoop {
    profile: Profile,
    around: Surroundings,
    collisions: Collisions,
    direction: Direction,
    keeping: Keeping,
    comfort: Comfort,
    route: Route,
    marks: LaneMarks,
    summary: Summary,
}

impl ClosedLoop {
    /// Prepares to score a drive.
    ///
    /// # Errors
    /// [`ScoreError`] names what cannot be scored: bad geometry, no lanes in profile `bridgesim`, an expert that stands
    /// still there.
    pub fn new(scene: &LoopScene, profile: Profile) -> Result<Self, ScoreError> {
        if scene.lanes.is_empty() && profile.drivable == DrivableRule::Lanes {
            return Err(ScoreError::NoLanes);
        }
        Ok(Self {
            around: Surroundings::new(scene, &profile)?,
            collisions: Collisions::default(),
            direction: Direction::default(),
            keeping: Keeping::default(),
            comfort: Comfort::new(scene.dt_s, scene.footprint.rear_axle_to_centre_m)?,
            route: Route::new(scene, &profile)?,
            marks: LaneMarks::default(),
            summary: Summary::default(),
            profile,
        })
    }

    /// Returns the score definition.
    #[must_use]
    pub fn profile(&self) -> &Profile {
        &self.profile
    }

    /// Takes the next state. Each comes once and in order; states after an ending count too, so stop at it.
    ///
    /// # Errors
    /// [`ScoreError`] names the bad number; the state is not counted then.
    pub fn observe(&mut self, state: &LoopState) -> Result<LoopScore, ScoreError> {
        state.check(self.around.lanes.len())?;
        let profile = self.profile;
        let moment = self.around.moment(state, &mut self.marks);
        let (collision, at_fault) = self.collisions.observe(&moment, &profile);
        let (ttc, meets) = time_to_collision::score(&moment, &profile, collision, &self.collisions);
        let drivable = drivable::score(&moment, &profile);
        let off_road = drivable == Some(0.0);
        let direction = self.direction.observe(&moment, &profile, off_road);
        let light = light::score(&moment, &profile);
        let keeping = self.keeping.observe(&moment, &profile, off_road);
        let (history, extended) = self.comfort.observe(&moment, &profile);
        let (share, ending) = self.route.observe(state.tick, moment.ego.centre);
        let missing = match profile.missing {
            MissingRule::One => Some(1.0),
            MissingRule::LeftOut => None,
        };
        let terms = [Some(collision), drivable, direction, light, Some(ttc), keeping, history, extended];
        let score = LoopScore {
            tick: state.tick,
            terms: terms.map(|term| term.or(missing)),
            at_fault_object: at_fault,
            ttc_object: meets,
            route_share: (!self.route.stands_still()).then_some(share),
            ending,
        };
        self.summary.add(&score);
        Ok(score)
    }

    /// Returns the score of all states observed so far.
    ///
    /// # Errors
    /// [`ScoreError::TooFewStates`] before the second one.
    pub fn finish(&self) -> Result<DrivingScore, ScoreError> {
        let completion = self.route.completion(&self.profile);
        let score = self.summary.finish(self.profile.label(), completion)?;
        Ok(DrivingScore { route_length_m: self.route.length_m(), ended: self.route.ended, ..score })
    }
}

/// Scores a whole drive: the score of each state and of the drive.
///
/// # Errors
/// [`ScoreError`] names what cannot be scored.
pub fn closed_loop(
    scene: &LoopScene,
    profile: Profile,
    states: &[LoopState],
) -> Result<(Vec<LoopScore>, DrivingScore), ScoreError> {
    let mut scorer = ClosedLoop::new(scene, profile)?;
    let scores = states.iter().map(|state| scorer.observe(state)).collect::<Result<_, _>>()?;
    Ok((scores, scorer.finish()?))
}

#[cfg(test)]
mod tests;
