//! Makes planned clips: generates the scenario, drives through it, renders frames, layouts and classes.

use std::cell::OnceCell;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ds_import::{Recorded, nuscenes, openscene};
use ds_layout::{LayoutBackend, LayoutScene, Renderer, StaticMap, carriable};
use ds_raster::{ImageError, RgbImage};
use ds_scenario::{Facts, Warning};
use ds_space::{CameraModel, PoseSe2};
use ds_world::{Scene, WorldState};

use crate::clip::Clip;
use crate::drive::Drive;
use crate::error::ClipsError;
use crate::hook::{self, Brief};
use crate::index::{CameraInfo, ClipInfo, ConditionInfo};
use crate::network::network_id;
use crate::plan::{PlannedClip, ScenarioKey};
use crate::recipe::{Recipe, Source};

/// Returns the scenario of a key.
///
/// # Errors
/// If its file is refused.
pub fn scene_of(key: &ScenarioKey) -> Result<Scene, ClipsError> {
    match key {
        ScenarioKey::Generated { family, seed } => Ok(ds_scenario::generate(*family, *seed)),
        ScenarioKey::SecondWorld { seed } => Ok(ds_second_camera::roads::scene(*seed)),
        ScenarioKey::File(path) => Ok(ds_import::open(path)?.0),
        ScenarioKey::Photographed { .. } => Ok(recorded(key)?.scene),
    }
}

fn recorded(key: &ScenarioKey) -> Result<Recorded, ClipsError> {
    match key {
        ScenarioKey::Photographed { source: Source::Nuscenes, root, drive, .. } => Ok(nuscenes::read(root, drive)?),
        ScenarioKey::Photographed { root, drive, maps, .. } => {
            Ok(openscene::read(root, Path::new(drive), maps.as_deref())?)
        }
        _ => Ok(Recorded { scene: scene_of(key)?, pictures: Vec::new(), warnings: Vec::new() }),
    }
}

/// A scenario made ready for its clips.
pub(crate) struct Studio<'a> {
    recipe: &'a Recipe,
    scene: Scene,
    network: String,
    map: StaticMap,
    /// The same without what stands beside the road, made for the first clip that asks for it.
    bare: OnceCell<StaticMap>,
    camera: CameraModel,
    /// Of a photographed drive, the pictures of the camera, one a tick.
    photos: Vec<Option<PathBuf>>,
    /// What is odd about a photographed drive.
    warnings: Vec<Warning>,
}

impl<'a> Studio<'a> {
    pub(crate) fn new(recipe: &'a Recipe, size: (u32, u32), key: &ScenarioKey) -> Result<Self, ClipsError> {
        let Recorded { scene, mut pictures, warnings } = recorded(key)?;
        let wanted = recipe.scenarios.camera.as_deref();
        let at = scene.cameras.iter().position(|camera| wanted.is_none_or(|name| camera.id.as_str() == name));
        let Some(at) = at else {
            let rule = format!("{} has no camera {:?}", scene.name, wanted.unwrap_or("at all"));
            return Err(ClipsError::Recipe { field: "scenarios.camera", rule });
        };
        let camera = recipe.source.world().rig(&resized(&scene.cameras[at], size.0, size.1));
        let photos = if at < pictures.len() { pictures.swap_remove(at) } else { Vec::new() };
        let map = StaticMap::new(&scene.map);
        let network = network_id(&scene.map);
        Ok(Self { recipe, network, map, bare: OnceCell::new(), camera, scene, photos, warnings })
    }

    /// Returns what is odd about the drive, a line each.
    pub(crate) fn notes(&self) -> impl Iterator<Item = String> {
        self.warnings.iter().map(|warning| format!("{}: {warning}", self.scene.name))
    }

    /// Makes one clip with where the ego is at each tick and what is told of it.
    pub(crate) fn make(&self, planned: &PlannedClip) -> Result<(Clip, Vec<PoseSe2>, ClipInfo), ClipsError> {
        let ticks = self.recipe.frames;
        let drive = self.drive(planned)?;
        let frames = if planned.edited.is_some() { 1 } else { ticks };
        let worlds: Vec<WorldState> = (0..ticks).map(|frame| drive.world(&self.scene, frame)).collect();
        let mut clip = Clip::default();
        self.lay_out(&worlds, planned, &mut clip)?;
        if self.recipe.source.is_photographed() {
            clip.frames = worlds.iter().map(|world| self.photo(world, planned.index)).collect::<Result<_, _>>()?;
        } else {
            self.shoot(planned, &worlds[..frames], &mut clip).map_err(unseen(planned.index))?;
        }
        // What a photograph looks like is not ours to choose; the log's own words tell it.
        let photographed = self.recipe.source.is_photographed();
        let look = if photographed { self.scene.prompt.clone() } else { planned.appearance.prompt() };
        let facts = Facts::of(&self.scene, &worlds[0], &worlds[ticks - 1], look);
        clip.prompt = ds_scenario::prompt(&facts);
        self.let_others_work(planned, &worlds[0], &facts, &mut clip)?;
        let (seed, file) = match &planned.scenario {
            ScenarioKey::Generated { seed, .. } | ScenarioKey::SecondWorld { seed } => (Some(*seed), None),
            ScenarioKey::File(path) => (None, Some(path.clone())),
            ScenarioKey::Photographed { root, .. } => (None, Some(root.clone())),
        };
        let info = ClipInfo {
            index: planned.index,
            scenario: self.scene.name.clone(),
            family: self.scene.family.clone(),
            seed,
            file,
            scenario_digest: self.scene.digest.to_string(),
            network: self.network.clone(),
            split: self.recipe.split,
            appearance: planned.look.clone(),
            condition: ConditionInfo::of(&planned.appearance),
            prompt: clip.prompt.clone(),
            facts,
            camera: CameraInfo::of(&self.camera),
            drive: drive.into(),
            ticks,
            frames,
            classes: self.recipe.classes,
            edited: planned.edited.as_ref().map(|original| original.index),
        };
        Ok((clip, worlds.iter().map(|world| world.ego.pose).collect(), info))
    }

    fn drive(&self, planned: &PlannedClip) -> Result<Drive, ClipsError> {
        let ticks = self.recipe.frames;
        if planned.stray {
            return Ok(Drive::stray(&self.scene, ticks, &planned.draws));
        }
        if !self.recipe.source.is_photographed() {
            return Ok(Drive::on_log(&self.scene, ticks));
        }
        // Photographs cannot be stretched: the clips of a drive follow one another.
        let first = planned.part * ticks as u64;
        if first + ticks as u64 > u64::from(self.scene.last_tick().0) + 1 {
            let reason = format!("the drive {} has {} ticks", self.scene.name, self.scene.last_tick().0 + 1);
            return Err(ClipsError::Clip { index: planned.index, reason });
        }
        Ok(Drive { from_tick: first as f64, world_rate: 1.0, ego_rate: 1.0, offset_m: 0.0, heading_rad: 0.0 })
    }

    /// Renders frames and classes.
    fn shoot(&self, planned: &PlannedClip, worlds: &[WorldState], clip: &mut Clip) -> Result<(), ImageError> {
        let camera = self.recipe.source.world().camera(&self.scene, &planned.appearance);
        for world in worlds {
            clip.frames.push(camera.on_ego(world, &self.camera)?);
            if self.recipe.classes {
                let pose = world.ego.pose.world_from_rig(0.0);
                let classes = camera.classes(world, &self.camera, pose)?;
                clip.classes.push(classes.into_iter().map(|class| class as u8).collect());
            }
        }
        Ok(())
    }

    /// Reads the photograph of a tick at the size of the set.
    fn photo(&self, world: &WorldState, index: u64) -> Result<RgbImage, ClipsError> {
        let tick = world.tick.0 as usize;
        let refuse = |reason: String| ClipsError::Clip { index, reason };
        let path = self.photos.get(tick).and_then(Option::as_ref);
        let path = path.ok_or_else(|| refuse(format!("{} has no picture of tick {tick}", self.scene.name)))?;
        let bytes = std::fs::read(path).map_err(ClipsError::io("photograph", path))?;
        let photo = RgbImage::photo(&bytes).map_err(|error| refuse(format!("{error} ({})", path.display())))?;
        Ok(photo.reduced(self.camera.intrinsics.width_px, self.camera.intrinsics.height_px))
    }

    /// Renders layouts and their geometry.
    fn lay_out(&self, worlds: &[WorldState], planned: &PlannedClip, clip: &mut Clip) -> Result<(), ClipsError> {
        let index = planned.index;
        let refuse = |error: ds_layout::LayoutError| ClipsError::Clip { index, reason: error.to_string() };
        let bare = || self.bare.get_or_init(|| StaticMap::bare(&self.scene.map));
        let map = if planned.bare { bare() } else { &self.map };
        let mut renderer = Renderer::new(LayoutBackend::Cpu).map_err(refuse)?;
        for world in worlds {
            let (scene, pose) = (LayoutScene { map, world }, world.ego.pose.world_from_rig(0.0));
            let layout = renderer.render(&scene, &self.camera, pose).map_err(refuse)?;
            let geometry = renderer.geometry(&scene, &self.camera, pose).map_err(refuse)?;
            clip.geometry.push(Arc::new(carriable(geometry, &layout)));
            clip.layouts.push(layout);
        }
        Ok(())
    }

    /// Hands the first frame to an external editor and captioner where the recipe names them.
    fn let_others_work(
        &self,
        planned: &PlannedClip,
        first: &WorldState,
        facts: &Facts,
        clip: &mut Clip,
    ) -> Result<(), ClipsError> {
        let look = ConditionInfo::of(&planned.appearance);
        let template = clip.prompt.clone();
        let brief = Brief {
            scenario: &self.scene.name,
            lighting: &look.lighting,
            weather: &look.weather,
            surface: &look.surface,
            prompt: &template,
            facts,
        };
        let editor = self.recipe.edit.as_ref().and_then(|edit| edit.editor.as_ref());
        if let Some((editor, original)) = editor.zip(planned.edited.as_ref()) {
            let camera = self.recipe.source.world().camera(&self.scene, &original.appearance);
            clip.frames[0] =
                hook::edit(editor, &camera.on_ego(first, &self.camera).map_err(unseen(planned.index))?, &brief)?;
        }
        if let Some(captioner) = &self.recipe.captioner {
            clip.prompt = hook::caption(captioner, &clip.frames[0], &brief)?;
        }
        Ok(())
    }
}

fn resized(camera: &CameraModel, width_px: u32, height_px: u32) -> CameraModel {
    CameraModel { intrinsics: camera.intrinsics.resized(width_px, height_px), ..camera.clone() }
}

/// Says which clip has a frame that cannot be rendered.
fn unseen(index: u64) -> impl Fn(ImageError) -> ClipsError {
    move |error| ClipsError::Clip { index, reason: error.to_string() }
}
