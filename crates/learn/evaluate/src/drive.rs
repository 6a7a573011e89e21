//! A drive that frames are generated for: layouts, the world's own frames and their truth, by frame number.

use std::sync::Arc;

use ds_camera::{Appearance, CameraWorld, LabelledCamera};
use ds_layout::{LayoutBackend, LayoutScene, Renderer, StaticMap, carriable};
use ds_perception::Label;
use ds_perception::label::Crosswalks;
use ds_perception::lights::{self, SeenLight};
use ds_raster::{Geometry, RgbImage};
use ds_scenario::Facts;
use ds_space::{CameraModel, DQuat, Digest, Draws};
use ds_video::Layout;
use ds_world::{Scene, WorldState};

use crate::course::Course;
use crate::error::EvaluationError;

/// The frames whose course a prompt tells of, as those of training clips do.
const TOLD_FRAMES: u32 = 40;

/// Where and how a drive goes.
#[derive(Debug, Clone)]
pub struct Route {
    /// The scenario.
    pub scene: Arc<Scene>,
    /// The first frame's tick of the log.
    pub start: u32,
    /// Ticks of the log per frame.
    pub pace: f64,
    /// The look.
    pub look: Appearance,
    /// How far the camera is turned to the left, in degrees.
    pub turned_deg: f64,
}

/// A drive, ready to be looked at.
pub struct Drive {
    /// The scenario's name with the tick of its first frame.
    pub name: String,
    /// Look, road, road users and motion in words.
    pub prompt: String,
    /// Keys the noise of a model.
    pub draw_key: Digest,
    /// The front camera at the size of the frames.
    pub model: CameraModel,
    course: Course,
    camera: Box<dyn LabelledCamera>,
    map: StaticMap,
    /// The same without what stands beside the road, once an arm has asked for it.
    bare: Option<StaticMap>,
    crosswalks: Crosswalks,
    renderer: Renderer,
}

impl Drive {
    /// Prepares a drive for frames of a size.
    ///
    /// # Errors
    /// If the scenario has no camera.
    pub fn new(world: &dyn CameraWorld, route: &Route, size_px: (u32, u32)) -> Result<Self, EvaluationError> {
        let scene = &route.scene;
        let model = scene.cameras.first().cloned();
        let mut model = model.ok_or_else(|| EvaluationError::NoCamera { scenario: scene.name.clone() })?;
        model.intrinsics = model.intrinsics.resized(size_px.0, size_px.1);
        let turned = DQuat::from_rotation_z(route.turned_deg.to_radians());
        model.rig_from_camera.rotation = turned * model.rig_from_camera.rotation;
        let model = world.rig(&model);
        let course = Course::new(Arc::clone(scene), route.start, route.pace);
        let facts = Facts::of(scene, &course.world(0), &course.world(TOLD_FRAMES), route.look.prompt());
        let prompt = ds_scenario::prompt(&facts);
        Ok(Self {
            name: format!("{}@{}", scene.name, route.start),
            draw_key: Draws::key(&scene.digest, &prompt, u64::from(route.start)),
            prompt,
            model,
            course,
            camera: world.camera(scene, &route.look),
            map: StaticMap::new(&scene.map),
            bare: None,
            crosswalks: Crosswalks::new(&scene.map)?,
            renderer: Renderer::new(LayoutBackend::Cpu)?,
        })
    }

    /// Returns the scene.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        self.course.scene()
    }

    /// Returns the world that a frame shows.
    #[must_use]
    pub fn world(&self, frame: u32) -> WorldState {
        self.course.world(frame)
    }

    /// Renders the layout of a frame, with its geometry.
    ///
    /// # Errors
    /// If the size is refused.
    pub fn layout(&mut self, frame: u32) -> Result<Layout, EvaluationError> {
        self.layout_of(&self.world(frame))
    }

    /// Renders the layout of a frame without what stands beside the road.
    ///
    /// # Errors
    /// If the size is refused.
    pub fn bare_layout(&mut self, frame: u32) -> Result<Layout, EvaluationError> {
        let world = self.world(frame);
        let map = self.bare.get_or_insert_with(|| StaticMap::bare(&self.course.scene().map));
        from_ego(&mut self.renderer, &LayoutScene { map, world: &world }, &self.model)
    }

    /// Renders the layout of any state of the world, seen from its ego.
    ///
    /// # Errors
    /// If the size is refused.
    pub fn layout_of(&mut self, world: &WorldState) -> Result<Layout, EvaluationError> {
        from_ego(&mut self.renderer, &LayoutScene { map: &self.map, world }, &self.model)
    }

    /// Returns how far away each pixel of a frame is, by what its layout shows.
    ///
    /// # Errors
    /// If the size is refused.
    pub fn geometry(&mut self, frame: u32) -> Result<Geometry, EvaluationError> {
        let world = self.world(frame);
        let scene = LayoutScene { map: &self.map, world: &world };
        Ok(self.renderer.geometry(&scene, &self.model, world.ego.pose.world_from_rig(0.0))?)
    }

    /// Renders the world's own frame.
    ///
    /// # Errors
    /// If the size is refused.
    pub fn frame(&self, frame: u32) -> Result<RgbImage, EvaluationError> {
        self.frame_of(&self.world(frame))
    }

    /// Renders what the world's camera sees of any state of the world, from its ego.
    ///
    /// # Errors
    /// If the size is refused.
    pub fn frame_of(&self, world: &WorldState) -> Result<RgbImage, EvaluationError> {
        Ok(self.camera.on_ego(world, &self.model)?)
    }

    /// Returns what each pixel of the world's own frame shows.
    ///
    /// # Errors
    /// If the size is refused.
    pub fn labels(&mut self, frame: u32) -> Result<Vec<Label>, EvaluationError> {
        let world = self.world(frame);
        let rig = world.ego.pose.world_from_rig(0.0);
        let classes = self.camera.classes(&world, &self.model, rig)?;
        Ok(self.crosswalks.label(&classes, &world, &self.model, rig)?)
    }

    /// Lists the traffic lights of a frame whose labels are given.
    #[must_use]
    pub fn lights(&self, frame: u32, labels: &[Label]) -> Vec<SeenLight> {
        let world = self.world(frame);
        let rig = world.ego.pose.world_from_rig(0.0);
        lights::seen(&self.course.scene().map.traffic_lights, &world, labels, &self.model, rig)
    }
}

fn from_ego(renderer: &mut Renderer, scene: &LayoutScene, camera: &CameraModel) -> Result<Layout, EvaluationError> {
    let pose = scene.world.ego.pose.world_from_rig(0.0);
    let image = renderer.render(scene, camera, pose)?;
    let geometry = carriable(renderer.geometry(scene, camera, pose)?, &image);
    Ok(Layout { image, geometry: Some(Arc::new(geometry)) })
}
