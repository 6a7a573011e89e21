//! The layout image of a sample's state, as the known camera would see it: the raster that `rap` learns from beside frames.

use std::collections::BTreeMap;
use std::sync::Arc;

use ds_layout::{LayoutScene, Renderer, StaticMap};
use ds_policy::camera::eye::known_camera;
use ds_raster::RgbImage;
use ds_sim::{SimConfig, Simulation};
use ds_world::{LayoutBackend, Scene};

use super::PolicyTrainError;
use super::dataset::{Place, ScenarioSplit, scene};

/// Draws states of training scenarios; scenes that were met before are kept.
pub(super) struct Rasters {
    renderer: Renderer,
    scenes: BTreeMap<u64, (Arc<Scene>, StaticMap)>,
}

impl Rasters {
    /// Opens the renderer.
    pub(super) fn open() -> Result<Self, PolicyTrainError> {
        let refuse = |source| PolicyTrainError::Raster { name: "none".to_owned(), source };
        Ok(Self { renderer: Renderer::new(LayoutBackend::Cpu).map_err(refuse)?, scenes: BTreeMap::new() })
    }

    /// Draws the state where a training sample was taken.
    pub(super) fn image(&mut self, place: &Place) -> Result<RgbImage, PolicyTrainError> {
        let (scene, map) = self.scenes.entry(place.scenario).or_insert_with(|| {
            let scene = Arc::new(scene(ScenarioSplit::Training, place.scenario));
            let map = StaticMap::new(&scene.map);
            (scene, map)
        });
        let name = || scene.name.clone();
        let config = SimConfig { agents: None, ..SimConfig::default() };
        let simulation = Simulation::new(Arc::clone(scene), config, place.tick)
            .map_err(|source| PolicyTrainError::Simulation { name: name(), source })?;
        let shown = LayoutScene { map, world: simulation.state() };
        let drawn = self.renderer.render(&shown, &known_camera(), place.pose.world_from_rig(0.0));
        drawn.map_err(|source| PolicyTrainError::Raster { name: name(), source })
    }
}
