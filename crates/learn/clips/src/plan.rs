//! From a recipe to its clips: which scenario, condition and drive each index has. No pictures yet.
//!
//! Conditions take turns in a drawn order, so that every condition of the recipe has as many clips as any other
//! (give or take one); all draws are keyed by the recipe's seed, its name and the clip's index.

use std::path::{Path, PathBuf};

use ds_camera::{Appearance, Condition};
use ds_scenario::Family;
use ds_space::{DigestWriter, Draws};

use crate::error::ClipsError;
use crate::recipe::{Generator, Recipe, Source};

/// Where a scenario comes from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ScenarioKey {
    /// The generator.
    Generated {
        /// The family.
        family: Family,
        /// The seed.
        seed: u64,
    },
    /// The generator of the second world.
    SecondWorld {
        /// The seed.
        seed: u64,
    },
    /// A scenario file or a log.
    File(PathBuf),
    /// A photographed drive of a data set: its root and the drive's name or log file.
    Photographed {
        /// The folder layout.
        source: Source,
        /// The data set.
        root: PathBuf,
        /// Scene name, or path of the log.
        drive: String,
        /// The folder of nuPlan's maps, where the recipe names one.
        maps: Option<PathBuf>,
    },
}

/// Which of a clip's draws says whether it is a bare one; [`crate::drive`] takes those before.
const BARE: u64 = 8;

/// One clip to make.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedClip {
    /// Its index in the set.
    pub index: u64,
    /// Its scenario.
    pub scenario: ScenarioKey,
    /// Its look.
    pub appearance: Appearance,
    /// The name of the look.
    pub look: String,
    /// What keys the ego's drive.
    pub draws: Draws,
    /// Whether the ego strays from its log.
    pub stray: bool,
    /// Whether its layouts leave out what stands beside the road.
    pub bare: bool,
    /// Which of the clips of its scenario it is.
    pub part: u64,
    /// The clip of the edited recipe whose first frame is edited.
    pub edited: Option<Box<PlannedClip>>,
}

/// All clips of a recipe.
#[derive(Debug, Clone)]
pub struct ClipPlan {
    recipe: Recipe,
    conditions: Vec<Condition>,
    files: Vec<ScenarioKey>,
    edited: Option<Box<ClipPlan>>,
}

impl ClipPlan {
    /// Lays a recipe out.
    ///
    /// # Errors
    /// If its conditions, files or edited recipe are refused.
    pub fn new(recipe: &Recipe) -> Result<Self, ClipsError> {
        let edited = match recipe.edited()? {
            Some(edited) if edited.edit.is_some() => {
                let rule = format!("{:?} is itself a recipe of edits", edited.name);
                return Err(ClipsError::Recipe { field: "edit.of", rule });
            }
            Some(edited) if edited.frames != recipe.frames => {
                let rule = format!("must be the {} of the edited recipe", edited.frames);
                return Err(ClipsError::Recipe { field: "frames", rule });
            }
            Some(edited) => Some(Box::new(Self::new(&edited)?)),
            None => None,
        };
        let mut files = Vec::new();
        for path in &recipe.scenarios.files {
            files.extend(keys(recipe, &recipe.base.join(path))?);
        }
        if files.is_empty() && !recipe.scenarios.files.is_empty() {
            let rule = "hold no scenario file (*.scenario.json)".to_owned();
            return Err(ClipsError::Recipe { field: "scenarios.files", rule });
        }
        Ok(Self { recipe: recipe.clone(), conditions: recipe.conditions()?, files, edited })
    }

    /// Returns the recipe.
    #[must_use]
    pub fn recipe(&self) -> &Recipe {
        &self.recipe
    }

    /// Returns the number of scenarios.
    #[must_use]
    pub fn scenarios(&self) -> u64 {
        if self.files.is_empty() { self.recipe.scenarios.count } else { self.files.len() as u64 }
    }

    /// Returns the number of clips.
    #[must_use]
    pub fn clips(&self) -> u64 {
        match &self.recipe.edit {
            Some(edit) => edit.clips,
            None => self.scenarios() * self.recipe.scenarios.clips_each,
        }
    }

    /// Returns the plan of a clip; the same index gives the same plan.
    #[must_use]
    pub fn clip(&self, index: u64) -> PlannedClip {
        let key = DigestWriter::new().text(&self.recipe.name).u64(self.recipe.seed).finish();
        let draws = Draws::new(&key, "clip", &[index]);
        let condition = self.condition(&key, index);
        // 20 bits keep names short.
        let number = draws.u64(0) >> 44;
        let mut appearance = Appearance::condition(condition, number);
        if !self.recipe.appearance.falls {
            appearance.fall = 0.0;
        }
        let look = format!("{condition}-{number}");
        let Some((edited, edit)) = self.edited.as_ref().zip(self.recipe.edit.as_ref()) else {
            let scenario = self.scenario(index / self.recipe.scenarios.clips_each);
            let part = index % self.recipe.scenarios.clips_each;
            return PlannedClip {
                index,
                scenario,
                appearance,
                look,
                draws,
                stray: self.recipe.stray,
                bare: draws.uniform(BARE) < self.recipe.bare,
                part,
                edited: None,
            };
        };
        let original = edited.clip((u128::from(index) * u128::from(edited.clips()) / u128::from(edit.clips)) as u64);
        PlannedClip {
            index,
            scenario: original.scenario.clone(),
            // The same street, cars and sun's bearing: only the condition changes.
            appearance: Appearance {
                palette_seed: original.appearance.palette_seed,
                sun_azimuth_rad: original.appearance.sun_azimuth_rad,
                ..appearance
            },
            look,
            draws: original.draws,
            stray: original.stray,
            bare: original.bare,
            part: original.part,
            edited: Some(Box::new(original)),
        }
    }

    /// Returns the scenario of an index: the eight families take turns.
    #[must_use]
    pub fn scenario(&self, index: u64) -> ScenarioKey {
        if let Some(path) = self.files.get(usize::try_from(index).unwrap_or(usize::MAX)) {
            return path.clone();
        }
        if self.recipe.scenarios.generator == Some(Generator::SecondWorld) {
            return ScenarioKey::SecondWorld { seed: self.recipe.scenarios.first_seed + index };
        }
        let families = Family::ALL.len() as u64;
        let family = Family::ALL[usize::try_from(index % families).unwrap_or(0)];
        ScenarioKey::Generated { family, seed: self.recipe.scenarios.first_seed + index / families }
    }

    /// Returns the condition of an index, from a deck of all that is shuffled anew each time it is used up.
    fn condition(&self, key: &ds_space::Digest, index: u64) -> Condition {
        let count = self.conditions.len() as u64;
        let draws = Draws::new(key, "deck", &[index / count]);
        let mut deck: Vec<(u64, Condition)> =
            (0..).zip(&self.conditions).map(|(i, condition)| (draws.u64(i), *condition)).collect();
        deck.sort_unstable();
        deck[usize::try_from(index % count).unwrap_or(0)].1
    }
}

/// Returns the scenarios of a path.
fn keys(recipe: &Recipe, path: &Path) -> Result<Vec<ScenarioKey>, ClipsError> {
    let maps = recipe.scenarios.maps.as_ref().map(|maps| recipe.base.join(maps));
    let photographed = |drive| {
        let (source, maps) = (recipe.source, maps.clone());
        ScenarioKey::Photographed { source, root: path.to_path_buf(), drive, maps }
    };
    match recipe.source {
        Source::Nuscenes => Ok(ds_import::nuscenes::scenes(path)?.into_iter().map(photographed).collect()),
        Source::Openscene => {
            let logs = ds_import::openscene::logs(path)?;
            Ok(logs.into_iter().map(|log| photographed(log.display().to_string())).collect())
        }
        _ => {
            let files = ds_import::files(path).map_err(ClipsError::io("scenario folder", path))?;
            Ok(files.into_iter().map(ScenarioKey::File).collect())
        }
    }
}
