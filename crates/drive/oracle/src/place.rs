//! A scene as the score sees it: indexed map, lanes governed by lights.

use std::sync::Arc;

use ds_score::{Footprint, GovernedLanes, PreparedMap, PreparedScene, SceneNow, ScoreError, open_loop_map};
use ds_sim::Simulation;
use ds_world::Scene;

use crate::moment::Driven;

/// The fixed part of a scene.
#[derive(Debug)]
pub(crate) struct Place {
    map: Arc<PreparedMap>,
    footprint: Footprint,
    governed: GovernedLanes,
}

impl Place {
    pub(crate) fn new(scene: &Scene) -> Result<Self, ScoreError> {
        Ok(Self {
            map: Arc::new(PreparedMap::new(&open_loop_map(scene))?),
            footprint: Footprint::from(&scene.vehicle),
            governed: GovernedLanes::of(scene),
        })
    }

    /// Prepares to score proposals now among the agents of a rollout; without agents if each proposal brings its own.
    pub(crate) fn moment(&self, now: &Simulation, beside: &Driven, agents: bool) -> Result<PreparedScene, ScoreError> {
        let now = SceneNow {
            ego: (&now.state().ego).into(),
            past: None,
            agents: if agents { beside.tracks.clone() } else { Vec::new() },
            red_areas: beside.lights.iter().map(|lights| self.governed.red(lights)).collect(),
            footprint: self.footprint,
        };
        PreparedScene::on(&self.map, &now)
    }
}
