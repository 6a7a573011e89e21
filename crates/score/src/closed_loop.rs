//! The closed-loop score, frame by frame: `observe` each frame, then `finish` (`scoring.md` §7).
//!
//! Scores what was driven among the live agents; no plan, no log, no human filter. Not the NAVSIM EPDMS: a relative of
//! it with other rules, which the [`Profile`] chooses. Same frames, same bits, whether live or from a recording.

mod collision;
mod comfort;
mod direction;
mod drivable;
mod frame;
mod keeping;
mod lane;
mod light;
mod live;
mod moment;
mod profile;
mod route;
mod time_to_collision;

pub use frame::{EgoFrame, Frame, LoopLane, LoopObject, LoopScene, window_share};
pub use live::{LiveScorer, LoopAdapter, Window, loop_scene};
pub use profile::{
    CollisionRule, CompletionRule, DirectionRule, DrivableRule, EgoSize, FirstStateRule, KeepingRule, LightRule,
    LightTick, LoopComfortRule, MissingRule, OverlapRule, Profile, ShortExpertRule, TtcRule,
};
pub use route::Ending;

use self::collision::Collisions;
use self::comfort::Comfort;
use self::direction::Direction;
use self::keeping::Keeping;
use self::moment::Surroundings;
use self::route::Route;
use crate::driving_score::{DrivingScore, FrameScore, Summary};
use crate::ego_area::LaneMarks;
use crate::error::ScoreError;

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

    /// Takes the next frame. Each comes once and in order; frames after an ending count too, so stop at it.
    ///
    /// # Errors
    /// [`ScoreError`] names the bad number; the frame is not counted then.
    pub fn observe(&mut self, frame: &Frame) -> Result<FrameScore, ScoreError> {
        frame.check(self.around.lanes.len())?;
        let profile = self.profile;
        let moment = self.around.moment(frame, &mut self.marks);
        let (collision, at_fault) = self.collisions.observe(&moment, &profile);
        let (ttc, meets) = time_to_collision::score(&moment, &profile, collision, &self.collisions);
        let drivable = drivable::score(&moment, &profile);
        let off_road = drivable == Some(0.0);
        let direction = self.direction.observe(&moment, &profile, off_road);
        let light = light::score(&moment, &profile);
        let keeping = self.keeping.observe(&moment, &profile, off_road);
        let (history, extended) = self.comfort.observe(&moment, &profile);
        let (share, ending) = self.route.observe(frame.tick, moment.ego.centre);
        let missing = match profile.missing {
            MissingRule::One => Some(1.0),
            MissingRule::LeftOut => None,
        };
        let terms = [Some(collision), drivable, direction, light, Some(ttc), keeping, history, extended];
        let score = FrameScore {
            tick: frame.tick,
            terms: terms.map(|term| term.or(missing)),
            at_fault_object: at_fault,
            ttc_object: meets,
            route_share: (!self.route.stands_still()).then_some(share),
            ending,
        };
        self.summary.add(&score);
        Ok(score)
    }

    /// Returns the score of all frames observed so far.
    ///
    /// # Errors
    /// [`ScoreError::TooFewStates`] before the second one.
    pub fn finish(&self) -> Result<DrivingScore, ScoreError> {
        let completion = self.route.completion(&self.profile);
        let score = self.summary.finish(self.profile.label(), completion)?;
        Ok(DrivingScore { route_length_m: self.route.length_m(), ended: self.route.ended, ..score })
    }
}

/// Scores a whole drive: the score of each frame and of the drive.
///
/// # Errors
/// [`ScoreError`] names what cannot be scored.
pub fn closed_loop(
    scene: &LoopScene,
    profile: Profile,
    frames: &[Frame],
) -> Result<(Vec<FrameScore>, DrivingScore), ScoreError> {
    let mut scorer = ClosedLoop::new(scene, profile)?;
    let scores = frames.iter().map(|frame| scorer.observe(frame)).collect::<Result<_, _>>()?;
    Ok((scores, scorer.finish()?))
}

#[cfg(test)]
mod tests;
