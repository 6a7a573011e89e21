//! A scene as the score sees it: indexed map, centreline, lanes governed by lights.

use std::sync::Arc;

use ds_score::{
    AreaKind, Footprint, MapArea, OpenLoopMap, PreparedMap, PreparedScene, SceneNow, ScoreError, loop_scene,
};
use ds_sim::Simulation;
use ds_space::DVec2;
use ds_world::{LightState, Scene};

use crate::moment::Driven;

/// The fixed part of a scene.
#[derive(Debug)]
pub(crate) struct Place {
    map: Arc<PreparedMap>,
    footprint: Footprint,
    /// Per light the areas that it governs.
    light_areas: Vec<Vec<usize>>,
}

impl Place {
    pub(crate) fn new(scene: &Scene) -> Result<Self, ScoreError> {
        let fixed = loop_scene(scene, None);
        let area = |kind, on_route, outline: &Vec<DVec2>| MapArea {
            kind,
            on_route,
            outline: outline.clone(),
            holes: Vec::new(),
        };
        let mut areas = Vec::new();
        areas.extend(fixed.lanes.iter().map(|lane| {
            let kind = if lane.connector { AreaKind::LaneConnector } else { AreaKind::Lane };
            area(kind, lane.on_route, &lane.outline)
        }));
        areas.extend(fixed.drivable.iter().map(|outline| area(AreaKind::Roadblock, false, outline)));
        areas.extend(fixed.junctions.iter().map(|outline| area(AreaKind::Intersection, false, outline)));
        let centreline = if scene.route.len() >= 2 { scene.route.clone() } else { fixed.expert_path.clone() };
        let lanes = scene.map.lanes.len();
        let governed = |light: &ds_world::TrafficLight| {
            light.lanes.iter().map(|lane| lane.0 as usize).filter(|lane| *lane < lanes).collect()
        };
        Ok(Self {
            map: Arc::new(PreparedMap::new(&OpenLoopMap { areas, centreline })?),
            footprint: Footprint::from(&scene.vehicle),
            light_areas: scene.map.traffic_lights.iter().map(governed).collect(),
        })
    }

    /// Prepares to score proposals now among the agents of a rollout; without agents if each proposal brings its own.
    pub(crate) fn moment(&self, now: &Simulation, beside: &Driven, agents: bool) -> Result<PreparedScene, ScoreError> {
        let red = |lights: &Vec<LightState>| {
            let shown = lights.iter().zip(&self.light_areas).filter(|(light, _)| **light == LightState::Red);
            let mut areas: Vec<usize> = shown.flat_map(|(_, areas)| areas.iter().copied()).collect();
            areas.sort_unstable();
            areas.dedup();
            areas
        };
        let now = SceneNow {
            ego: (&now.state().ego).into(),
            past: None,
            agents: if agents { beside.tracks.clone() } else { Vec::new() },
            red_areas: beside.lights.iter().map(red).collect(),
            footprint: self.footprint,
        };
        PreparedScene::on(&self.map, &now)
    }
}
