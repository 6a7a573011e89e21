//! Whether a variant's adversary keeps clear of the others where these react (`idm-all`), until it meets the ego.
//!
//! The ego drives its log by plans from the hand-over on, as the policy `log-replay` does; the adversary drives as planned.
//! What all others do as logged is checked without a simulation.

use std::sync::Arc;

use ds_sim::{IdmScope, SimConfig, Simulation};
use ds_space::plane::OrientedBox;
use ds_space::{AgentId, SimTime, Tick};
use ds_world::{Adversary, AdversaryMode, AgentMode, Scene, Trajectory, TrajectoryPoint, WorldState};

/// Ticks between two plans of the ego.
const REPLAN_TICKS: u32 = 5;
/// Ticks of a plan.
const PLAN_TICKS: u32 = 30;

/// Says whether an adversary stays so far from all reacting others from the hand-over until it meets the ego, at the latest
/// until a tick.
pub(crate) fn keeps_clear(scene: &Scene, agent: AgentId, (hand_over, last): (Tick, Tick), margin_m: f64) -> bool {
    let adversary = scene.adversary.clone().map(|it| Adversary { mode: AdversaryMode::Replay, ..it });
    let replayed = Arc::new(Scene { adversary, ..scene.clone() });
    let config = SimConfig { agents: IdmScope::of(AgentMode::IdmAll), ..SimConfig::default() };
    let Ok(mut simulation) = Simulation::new(Arc::clone(&replayed), config, hand_over) else { return false };
    while simulation.state().tick < last {
        let ticks = simulation.state().tick.0 - hand_over.0;
        if ticks.is_multiple_of(REPLAN_TICKS) {
            let Some(plan) = logged_plan(&replayed, simulation.state()) else { return false };
            simulation.begin_plan(&plan);
        }
        let state = simulation.step();
        if state.contacts.iter().any(|contact| contact.agent == agent) {
            return true;
        }
        if near(state, agent, margin_m) {
            return false;
        }
    }
    true
}

/// Returns the logged drive from a world on, as a plan in the rig of its ego.
fn logged_plan(scene: &Scene, state: &WorldState) -> Option<Trajectory> {
    let point = |ahead: u32| {
        let logged = scene.logged_ego(state.tick.plus(ahead)).pose;
        TrajectoryPoint { after: SimTime::at(Tick(ahead), scene.dt), pose: state.ego.pose.relative(&logged) }
    };
    Trajectory::new((1..=PLAN_TICKS).map(point).collect()).ok()
}

/// Says whether an agent comes nearer than a margin to anybody but the ego.
fn near(state: &WorldState, agent: AgentId, margin_m: f64) -> bool {
    let Some(car) = state.agents.iter().find(|it| it.id == agent) else { return false };
    let grown = OrientedBox::new(&car.pose, car.size.length_m + 2.0 * margin_m, car.size.width_m + 2.0 * margin_m);
    state.agents.iter().filter(|it| it.id != agent).any(|it| it.footprint().touches(&grown))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{MotionModel, Options, variants};
    use ds_scenario::{Family, generate};
    use ds_world::{AgentClass, CrashClass, Track};

    #[test]
    fn who_is_in_the_way_before_the_contact_is_hit() {
        let options = Options { classes: vec![CrashClass::OppositeDirection], solve: false, ..Options::default() };
        let scene = generate(Family::FreeCurve, 1000);
        let built = variants(&scene, &MotionModel::town(), &options).expect("the ego drives");
        let variant = built.variants.first().expect("a variant");
        let until = (options.hand_over, variant.measures.met.tick);
        assert!(keeps_clear(&variant.scene, variant.agent, until, 0.2));
        let mut blocked = variant.scene.clone();
        let adversary = &blocked.tracks[variant.agent.0 as usize];
        let there = adversary.points[30];
        blocked.tracks.push(Track {
            name: "in the way".to_owned(),
            class: AgentClass::Vehicle,
            size: adversary.size,
            points: vec![there; adversary.points.len()],
        });
        assert!(!keeps_clear(&blocked, variant.agent, until, 0.2));
    }
}
