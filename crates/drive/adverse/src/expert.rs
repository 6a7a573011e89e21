//! Privileged: the expert as a policy, which tries its plans in copies of the live world.
//!
//! Of the logged drive (while the ego keeps to it), what `idm` would do, and 9 lateral offsets × 9 accelerations, mildest
//! first, it takes the first that touches nobody and stays on the road for 6 s; if none does, the one that stays so longest.
//! With the 4 s of the proof it put off what was to be done until an oncoming adversary left it nothing to do.

use std::sync::Arc;

use ds_policy::idm::Idm;
use ds_policy::log_replay::LogReplay;
use ds_policy::{Observation, Policy, PolicyAnswer, PolicyError, PrivilegedView, Restart};
use ds_sim::{SimConfig, Simulation};
use ds_world::{Anchor, EgoState, Trajectory};

use crate::road::Road;
use crate::solve::{Look, choose, logged_way, wishes};

const NAME: &str = Anchor::Expert.name();
/// A plan is tried to its end. Keeping a distance in time as the proof of a solution does costs the anchor its progress.
const LOOK: Look = Look { ticks: 60, apart_ticks: 0 };
/// An ego this near to its log, in metres and metres per second, may go on by it.
const ON_LOG: (f64, f64) = (1.0, 1.0);

/// Drives what it has tried.
#[derive(Debug, Default)]
pub struct Expert {
    config: SimConfig,
    idm: Idm,
}

impl Expert {
    /// Makes an expert of the world of an episode.
    #[must_use]
    pub fn new(config: SimConfig) -> Self {
        Self { config, idm: Idm::default() }
    }
}

impl Policy for Expert {
    fn name(&self) -> &str {
        NAME
    }

    fn privileged(&self) -> bool {
        true
    }

    fn plan(
        &mut self,
        observation: &Observation,
        privileged: Option<&PrivilegedView>,
    ) -> Result<PolicyAnswer, PolicyError> {
        let view = privileged.ok_or(PolicyError::NeedsPrivilege { name: NAME })?;
        let (live, now) = view.live(NAME)?;
        let restored = Simulation::restore(Arc::clone(&view.scene), self.config.clone(), &live.snapshot);
        let simulation = restored.map_err(|error| PolicyError::World { name: NAME, source: Box::new(error) })?;
        let idm = self.idm.plan(observation, privileged)?.trajectory;
        let logged = LogReplay.plan(observation, privileged)?.trajectory;
        let keeps = keeps(&now.ego, view.scene.logged_ego(now.tick));
        let known: Vec<Trajectory> = keeps.then_some(logged).into_iter().chain([idm.clone()]).collect();
        let way = logged_way(&view.scene);
        let aside = way.iter().flat_map(|way| wishes(&simulation, way));
        let chosen = choose(&Road::new(&view.scene.map), &simulation, LOOK, known.into_iter().chain(aside));
        Ok(PolicyAnswer::single(chosen.unwrap_or(idm)))
    }

    fn restart(&self) -> Restart {
        Restart::Stateless
    }
}

/// Says whether an ego is where it was logged, at the speed it was logged with.
fn keeps(ego: &EgoState, logged: &EgoState) -> bool {
    let apart_m = ego.pose.position.distance(logged.pose.position);
    apart_m <= ON_LOG.0 && (ego.speed_mps() - logged.speed_mps()).abs() <= ON_LOG.1
}
