//! Runs an evaluation: rolls out what is not stored yet, sums up, part by part.

mod appearance;
mod drift;
mod first_frames;
mod layout;
mod sharpness;
pub mod speed;

use std::collections::{BTreeMap, BTreeSet};

use ds_camera::CameraWorld;

use crate::Progress;
use crate::arm::Arm;
use crate::column::Column;
use crate::config::EvalConfig;
use crate::drive::{Drive, Route};
use crate::error::EvaluationError;
use crate::estimate::Resamples;
use crate::eyes::Eyes;
use crate::film;
use crate::outcome::{ArmNote, Outcome};
use crate::record::Record;
use crate::store::Store;
use crate::summary::Rollouts;
use crate::watch::{Viewing, watch};

/// A part of an evaluation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Part {
    /// Whether frames are as sharp as the world's own.
    Sharpness,
    /// Layout, fidelity, colour and seam figures.
    Layout,
    /// The drift curve and the long run.
    Drift,
    /// Whether a look is kept.
    Appearance,
    /// Whether first frames from layout and words show what the words say.
    FirstFrames,
    /// Speed.
    Speed,
    /// Side-by-side videos.
    Videos,
}

impl Part {
    /// All parts, in the order of the report.
    pub const ALL: [Self; 7] =
        [Self::Sharpness, Self::Layout, Self::Drift, Self::Appearance, Self::FirstFrames, Self::Speed, Self::Videos];

    /// Returns the name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Sharpness => "sharpness",
            Self::Layout => "layout",
            Self::Drift => "drift",
            Self::Appearance => "appearance",
            Self::FirstFrames => "first-frames",
            Self::Speed => "speed",
            Self::Videos => "videos",
        }
    }
}

/// Says how many seconds have passed since some moment; handed in, for nothing here reads a clock.
pub type Seconds<'a> = &'a dyn Fn() -> f64;

/// An evaluation under way.
pub struct Evaluation<'a> {
    pub(crate) config: &'a EvalConfig,
    pub(crate) eyes: Eyes,
    pub(crate) resamples: Resamples,
    columns: Vec<Column<'a>>,
    store: Store,
    arms: BTreeMap<String, Arm>,
    progress: &'a mut dyn Progress,
}

impl<'a> Evaluation<'a> {
    /// Loads perception networks and scenarios; the first world is that of training.
    ///
    /// # Errors
    /// If a file is broken.
    pub fn open(
        config: &'a EvalConfig,
        worlds: &[&'a dyn CameraWorld],
        progress: &'a mut dyn Progress,
    ) -> Result<Self, EvaluationError> {
        let eyes = Eyes::load(config)?;
        progress.note("scenarios are being made");
        let columns = Column::all(config, worlds, progress)?;
        let store = Store::open(&config.out.join("records"))?;
        let resamples = Resamples(config.resamples);
        Ok(Self { config, eyes, resamples, columns, store, arms: BTreeMap::new(), progress })
    }

    /// Measures parts anew in an outcome; the others keep what it holds. The same inputs give the same figures, speed
    /// apart.
    ///
    /// # Errors
    /// If an arm cannot be loaded, a rollout fails or a file cannot be used.
    pub fn measure(
        &mut self,
        outcome: &mut Outcome,
        parts: &BTreeSet<Part>,
        seconds: Seconds<'_>,
    ) -> Result<(), EvaluationError> {
        outcome.perception = self.eyes.digest().to_string();
        if let Some(config) = self.config.sharpness.as_ref().filter(|_| parts.contains(&Part::Sharpness)) {
            outcome.sharpness = Some(self.sharpness(config)?);
        }
        if let Some(config) = self.config.layout.as_ref().filter(|_| parts.contains(&Part::Layout)) {
            outcome.layout = Some(self.layout(config)?);
        }
        if let Some(config) = self.config.drift.as_ref().filter(|_| parts.contains(&Part::Drift)) {
            outcome.drift = Some(self.drift(config)?);
        }
        if let Some(config) = self.config.appearance.as_ref().filter(|_| parts.contains(&Part::Appearance)) {
            outcome.appearance = Some(self.appearance(config)?);
        }
        if let Some(config) = self.config.first_frames.as_ref().filter(|_| parts.contains(&Part::FirstFrames)) {
            outcome.first_frames = Some(self.first_frames(config)?);
        }
        if let Some(config) = self.config.speed.as_ref().filter(|_| parts.contains(&Part::Speed)) {
            outcome.speed = Some(speed::measure(self.config, config, self.resamples, seconds)?);
        }
        if parts.contains(&Part::Videos) {
            outcome.videos = self.videos()?;
        }
        for (name, arm) in &self.arms {
            let note = ArmNote {
                kind: format!("{:?}", arm.kind),
                digest: arm.digest().to_string(),
                remark: arm.remark.clone(),
            };
            outcome.arms.insert(name.clone(), note);
        }
        Ok(())
    }

    fn load(&mut self, name: &str) -> Result<(), EvaluationError> {
        if !self.arms.contains_key(name) {
            self.arms.insert(name.to_owned(), Arm::load(self.config, name)?);
        }
        Ok(())
    }

    /// Returns the arms that some tables name, without repetition.
    fn named<'b>(tables: impl IntoIterator<Item = &'b BTreeMap<String, String>>) -> BTreeSet<String> {
        tables.into_iter().flat_map(BTreeMap::values).cloned().collect()
    }

    /// Returns the size of frames: that of the first arm of some.
    fn size_px(&mut self, arms: &BTreeSet<String>) -> Result<(u32, u32), EvaluationError> {
        let Some(first) = arms.first() else {
            return Err(EvaluationError::config("arms", "a part that is measured names no arm"));
        };
        self.load(first)?;
        let size_px = self.arms[first].size_px();
        for name in arms {
            self.load(name)?;
            if self.arms[name].size_px() != size_px {
                let rule = format!("{name:?} and {first:?} make frames of different sizes");
                return Err(EvaluationError::config("arms", rule));
            }
        }
        Ok(size_px)
    }

    /// Watches an arm, or the world's own frames, on routes grouped by scenario.
    fn rollouts(
        &mut self,
        arm: Option<&str>,
        column: usize,
        routes: &[Vec<Route>],
        viewing: Viewing<'_>,
    ) -> Result<Rollouts, EvaluationError> {
        if let Some(name) = arm {
            self.load(name)?;
        }
        self.progress.ahead(routes.iter().map(Vec::len).sum::<usize>() as u64);
        let mut rollouts = Rollouts::default();
        for scenario in routes {
            let records: Vec<Record> =
                scenario.iter().map(|route| self.record(arm, column, route, viewing)).collect::<Result<_, _>>()?;
            rollouts.0.push(records);
        }
        Ok(rollouts)
    }

    fn record(
        &mut self,
        arm: Option<&str>,
        column: usize,
        route: &Route,
        viewing: Viewing<'_>,
    ) -> Result<Record, EvaluationError> {
        let arm = arm.map(|name| &self.arms[name]);
        let column = &self.columns[column];
        let key = viewing.key(arm, column.world.name(), route, &self.eyes);
        let what = format!("{} on {} of {}", arm.map_or("the world", |arm| &arm.name), route.scene.name, column.name);
        if let Some(record) = self.store.get(&key)? {
            self.progress.done(&what, true);
            return Ok(record);
        }
        let mut drive = Drive::new(column.world, route, viewing.size_px)?;
        let record = watch(arm, &mut drive, viewing.plan, &self.eyes)?;
        self.store.put(&key, &record)?;
        self.progress.done(&what, false);
        Ok(record)
    }

    /// Writes side-by-side stills and videos; those that are there already stay.
    fn videos(&mut self) -> Result<Vec<String>, EvaluationError> {
        let Some(videos) = self.config.videos.as_ref() else { return Ok(Vec::new()) };
        let arms: BTreeSet<String> = videos.arms.iter().cloned().collect();
        let size_px = self.size_px(&arms)?;
        let folder = self.config.out.join("videos");
        std::fs::create_dir_all(&folder).map_err(EvaluationError::io("folder of videos", &folder))?;
        let mut names = Vec::new();
        for column in &self.columns {
            for group in column.routes(videos.scenarios as usize, &[0], 1.0) {
                let mut drive = Drive::new(column.world, &group[0], size_px)?;
                let digests: Vec<String> =
                    videos.arms.iter().map(|arm| self.arms[arm].digest().to_string()[..6].to_owned()).collect();
                let name = format!("{}-{}-{}.gif", column.name, group[0].scene.name, digests.join("-"));
                let path = folder.join(&name);
                if !path.exists() {
                    self.progress.note(&format!("video {name}"));
                    let film = film::side_by_side(&mut drive, &videos.arms, &self.arms, videos.frames)?;
                    let stills = path.with_extension("png");
                    ds_train::sheet::write(&stills, &film.stills())
                        .map_err(|source| EvaluationError::Stills { source })?;
                    std::fs::write(&path, film.animation()?).map_err(EvaluationError::io("video", &path))?;
                }
                names.push(name);
            }
        }
        Ok(names)
    }
}
