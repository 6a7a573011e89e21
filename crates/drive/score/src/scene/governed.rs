//! Which lanes the traffic lights of a map govern, and which of them show red.

use ds_world::{LightState, Scene};

/// The lanes that each light governs, in map order; lanes that the map lacks are left out.
#[derive(Debug, Clone)]
pub struct GovernedLanes(Vec<Vec<usize>>);

impl GovernedLanes {
    /// Lists the lanes of a scene's lights.
    #[must_use]
    pub fn of(scene: &Scene) -> Self {
        let lanes = scene.map.lanes.len();
        let governed = |light: &ds_world::TrafficLight| {
            light.lanes.iter().map(|lane| lane.0 as usize).filter(|lane| *lane < lanes).collect()
        };
        Self(scene.map.traffic_lights.iter().map(governed).collect())
    }

    /// Returns the lanes that show red, in rising order, given the state of every light in map order.
    #[must_use]
    pub fn red(&self, lights: &[LightState]) -> Vec<usize> {
        let shown = lights.iter().zip(&self.0).filter(|(light, _)| **light == LightState::Red);
        let mut lanes: Vec<usize> = shown.flat_map(|(_, lanes)| lanes.iter().copied()).collect();
        lanes.sort_unstable();
        lanes.dedup();
        lanes
    }
}
