//! The columns of every table: generated scenarios in the camera world of training (A), another world with roads and
//! camera of its own (B), and recorded logs (real), the last two never seen by any training.

use std::sync::Arc;

use ds_camera::{Appearance, CameraWorld, Condition, Lighting, RoadSurface, Weather};
use ds_scenario::Family;
use ds_space::Draws;
use ds_world::Scene;

use crate::Progress;
use crate::config::EvalConfig;
use crate::drive::Route;
use crate::error::EvaluationError;

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
    /// How far the camera is turned to the left, in degrees.
    pub turned_deg: f64,
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
    ) -> Result<Vec<Self>, EvaluationError> {
        let mut columns = Vec::new();
        let turned_deg = config.columns.turned_deg;
        for world in worlds {
            let (scenes, scenarios) = (generated(config, *world)?, config.columns.scenarios as usize);
            columns.push(Self { name: world.name().to_owned(), world: *world, scenes, scenarios, turned_deg });
        }
        if let (Some(world), false) = (worlds.first(), config.columns.real.is_empty()) {
            let scenes = logged(config, progress)?;
            if !scenes.is_empty() {
                let scenarios = scenes.len();
                columns.push(Self { name: "real".to_owned(), world: *world, scenes, scenarios, turned_deg });
            }
        }
        Ok(columns)
    }

    /// Returns the drives of the first scenarios that start at given ticks.
    #[must_use]
    pub fn routes(&self, scenarios: usize, starts: &[u32], pace: f64) -> Vec<Vec<Route>> {
        let route = |(scene, look): &(Arc<Scene>, Appearance)| {
            let at = |start: &u32| Route {
                scene: Arc::clone(scene),
                start: *start,
                pace,
                look: *look,
                turned_deg: self.turned_deg,
            };
            starts.iter().map(at).collect()
        };
        self.scenes.iter().take(scenarios).map(route).collect()
    }
}

/// Generates as many scenarios as any table asks for.
fn generated(config: &EvalConfig, world: &dyn CameraWorld) -> Result<Vec<(Arc<Scene>, Appearance)>, EvaluationError> {
    let columns = &config.columns;
    let rollouts = [
        config.sharpness.as_ref().map(|sharpness| sharpness.rollouts),
        config.drift.as_ref().map(|drift| drift.rollouts),
        config.appearance.as_ref().map(|appearance| appearance.rollouts),
        config.first_frames.as_ref().map(|first_frames| first_frames.scenarios),
    ];
    let count = rollouts.into_iter().flatten().fold(columns.scenarios, u64::max);
    let scene = |index: u64| {
        let scene = scenario(world, columns.first_seed, index);
        Ok((Arc::new(scene), look(&columns.look, columns.first_seed + index)?))
    };
    (0..count).map(scene).collect()
}

/// Returns a scenario of a world, counted from a first seed; families take turns where it has no roads of its own.
pub(crate) fn scenario(world: &dyn CameraWorld, first_seed: u64, index: u64) -> Scene {
    world.own_scenario(first_seed + index).unwrap_or_else(|| {
        let count = Family::ALL.len() as u64;
        ds_scenario::generate(Family::ALL[(index % count) as usize], first_seed + index / count)
    })
}

/// Returns the look of a generated scenario.
pub(crate) fn look(name: &str, seed: u64) -> Result<Appearance, EvaluationError> {
    let refuse = |error: String| EvaluationError::config("columns.look", error);
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
fn logged(config: &EvalConfig, progress: &mut dyn Progress) -> Result<Vec<(Arc<Scene>, Appearance)>, EvaluationError> {
    let mut scenes = Vec::new();
    for path in &config.columns.real {
        let path = config.path(path);
        if !path.exists() {
            progress.note(&format!("no logs at {}: the column real goes without them", path.display()));
            continue;
        }
        for file in ds_import::files(&path).map_err(EvaluationError::io("folder of logs", &path))? {
            let refuse = |error| EvaluationError::config("columns.real", format!("{}: {error}", file.display()));
            let (scene, _) = ds_import::open(&file).map_err(|error| refuse(error.to_string()))?;
            scenes.push((Arc::new(scene), Appearance::DAY));
        }
    }
    Ok(scenes)
}
