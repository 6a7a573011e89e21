//! The columns of every table: generated scenarios in the camera world of training (A), another world with roads and
//! camera of its own (B), and recorded logs (real), the last two never seen by any training.

use std::sync::Arc;

use ds_camera::{Appearance, Condition, Lighting, PixelClass, RoadSurface, Weather};
use ds_perception::world::{CameraWorld, SceneCamera};
use ds_raster::RgbImage;
use ds_second_camera::AbroadCamera;
use ds_space::{CameraModel, Draws, Pose, Rig, World};
use ds_world::{Scene, WorldState};

use crate::Progress;
use crate::config::EvalConfig;
use crate::drive::Route;
use crate::error::AppraisalError;

/// The second world, with its own roads and rig.
#[derive(Debug, Clone, Copy, Default)]
pub struct WorldB;

struct Abroad(AbroadCamera);

impl CameraWorld for WorldB {
    fn name(&self) -> &'static str {
        "B"
    }

    fn rig(&self, model: &CameraModel) -> CameraModel {
        AbroadCamera::rig(model)
    }

    fn scenario(&self, first_seed: u64, index: u64) -> Scene {
        ds_second_camera::roads::scene(first_seed + index)
    }

    fn camera(&self, scene: &Scene, look: &Appearance) -> Box<dyn SceneCamera> {
        Box::new(Abroad(AbroadCamera::new(scene, look.condition.unwrap_or(Condition::DAY), look.palette_seed)))
    }
}

impl SceneCamera for Abroad {
    fn render(&self, world: &WorldState, model: &CameraModel, world_from_rig: Pose<World, Rig>) -> RgbImage {
        self.0.render(world, model, world_from_rig)
    }

    fn classes(&self, world: &WorldState, model: &CameraModel, world_from_rig: Pose<World, Rig>) -> Vec<PixelClass> {
        self.0.classes(world, model, world_from_rig)
    }
}

/// Scenarios seen by a camera world.
pub struct Column<'a> {
    /// Name in tables.
    pub name: String,
    /// The world.
    pub world: &'a dyn CameraWorld,
    /// The scenarios with their looks.
    pub scenes: Vec<(Arc<Scene>, Appearance)>,
    /// How many of them, from the first, all tables use that name no number of rollouts.
    pub scenarios: usize,
}

impl<'a> Column<'a> {
    /// Makes the columns of an evaluation: generated scenarios in each world, logs in the first.
    ///
    /// # Errors
    /// If a look is unknown or a log that exists cannot be read.
    pub fn all(
        config: &EvalConfig,
        worlds: &[&'a dyn CameraWorld],
        progress: &mut dyn Progress,
    ) -> Result<Vec<Self>, AppraisalError> {
        let mut columns = Vec::new();
        for world in worlds {
            let (scenes, scenarios) = (generated(config, *world)?, config.columns.scenarios as usize);
            columns.push(Self { name: world.name().to_owned(), world: *world, scenes, scenarios });
        }
        if let (Some(world), false) = (worlds.first(), config.columns.real.is_empty()) {
            let scenes = logged(config, progress)?;
            if !scenes.is_empty() {
                let scenarios = scenes.len();
                columns.push(Self { name: "real".to_owned(), world: *world, scenes, scenarios });
            }
        }
        Ok(columns)
    }

    /// Returns the drives of the first scenarios that start at given ticks.
    #[must_use]
    pub fn routes(&self, scenarios: usize, starts: &[u32], pace: f64) -> Vec<Vec<Route>> {
        let route = |(scene, look): &(Arc<Scene>, Appearance)| {
            let at = |start: &u32| Route { scene: Arc::clone(scene), start: *start, pace, look: *look };
            starts.iter().map(at).collect()
        };
        self.scenes.iter().take(scenarios).map(route).collect()
    }
}

/// Generates as many scenarios as any table asks for.
fn generated(config: &EvalConfig, world: &dyn CameraWorld) -> Result<Vec<(Arc<Scene>, Appearance)>, AppraisalError> {
    let columns = &config.columns;
    let rollouts = [
        config.drift.as_ref().map(|drift| drift.rollouts),
        config.appearance.as_ref().map(|appearance| appearance.rollouts),
    ];
    let count = rollouts.into_iter().flatten().fold(columns.scenarios, u64::max);
    let scene = |index: u64| {
        let scene = world.scenario(columns.first_seed, index);
        Ok((Arc::new(scene), look(&columns.look, columns.first_seed + index)?))
    };
    (0..count).map(scene).collect()
}

/// Returns the look of a generated scenario.
fn look(name: &str, seed: u64) -> Result<Appearance, AppraisalError> {
    let refuse = |error: String| AppraisalError::config("columns.look", error);
    match name {
        "drawn" => {
            let all: Vec<Condition> = Condition::all().collect();
            let drawn = Draws::from_seed(seed, "measured look").below(0, all.len() as u64) as usize;
            Ok(Appearance::condition(all[drawn], seed))
        }
        "daylight" => {
            let weather = if seed.is_multiple_of(2) { Weather::Clear } else { Weather::Overcast };
            let condition = Condition::new(Lighting::Day, weather, RoadSurface::Dry);
            Ok(Appearance::condition(condition.map_err(|error| refuse(error.to_string()))?, seed))
        }
        name => Appearance::named(name).map_err(|error| refuse(error.to_string())),
    }
}

/// Reads logs and scenario files; paths that do not exist are skipped with a note.
fn logged(config: &EvalConfig, progress: &mut dyn Progress) -> Result<Vec<(Arc<Scene>, Appearance)>, AppraisalError> {
    let mut scenes = Vec::new();
    for path in &config.columns.real {
        let path = config.path(path);
        if !path.exists() {
            progress.note(&format!("no logs at {}: the column real goes without them", path.display()));
            continue;
        }
        for file in ds_import::files(&path).map_err(AppraisalError::io("folder of logs", &path))? {
            let refuse = |error| AppraisalError::config("columns.real", format!("{}: {error}", file.display()));
            let (scene, _) = ds_import::open(&file).map_err(|error| refuse(error.to_string()))?;
            scenes.push((Arc::new(scene), Appearance::DAY));
        }
    }
    Ok(scenes)
}
