//! The encounter of a variant along the logged drive, as the rules of validity see it: worlds, time to collision, contact.

use std::sync::Arc;

use ds_sim::{SimConfig, Simulation};
use ds_space::Tick;
use ds_world::{Contact, Scene, WorldState};

use crate::measure::time_to_touch;
use crate::stage::pair;

/// What happens if the ego drives its log.
#[derive(Debug, Clone)]
pub struct Course {
    /// The world of each tick from the first.
    pub states: Vec<WorldState>,
    /// Time to collision of the ego with the adversary at each tick, at constant velocities, in seconds; none beyond 4 s.
    pub ttc_secs: Vec<Option<f64>>,
    /// The first contact with the adversary.
    pub contact: Option<(Tick, Contact)>,
}

impl Course {
    /// Drives the log of a scenario to a tick, all others as logged; nothing without an adversary or a log.
    #[must_use]
    pub fn of(scene: &Arc<Scene>, last: Tick) -> Option<Self> {
        let adversary = scene.adversary.as_ref()?.track;
        let config = SimConfig { agents: None, ..SimConfig::default() };
        let mut simulation = Simulation::new(Arc::clone(scene), config, Tick(0)).ok()?;
        let mut course = Self { states: Vec::new(), ttc_secs: Vec::new(), contact: None };
        loop {
            let state = simulation.state();
            let met = state.contacts.iter().find(|contact| contact.agent == adversary);
            course.contact = course.contact.or(met.map(|contact| (state.tick, *contact)));
            course.ttc_secs.push(ttc(scene, state));
            course.states.push(state.clone());
            if state.tick >= last {
                return Some(course);
            }
            simulation.step();
        }
    }
}

fn ttc(scene: &Scene, state: &WorldState) -> Option<f64> {
    let (ego_body, other) = pair(scene, state)?;
    let ego = &state.ego;
    let ego_mps = ego.pose.forward() * ego.velocity_mps.x + ego.pose.left() * ego.velocity_mps.y;
    time_to_touch(&ego_body, &other.footprint(), other.velocity_mps - ego_mps)
}
