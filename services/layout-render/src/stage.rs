//! The layout stage: one renderer per episode, one `layout` per tick and camera.

use std::sync::Arc;

use ds_layout::{LayoutBackend, LayoutError, LayoutScene, Renderer, StaticMap, carriable};
use ds_process::maker::{Fault, Inputs, Maker, MakerFactory, Output, bad, output};
use ds_raster::Encoding;
use ds_topic::{Advance, Layout, LayoutGeometry, Role, SceneMessage, Slot, Topic, World};

/// Geometry is told where a video model goes on from layouts of before, and not of larger pictures: no message is to outgrow its
/// limit for a picture of no video model.
const MOST_TOLD_PX: usize = 1 << 21;

/// Opens a renderer for each episode that the instance is given.
#[derive(Debug, Clone, Copy)]
pub struct LayoutStage {
    /// Whether to look for a graphics adapter at the start and name it in the compute class; not needed where only the
    /// `cpu` back end is asked for.
    pub probe: bool,
}

impl MakerFactory for LayoutStage {
    fn role(&self) -> Role {
        Role::Layout
    }

    fn compute_class(&self) -> String {
        let choice = if self.probe { LayoutBackend::Auto } else { LayoutBackend::Cpu };
        let class = Renderer::new(choice).map_or("none".to_owned(), |renderer| renderer.compute_class());
        format!("layout {}, {class}", std::env::consts::ARCH)
    }

    fn open(&self, scene: Arc<SceneMessage>) -> Result<Box<dyn Maker>, Fault> {
        let renderer = Renderer::new(scene.spec.layout_backend).map_err(|error| bad("no_renderer", &error))?;
        tracing::info!(backend = renderer.describe(), "layout renderer ready");
        let map = StaticMap::new(&scene.scene.map);
        Ok(Box::new(Drawing { scene, map, renderer }))
    }
}

struct Drawing {
    scene: Arc<SceneMessage>,
    map: StaticMap,
    renderer: Renderer,
}

impl Maker for Drawing {
    fn restore(&mut self, _order: &Advance, _inputs: &Inputs) -> Result<(), Fault> {
        Ok(())
    }

    fn work(&mut self, order: &Advance, inputs: &Inputs) -> Result<Vec<Output>, Fault> {
        let mut outputs = Vec::new();
        for tick in order.first.to(order.last) {
            let world: World = inputs.decode(Slot::new(Topic::World, tick.0))?;
            let ego_in_world = world.state.ego.pose;
            let described = LayoutScene { map: &self.map, world: &world.state };
            for (index, camera) in (0..).zip(&self.scene.scene.cameras) {
                let pose = ego_in_world.world_from_rig(0.0);
                let failed = |error: LayoutError| bad("render_failed", &error);
                let image = self.renderer.render(&described, camera, pose).map_err(failed)?;
                let told = self.scene.spec.layout_geometry && image.rgb().len() / 3 <= MOST_TOLD_PX;
                let geometry = told.then(|| self.renderer.geometry(&described, camera, pose)).transpose();
                let geometry = geometry.map_err(failed)?.map(|seen| {
                    let seen = carriable(seen, &image);
                    LayoutGeometry { inverse_depths: seen.inverse_depths, movers: seen.movers }
                });
                let layout = Layout { image, encoding: Encoding::None, ego_in_world, geometry };
                outputs.push(output(Slot::of_camera(Topic::Layout, tick.0, index), tick, &layout));
            }
        }
        Ok(outputs)
    }
}
