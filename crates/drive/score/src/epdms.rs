//! EPDMS of NAVSIM v2: one plan against a scene, scored together with a reference plan (`scoring.md` §4 and §6).
//!
//! EPDMS = NC·DAC·DDC·TLC × (5·EP + 5·TTC + 2·LK + 2·HC + 2·EC)/16, without a previous frame EC drops out (/14).

use crate::comfort::Within;
use crate::constants::NAVSIM_V2_VERSION;
use crate::constants::navsim::{
    COMFORT_WEIGHT, EXTENDED_COMFORT_WEIGHT, LANE_WEIGHT, PROGRESS_WEIGHT, TTC_WEIGHT, V2_TTC_STEPS,
};
use crate::ego_area::EgoAreas;
use crate::error::ScoreError;
use crate::metric::driving_direction::Junctions;
use crate::metric::lane_keeping::Places;
use crate::metric::{
    drivable_area, driving_direction, ego_progress, history_comfort, lane_keeping, no_at_fault_collision,
    time_to_collision, traffic_light,
};
use crate::motion::{Coverage, Executed, PlannedPoses, VehicleState};
use crate::proposal::{Footsteps, Memory, Violation};
use crate::scene::{OpenLoopScene, PreparedScene, Traffic};

/// The sub-scores of a plan, each in 0..=1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SubScores {
    /// NC: 0, ½ or 1.
    pub no_at_fault_collision: f64,
    /// DAC: 0 or 1.
    pub drivable_area: f64,
    /// DDC: 0, ½ or 1.
    pub driving_direction: f64,
    /// TLC: 0 or 1.
    pub traffic_light: f64,
    /// EP.
    pub ego_progress: f64,
    /// TTC: 0 or 1.
    pub time_to_collision: f64,
    /// LK: 0 or 1.
    pub lane_keeping: f64,
    /// HC: 0 or 1.
    pub history_comfort: f64,
}

impl SubScores {
    /// Returns the product of the multipliers.
    #[must_use]
    pub fn multipliers(&self) -> f64 {
        self.no_at_fault_collision * self.drivable_area * self.driving_direction * self.traffic_light
    }

    /// Returns the EPDMS: with EC over 16, without it over 14.
    #[must_use]
    pub fn epdms(&self, extended_comfort: Option<f64>) -> f64 {
        let mut sum = PROGRESS_WEIGHT * self.ego_progress
            + TTC_WEIGHT * self.time_to_collision
            + LANE_WEIGHT * self.lane_keeping
            + COMFORT_WEIGHT * self.history_comfort;
        let mut weights = PROGRESS_WEIGHT + TTC_WEIGHT + LANE_WEIGHT + COMFORT_WEIGHT;
        if let Some(extended_comfort) = extended_comfort {
            sum += EXTENDED_COMFORT_WEIGHT * extended_comfort;
            weights += EXTENDED_COMFORT_WEIGHT;
        }
        self.multipliers() * sum / weights
    }

    /// Forgives what the human driver failed wholly too: where the human's value is 0, the plan's becomes 1.
    #[must_use]
    pub fn forgiven(&self, human: &Self) -> Self {
        let forgive = |own: f64, human: f64| if human == 0.0 { 1.0 } else { own };
        Self {
            no_at_fault_collision: forgive(self.no_at_fault_collision, human.no_at_fault_collision),
            drivable_area: forgive(self.drivable_area, human.drivable_area),
            driving_direction: forgive(self.driving_direction, human.driving_direction),
            traffic_light: forgive(self.traffic_light, human.traffic_light),
            ego_progress: forgive(self.ego_progress, human.ego_progress),
            time_to_collision: forgive(self.time_to_collision, human.time_to_collision),
            lane_keeping: forgive(self.lane_keeping, human.lane_keeping),
            history_comfort: forgive(self.history_comfort, human.history_comfort),
        }
    }
}

/// The first step at which each rule was broken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FirstViolations {
    /// An at-fault collision.
    pub at_fault: Option<Violation>,
    /// Too short a time to collision.
    pub time_to_collision: Option<Violation>,
    /// A corner off drivable surface.
    pub off_road: Option<Violation>,
    /// Two metres of travel off the route's lanes within 1 s.
    pub direction: Option<Violation>,
    /// A touch of a red connector.
    pub red_light: Option<Violation>,
    /// Two seconds on end beside the centreline.
    pub lane: Option<Violation>,
}

/// What can be said of an executed plan before it is compared with others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// The sub-scores; EP is not known yet and 1.
    pub scores: SubScores,
    /// Progress along the centreline, in metres.
    pub progress_raw_m: f64,
    /// The areas per step.
    pub areas: EgoAreas,
    /// The first violations.
    pub first: FirstViolations,
    /// The terms of HC over past and executed states; `None` without a past.
    pub history_terms: Option<Within>,
}

impl Measured {
    /// Fills in EP, given the best progress of all proposals in metres.
    pub(crate) fn with_progress(mut self, best_m: f64) -> Self {
        self.scores.ego_progress = ego_progress::score_v2(self.progress_raw_m, best_m);
        self
    }

    pub(crate) fn progress(&self) -> (f64, f64) {
        (self.progress_raw_m, self.scores.multipliers())
    }
}

/// The score of a plan under NAVSIM v2.
#[derive(Debug, Clone, PartialEq)]
pub struct NavsimV2 {
    /// The score definition.
    pub version: &'static str,
    /// The sub-scores after the human filter.
    pub scores: SubScores,
    /// The sub-scores before it.
    pub unfiltered: SubScores,
    /// EPDMS after the human filter, without EC (divisor 14).
    pub epdms: f64,
    /// EPDMS before it, without EC.
    pub epdms_unfiltered: f64,
    /// Progress along the centreline, in metres.
    pub progress_raw_m: f64,
    /// The areas per step.
    pub areas: EgoAreas,
    /// The first violations, before the human filter.
    pub first: FirstViolations,
    /// The comfort terms of the executed states alone.
    pub comfort_terms: Within,
    /// The comfort terms with the past, which make HC.
    pub history_terms: Option<Within>,
    /// How the plan covers the horizon.
    pub coverage: Coverage,
    /// The executed states.
    pub states: Executed,
    /// The sub-scores of the reference plan.
    pub reference: SubScores,
    /// Progress of the reference plan, in metres.
    pub reference_progress_raw_m: f64,
    /// The executed states of the reference plan.
    pub reference_states: Executed,
}

/// Scores a plan under NAVSIM v2, together with a reference plan; `human` is the recorded drive for the human filter.
///
/// # Errors
/// [`ScoreError`] names what cannot be scored.
pub fn navsim_v2(
    scene: &OpenLoopScene,
    reference: &PlannedPoses,
    human: Option<&PlannedPoses>,
    plan: &PlannedPoses,
) -> Result<NavsimV2, ScoreError> {
    let scene = PreparedScene::new(scene)?;
    let yardstick = Yardstick::new(&scene, reference, human)?;
    yardstick.score(&scene, plan)
}

/// What plans of one scene are compared with: the executed reference plan and the human's sub-scores.
#[derive(Debug, Clone)]
pub struct Yardstick {
    states: Executed,
    measured: Measured,
    human: Option<SubScores>,
}

impl Yardstick {
    /// Executes and measures the reference plan, and the human plan if the filter is wanted.
    ///
    /// # Errors
    /// [`ScoreError`] if a plan is refused.
    pub fn new(
        scene: &PreparedScene,
        reference: &PlannedPoses,
        human: Option<&PlannedPoses>,
    ) -> Result<Self, ScoreError> {
        let mut memory = Memory::default();
        let states = scene.executor.execute(&scene.ego, reference)?;
        let measured = measure(scene, &[&scene.traffic], scene.past.as_deref(), &states, &mut memory);
        let human = match human {
            None => None,
            Some(human) => {
                let states = scene.executor.execute(&scene.ego, human)?;
                let measured = measure(scene, &[&scene.traffic], None, &states, &mut memory);
                let best_m = ego_progress::best_m(std::iter::once(measured.progress()));
                Some(measured.with_progress(best_m).scores)
            }
        };
        Ok(Self { states, measured, human })
    }

    /// Returns what was measured of the reference plan.
    #[must_use]
    pub fn measured(&self) -> &Measured {
        &self.measured
    }

    /// Returns the executed states of the reference plan.
    #[must_use]
    pub fn states(&self) -> &Executed {
        &self.states
    }

    /// Executes a plan and scores it with the reference as the only other proposal.
    ///
    /// # Errors
    /// [`ScoreError`] if the plan is refused.
    pub fn score(&self, scene: &PreparedScene, plan: &PlannedPoses) -> Result<NavsimV2, ScoreError> {
        let states = scene.executor.execute(&scene.ego, plan)?;
        self.score_executed(scene, &states, plan.coverage())
    }

    /// Scores states that were executed already.
    ///
    /// # Errors
    /// [`ScoreError::NotFinite`] names a bad state.
    pub fn score_executed(
        &self,
        scene: &PreparedScene,
        states: &Executed,
        coverage: Coverage,
    ) -> Result<NavsimV2, ScoreError> {
        check_states(states)?;
        let mut memory = Memory::default();
        let measured = measure(scene, &[&scene.traffic], scene.past.as_deref(), states, &mut memory);
        let best_m = ego_progress::best_m([self.measured.progress(), measured.progress()].into_iter());
        let measured = measured.with_progress(best_m);
        let unfiltered = measured.scores;
        let scores = self.human.as_ref().map_or(unfiltered, |human| unfiltered.forgiven(human));
        let displacement_m = scene.footprint.rear_axle_to_centre_m;
        Ok(NavsimV2 {
            version: NAVSIM_V2_VERSION,
            scores,
            unfiltered,
            epdms: scores.epdms(None),
            epdms_unfiltered: unfiltered.epdms(None),
            progress_raw_m: measured.progress_raw_m,
            areas: measured.areas,
            first: measured.first,
            comfort_terms: scene.filters.executed.within(states, displacement_m, &mut memory.comfort),
            history_terms: measured.history_terms,
            coverage,
            states: *states,
            reference: self.measured.with_progress(best_m).scores,
            reference_progress_raw_m: self.measured.progress_raw_m,
            reference_states: self.states,
        })
    }
}

pub(crate) fn check_states(states: &[VehicleState]) -> Result<(), ScoreError> {
    for (step, state) in states.iter().enumerate() {
        if let Some((name, value)) = state.not_finite() {
            return Err(ScoreError::NotFinite { field: format!("states[{step}].{name}"), value });
        }
    }
    Ok(())
}

/// Measures an executed plan among the agents of all given traffics; EP is left at 1.
pub(crate) fn measure(
    scene: &PreparedScene,
    traffic: &[&Traffic],
    past: Option<&[VehicleState]>,
    states: &Executed,
    memory: &mut Memory,
) -> Measured {
    let steps = Footsteps::new(states, &scene.footprint);
    memory.find_near(traffic, &steps);
    let areas = EgoAreas::new(&scene.map.areas, &steps, &mut memory.lanes);
    let places = Places::new(&scene.map.centreline, &steps);
    let (no_at_fault_collision, at_fault) = no_at_fault_collision::score(memory.near(traffic), &steps, &areas);
    let (drivable_area, off_road) = drivable_area::score(&areas);
    let (driving_direction, direction) = driving_direction::score(&steps, &areas, Junctions::Exempt);
    let (traffic_light, red_light) = traffic_light::score(&scene.map.areas, &scene.red, &steps);
    let (time_to_collision, short) =
        time_to_collision::score(memory.near(traffic), &scene.map.areas, &steps, &areas, V2_TTC_STEPS);
    let (lane_keeping, lane) = lane_keeping::score(&places, &areas);
    let displacement_m = scene.footprint.rear_axle_to_centre_m;
    let history_terms =
        past.map(|past| history_comfort::within(&scene.filters.history, past, states, displacement_m, memory));
    Measured {
        scores: SubScores {
            no_at_fault_collision,
            drivable_area,
            driving_direction,
            traffic_light,
            ego_progress: 1.0,
            time_to_collision,
            lane_keeping,
            history_comfort: history_comfort::score(history_terms.as_ref()),
        },
        progress_raw_m: ego_progress::raw_m(&places),
        areas,
        first: FirstViolations { at_fault, time_to_collision: short, off_road, direction, red_light, lane },
        history_terms,
    }
}

#[cfg(test)]
mod tests;
