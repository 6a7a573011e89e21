//! Where the scenarios of a set come from: scenario files → entries, entries → scenario files.
//!
//! The scenarios of `town` are functions of family and seed, which their names tell: such a set ships as its manifest
//! alone, and every file is made again and compared by digest.

use std::path::{Path, PathBuf};

use ds_scenario::{Family, ScenarioError};
use ds_world::Scene;

use crate::manifest::Entry;

/// Length of a tick, in seconds.
pub const DT_SECS: f64 = 0.1;
/// Ticks driven by the log before the policy takes over.
pub const HAND_OVER: u32 = 20;
/// Ticks that are scored.
pub const SCORED: u32 = 80;
/// The source of a set whose scenarios are made from their names.
pub const TOWN: &str = "town";
/// The source of a set of files.
pub const FILES: &str = "files";

/// The thirteen conditions: one thing changed of a clear, dry day.
pub const CONDITIONS: [(&str, &[&str]); 3] = [
    ("lighting", &["sunrise", "sunset", "twilight", "golden_hour", "blue_hour", "night"]),
    ("weather", &["overcast", "snow", "rain", "fog"]),
    ("surface", &["snow_covered", "sand_covered", "puddles"]),
];

/// Why a scenario of a set is not to be had.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// The file is refused.
    #[error("entry {entry:?}")]
    Scenario {
        /// The entry.
        entry: String,
        /// Why.
        source: ScenarioError,
    },
    /// The name tells no family and seed.
    #[error("entry {entry:?} names no file, and its scenario {scenario:?} is none of the generator's (FAMILY-SEED)")]
    NoFile {
        /// The entry.
        entry: String,
        /// Its scenario.
        scenario: String,
    },
    /// The scenario is another one.
    #[error("entry {entry:?}: scenario {from} has digest {found}, the manifest says {said}")]
    Digest {
        /// The entry.
        entry: String,
        /// The file, or the generator.
        from: String,
        /// The scenario's digest.
        found: String,
        /// The manifest's.
        said: String,
    },
}

/// Why a scenario cannot be an entry.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Unfit {
    /// It ends before the policy takes over.
    #[error("it ends before the hand-over at tick {HAND_OVER}")]
    TooShort,
    /// Its ticks are not [`DT_SECS`] apart.
    #[error("its ticks are not {DT_SECS} s apart")]
    TimeStep,
}

impl Unfit {
    /// Returns the reason's name in a recipe.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::TooShort => "too_short",
            Self::TimeStep => "time_step",
        }
    }
}

impl Entry {
    /// Returns the entry of a scene, its log being its recording.
    ///
    /// # Errors
    /// [`Unfit`] if it cannot be driven after the hand-over, or not by ticks of [`DT_SECS`].
    pub fn of(scene: &Scene, file: Option<PathBuf>) -> Result<Self, Unfit> {
        let last = scene.last_tick().0.min(HAND_OVER + SCORED);
        if last <= HAND_OVER {
            return Err(Unfit::TooShort);
        }
        if (scene.dt.secs() - DT_SECS).abs() > 1e-9 {
            return Err(Unfit::TimeStep);
        }
        Ok(Self {
            name: scene.name.clone(),
            file,
            scenario: scene.name.clone(),
            scenario_digest: scene.digest.to_string(),
            appearance: "day".to_owned(),
            log: scene.recording().to_owned(),
            category: scene.family.clone(),
            licence: scene.origin.licence.clone(),
            attribution: scene.origin.attribution.clone(),
            hand_over: HAND_OVER,
            last,
            ..Self::default()
        })
    }

    /// Returns the entries of this one under the thirteen conditions.
    #[must_use]
    pub fn under_conditions(&self) -> Vec<Self> {
        let conditions = CONDITIONS.iter().flat_map(|(_, names)| names.iter());
        let changed = |condition: &&str| Self {
            name: format!("{}__{condition}", self.name),
            base: Some(self.name.clone()),
            appearance: (*condition).to_owned(),
            category: (*condition).to_owned(),
            ..self.clone()
        };
        conditions.map(changed).collect()
    }

    /// Returns the scenario: of its file, for a manifest in `folder`, or generated from its name.
    ///
    /// # Errors
    /// [`SourceError`] if it is not to be had, or is another scenario.
    pub fn scene(&self, folder: &Path) -> Result<Scene, SourceError> {
        let none = || SourceError::NoFile { entry: self.name.clone(), scenario: self.scenario.clone() };
        let (scene, from) = match &self.file {
            Some(file) => (self.load(&folder.join(file))?, folder.join(file).display().to_string()),
            None => (generated(&self.scenario).ok_or_else(none)?, "of the generator".to_owned()),
        };
        let (found, said) = (scene.digest.to_string(), self.scenario_digest.clone());
        if found == said { Ok(scene) } else { Err(SourceError::Digest { entry: self.name.clone(), from, found, said }) }
    }

    /// Returns the scenario's file, for a manifest in `folder`; it is made in `made` where the entry names none.
    ///
    /// # Errors
    /// [`SourceError`] if it is not to be had, or is another scenario.
    pub fn scenario_file(&self, folder: &Path, made: &Path) -> Result<PathBuf, SourceError> {
        if let Some(file) = &self.file {
            self.scene(folder)?;
            return Ok(folder.join(file));
        }
        let path = made.join(format!("{}{}", self.scenario, ds_scenario::store::SUFFIX));
        let sound =
            || path.exists() && self.load(&path).is_ok_and(|scene| scene.digest.to_string() == self.scenario_digest);
        if !sound() {
            ds_scenario::save(&self.scene(folder)?, &path).map_err(|source| self.refused(source))?;
        }
        Ok(path)
    }

    fn load(&self, path: &Path) -> Result<Scene, SourceError> {
        Ok(ds_scenario::load(path).map_err(|source| self.refused(source))?.0)
    }

    fn refused(&self, source: ScenarioError) -> SourceError {
        SourceError::Scenario { entry: self.name.clone(), source }
    }
}

/// Generates the scenario of a name, `FAMILY-SEED`.
fn generated(name: &str) -> Option<Scene> {
    let (family, seed) = name.rsplit_once('-')?;
    Some(ds_scenario::generate(family.parse::<Family>().ok()?, seed.parse().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_generated_scenario_is_made_again_from_its_name() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let scene = ds_scenario::generate(Family::CutIn, 7);
        let slow = Scene { dt: ds_space::SimTime(200_000_000), ..scene.clone() };
        assert_eq!(Entry::of(&slow, None), Err(Unfit::TimeStep));
        let entry = Entry::of(&scene, None).expect("15 s");
        assert_eq!((entry.hand_over, entry.last, entry.log.as_str()), (20, 100, "cut-in-7"));
        for _ in 0..2 {
            let path = entry.scenario_file(folder.path(), folder.path()).expect("made");
            assert_eq!(ds_scenario::load(&path).expect("sound").0.digest, scene.digest);
        }
        let other = Entry { scenario: "cut-in-8".to_owned(), ..entry.clone() };
        let error = other.scenario_file(folder.path(), folder.path()).expect_err("another").to_string();
        assert!(error.contains("cut-in-7") && error.contains(&entry.scenario_digest), "{error}");
        let nothing = Entry { scenario: "elsewhere".to_owned(), ..entry.clone() };
        assert!(matches!(nothing.scenario_file(folder.path(), folder.path()), Err(SourceError::NoFile { .. })));
        let lost = Entry { file: Some("lost.scenario.json".into()), ..entry };
        let error = lost.scenario_file(folder.path(), folder.path()).expect_err("no file");
        assert!(std::error::Error::source(&error).is_some_and(|why| why.to_string().contains("lost.scenario.json")));
    }

    #[test]
    fn scenarios_of_one_recording_have_one_log() {
        let named = |name: &str| Scene { name: name.to_owned(), ..ds_scenario::generate(Family::CutIn, 7) };
        for (name, log) in [
            ("USA_Peach-4_1_T-1-ego427", "USA_Peach-4_1_T-1"),
            ("USA_Peach-4_1_T-1", "USA_Peach-4_1_T-1"),
            ("two-egos", "two-egos"),
            ("two-ego", "two-ego"),
        ] {
            assert_eq!(Entry::of(&named(name), None).expect("15 s").log, log);
        }
    }

    #[test]
    fn there_are_thirteen_conditions() {
        let entry = Entry::of(&ds_scenario::generate(Family::CutIn, 7), None).expect("15 s");
        let entries = entry.under_conditions();
        assert_eq!(entries.len(), 13);
        assert!(entries.iter().all(|e| e.base.as_deref() == Some("cut-in-7") && e.name.starts_with("cut-in-7__")));
        for (axis, names) in CONDITIONS {
            for name in names {
                let words = format!("{axis}={name}");
                let condition: Result<ds_world::Condition, _> = words.parse();
                assert!(condition.is_ok(), "{words} is no condition");
            }
        }
    }
}
