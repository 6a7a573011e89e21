//! PDMS of NAVSIM v1.1: one plan against a scene, scored together with a reference plan (`scoring.md` §6).
//!
//! PDMS = NC·DAC × (5·EP + 5·TTC + 2·C)/12; DDC is computed with weight 0. Agents that touch the ego now are kept.

use crate::comfort::Within;
use crate::constants::NAVSIM_V1_VERSION;
use crate::constants::navsim::{COMFORT_WEIGHT, PROGRESS_WEIGHT, TTC_WEIGHT, V1_TTC_STEPS};
use crate::ego_area::EgoAreas;
use crate::epdms::check_states;
use crate::error::ScoreError;
use crate::metric::driving_direction::Junctions;
use crate::metric::lane_keeping::Places;
use crate::metric::{
    comfort_v1, drivable_area, driving_direction, ego_progress, no_at_fault_collision, time_to_collision,
};
use crate::motion::{Executed, PlannedPoses};
use crate::proposal::{Footsteps, Memory, Violation};
use crate::scene::{OpenLoopScene, PreparedScene};

/// The score of a plan under NAVSIM v1.1.
#[derive(Debug, Clone, PartialEq)]
pub struct NavsimV1 {
    /// The score definition.
    pub version: &'static str,
    /// NC: 0, ½ or 1.
    pub no_at_fault_collision: f64,
    /// DAC: 0 or 1.
    pub drivable_area: f64,
    /// DDC, which has no weight: 0, ½ or 1.
    pub driving_direction: f64,
    /// EP.
    pub ego_progress: f64,
    /// TTC: 0 or 1.
    pub time_to_collision: f64,
    /// C: 0 or 1.
    pub comfort: f64,
    /// The total.
    pub pdms: f64,
    /// Progress along the centreline, in metres.
    pub progress_raw_m: f64,
    /// The areas per step.
    pub areas: EgoAreas,
    /// The first at-fault collision.
    pub first_at_fault: Option<Violation>,
    /// The first too short time to collision.
    pub first_time_to_collision: Option<Violation>,
    /// The terms of C.
    pub comfort_terms: Within,
    /// The executed states.
    pub states: Executed,
}

/// Scores a plan under NAVSIM v1.1, together with a reference plan.
///
/// # Errors
/// [`ScoreError`] names what cannot be scored.
pub fn navsim_v1(scene: &OpenLoopScene, reference: &PlannedPoses, plan: &PlannedPoses) -> Result<NavsimV1, ScoreError> {
    let scene = PreparedScene::new(scene)?;
    let reference = scene.executor.execute(&scene.ego, reference)?;
    let states = scene.executor.execute(&scene.ego, plan)?;
    navsim_v1_executed(&scene, &reference, &states)
}

/// Scores states that were executed already, together with those of the reference plan.
///
/// # Errors
/// [`ScoreError::NotFinite`] names a bad state.
pub fn navsim_v1_executed(
    scene: &PreparedScene,
    reference: &Executed,
    states: &Executed,
) -> Result<NavsimV1, ScoreError> {
    check_states(reference)?;
    check_states(states)?;
    let mut memory = Memory::default();
    let reference = measure(scene, reference, &mut memory);
    let mut own = measure(scene, states, &mut memory);
    let multipliers = |one: &NavsimV1| one.no_at_fault_collision * one.drivable_area;
    let progress = |one: &NavsimV1| (one.progress_raw_m, multipliers(one));
    let best_m = ego_progress::best_m([progress(&reference), progress(&own)].into_iter());
    own.ego_progress = ego_progress::score_v1(own.progress_raw_m, multipliers(&own), best_m);
    let sum = PROGRESS_WEIGHT * own.ego_progress + TTC_WEIGHT * own.time_to_collision + COMFORT_WEIGHT * own.comfort;
    own.pdms = multipliers(&own) * sum / (PROGRESS_WEIGHT + TTC_WEIGHT + COMFORT_WEIGHT);
    Ok(own)
}

/// Measures executed states; EP and the total are left at 0.
fn measure(scene: &PreparedScene, states: &Executed, memory: &mut Memory) -> NavsimV1 {
    let traffic = [&scene.traffic_v1];
    let steps = Footsteps::new(states, &scene.footprint);
    memory.find_near(&traffic, &steps);
    let areas = EgoAreas::new(&scene.map.areas, &steps, &mut memory.lanes);
    let (no_at_fault_collision, first_at_fault) = no_at_fault_collision::score(memory.near(&traffic), &steps, &areas);
    let (time_to_collision, first_time_to_collision) =
        time_to_collision::score(memory.near(&traffic), &scene.map.areas, &steps, &areas, V1_TTC_STEPS);
    let (comfort, comfort_terms) = comfort_v1::score(&scene.filters.executed_v1, states, memory);
    NavsimV1 {
        version: NAVSIM_V1_VERSION,
        no_at_fault_collision,
        drivable_area: drivable_area::score(&areas).0,
        driving_direction: driving_direction::score(&steps, &areas, Junctions::Counted).0,
        ego_progress: 0.0,
        time_to_collision,
        comfort,
        pdms: 0.0,
        progress_raw_m: ego_progress::raw_m(&Places::new(&scene.map.centreline, &steps)),
        areas,
        first_at_fault,
        first_time_to_collision,
        comfort_terms,
        states: *states,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::road::{drive, scene};

    #[test]
    fn totals_by_hand() {
        // The reference goes 40 m; off the route's lanes costs nothing, off the road everything.
        for (speed_mps, aside_m, ep, pdms) in
            [(10.0, 0.0, 1.0, 1.0), (5.0, 0.0, 0.5, (2.5 + 7.0) / 12.0), (10.0, 3.5, 1.0, 1.0), (10.0, -0.7, 0.0, 0.0)]
        {
            let prepared = PreparedScene::new(&scene(10.0)).expect("a sound scene");
            let got =
                navsim_v1_executed(&prepared, &drive(10.0, 0.0), &drive(speed_mps, aside_m)).expect("sound states");
            assert!((got.ego_progress - ep).abs() < 1e-9 && (got.pdms - pdms).abs() < 1e-9, "{got:?}");
        }
    }
}
