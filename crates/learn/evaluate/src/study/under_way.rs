//! A study under way: sets of frames are made and looked at side by side, what was seen is kept and sorted by network, and
//! the scenes that a page shows are drawn.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use ds_fidelity::{Features, Unit};
use ds_raster::RgbImage;
use ds_space::Digest;
use ds_topic::ObservationSource;
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::config::{Study, StudyConfig};
use super::crew::{Crew, Means};
use super::features::{Kept, Rows, Seen, key, look, matrix};
use super::found::{HUNDREDTHS, Measured, Sets};
use super::frames::Take;
use super::outcome::{Outcome, Scene};
use super::source::Source;
use crate::Progress;
use crate::arm::Arm;
use crate::column;
use crate::drive::Drive;
use crate::error::EvaluationError;
use crate::store::Store;

/// Scenes that are shown of each source.
const SHOWN: usize = 4;
/// The frame that is shown of every source.
const LOOKED_AT: u32 = 40;

/// What is seen of one scenario: the real set, then every source; of whatever else is found, each source that was asked about.
pub(super) type SeenOf<T = Seen> = Vec<Arc<T>>;

/// A study under way.
pub(super) struct UnderWay<'a> {
    pub(super) config: &'a StudyConfig,
    /// Whether policies also plan.
    plans: bool,
    pub(super) crew: Crew,
    pub(super) takes: Vec<Take>,
    /// What makes the frames of generated sources.
    arms: BTreeMap<ObservationSource, Arm>,
    size_px: (u32, u32),
    /// Seconds that sets took which were not kept.
    pub(super) seconds: f64,
}

/// A scenario as a source shows it: what is looked at, kept and counted as one.
struct Set<'a> {
    take: &'a Take,
    source: &'a Source,
    key: Digest,
}

impl Set<'_> {
    /// Names it for whoever waits.
    fn what(&self) -> String {
        format!("{} of {}", self.source.name(), self.take.scene.name)
    }
}

/// A picture of the page: one moment as sources show it, below each other.
struct Picture<'a> {
    name: &'a str,
    take: &'a Take,
    sources: Vec<&'a Source>,
    frame: u32,
}

impl<'a> UnderWay<'a> {
    /// Loads networks and what makes frames, and prepares the scenarios.
    ///
    /// # Errors
    /// If weights cannot be used or the look is unknown.
    pub(super) fn open(study: Study, config: &'a StudyConfig, means: &Means<'_>) -> Result<Self, EvaluationError> {
        let crew = Crew::gather(config, means)?;
        let mut arms = BTreeMap::new();
        for source in config.sources.iter().map(|source| source.from).filter(|source| source.is_generated()) {
            let Some(files) = &config.video else { continue };
            if let Entry::Vacant(entry) = arms.entry(source) {
                let [model, weights, other] =
                    [&files.model, &files.weights, &files.no_guidance].map(|file| config.path(file));
                entry.insert(Arm::of_source(source, &model, &weights, &other)?);
            }
        }
        let size_px = arms.values().next().map_or(config.size_px, Arm::size_px);
        let take = |index: u64| {
            let scene = column::scenario(config.world.world(), config.first_seed, index);
            let look = column::look(&config.look, config.first_seed + index)?;
            Ok(Take::new(config, index, Arc::new(scene), look))
        };
        let takes = (0..config.scenarios).map(take).collect::<Result<_, EvaluationError>>()?;
        Ok(Self { config, plans: study == Study::Correlation, crew, takes, arms, size_px, seconds: 0.0 })
    }

    /// Shows the guests the first frame of the real set.
    ///
    /// # Errors
    /// If it cannot be made, or a guest tells of nothing.
    pub(super) fn greet(&self) -> Result<(), EvaluationError> {
        let (take, real) = (&self.takes[0], Source::reference());
        for guest in self.crew.lookers().panel.iter_mut().filter(|member| member.guest) {
            let mut drive = take.drive(&real, self.size_px)?;
            let frames = take.frames(&real, None, &mut drive, 0)?;
            guest.greet(&drive.model, &frames[0], &drive.name)?;
        }
        Ok(())
    }

    /// Returns what is seen of every scenario; what is not kept yet is made and looked at side by side.
    ///
    /// # Errors
    /// If a frame cannot be made or looked at, or a record cannot be used.
    pub(super) fn look(
        &mut self,
        progress: &mut dyn Progress,
        seconds: &dyn Fn() -> f64,
    ) -> Result<Vec<SeenOf>, EvaluationError> {
        let real = Source::reference();
        let sources: Vec<&Source> = std::iter::once(&real).chain(&self.config.sources).collect();
        let kept = if self.plans { Kept::FeaturesAndPdms } else { Kept::Features };
        let seen = |take: &Take, source: &Source| self.seen(take, source);
        let (seen, took) = self.each_set(kept, &sources, &seen, progress, seconds)?;
        self.seconds = took;
        Ok(seen)
    }

    /// Returns what is found of every scenario as each source shows it, with the seconds that it took: what is not kept yet is
    /// found side by side, by `find`.
    ///
    /// # Errors
    /// As of `find`, or if a record cannot be used.
    pub(super) fn each_set<T: Serialize + DeserializeOwned + Send + Sync>(
        &self,
        kept: Kept,
        sources: &[&Source],
        find: &(dyn Fn(&Take, &Source) -> Result<T, EvaluationError> + Sync),
        progress: &mut dyn Progress,
        seconds: &dyn Fn() -> f64,
    ) -> Result<(Vec<SeenOf<T>>, f64), EvaluationError> {
        let store = Store::open(&self.config.out.join(kept.folder()))?;
        let sets = self.listed(kept, sources);
        progress.ahead(sets.len() as u64);
        let mut seen: BTreeMap<Digest, Arc<T>> = BTreeMap::new();
        let (mut missing, mut known): (Vec<&Set<'_>>, BTreeSet<Digest>) = Default::default();
        for set in &sets {
            // The reference as a source is the real set, looked at once.
            if known.insert(set.key) {
                let Some(stored) = store.get(&set.key)? else {
                    missing.push(set);
                    continue;
                };
                seen.insert(set.key, Arc::new(stored));
            }
            progress.done(&set.what(), true);
        }
        let (began, told) = (seconds(), Mutex::new(progress));
        let made = self.crew.each(missing.len(), |at| {
            let set = missing[at];
            let made = find(set.take, set.source)?;
            store.put(&set.key, &made)?;
            told.lock().unwrap_or_else(PoisonError::into_inner).done(&set.what(), false);
            Ok(Arc::new(made))
        })?;
        let took = if made.is_empty() { 0.0 } else { seconds() - began };
        seen.extend(missing.iter().map(|set| set.key).zip(made));
        let of = |sets: &[Set<'_>]| sets.iter().map(|set| Arc::clone(&seen[&set.key])).collect();
        Ok((sets.chunks(sources.len()).map(of).collect(), took))
    }

    /// Lists the sets of frames, scenario by scenario.
    fn listed<'b>(&'b self, kept: Kept, sources: &[&'b Source]) -> Vec<Set<'b>> {
        let lookers = self.crew.lookers();
        let set = |take: &'b Take, source: &'b Source| {
            let arm = self.arms.get(&source.from);
            Set { take, source, key: key(self.config, kept, &lookers, take, (source, arm), self.size_px) }
        };
        self.takes
            .iter()
            .flat_map(|take| sources.iter().map(move |source| (take, *source)))
            .map(|(take, source)| set(take, source))
            .collect()
    }

    /// Makes the frames of a scenario as a source shows it and looks at them.
    fn seen(&self, take: &Take, source: &Source) -> Result<Seen, EvaluationError> {
        let (drive, frames) = self.frames(take, source, self.config.frames)?;
        look(self.config, self.plans, &mut self.crew.lookers(), take, &drive, &frames)
    }

    /// Prepares the drive of a scenario as a source shows it.
    ///
    /// # Errors
    /// If the source's look is unknown or the scenario has no camera.
    pub(super) fn drive(&self, take: &Take, source: &Source) -> Result<Drive, EvaluationError> {
        take.drive(source, self.size_px)
    }

    /// Makes frames 0 to `last` of a scenario as a source shows it, with the drive that they are of.
    ///
    /// # Errors
    /// As of [`UnderWay::drive`], or if a frame cannot be made.
    pub(super) fn frames(
        &self,
        take: &Take,
        source: &Source,
        last: u32,
    ) -> Result<(Drive, Vec<RgbImage>), EvaluationError> {
        let mut drive = self.drive(take, source)?;
        let frames = take.frames(source, self.arms.get(&source.from), &mut drive, last)?;
        Ok((drive, frames))
    }

    /// Returns PDMS by policy, source (the real set first) and scenario.
    pub(super) fn pdms(&self, seen: &[SeenOf]) -> Vec<Vec<Vec<Vec<f64>>>> {
        let of = |policy: usize| {
            let source = |at: usize| seen.iter().map(|row| row[at].pdms[policy].clone()).collect();
            (0..=self.config.sources.len()).map(source).collect()
        };
        if self.plans { (0..self.config.panel.len()).map(of).collect() } else { Vec::new() }
    }

    /// Sorts what was seen by network: the panel in its order, then the look network's and those that were given.
    pub(super) fn sets(&self, seen: &[SeenOf]) -> Vec<Sets> {
        let lookers = self.crew.lookers();
        let split = |of: &dyn Fn(&Seen) -> &Rows| {
            let set = |at: usize| Features(seen.iter().map(|row| matrix(of(&row[at]))).collect());
            let mut all: Vec<Features> = (0..=self.config.sources.len()).map(set).collect();
            (all.remove(0), all)
        };
        let mut sets = Vec::new();
        for (at, member) in lookers.panel.iter().enumerate() {
            let (real, others) = split(&|seen| &seen.mean[at]);
            let placed = Some(split(&|seen| &seen.placed[at]));
            let (name, control, digest) = (member.name.clone(), member.control, member.digest);
            sets.push(Sets { name, control, digest, real, others, placed, unit: Unit::Variance });
        }
        let digest = lookers.look.digest();
        for (name, (real, others)) in
            [("fd_look", split(&|seen| &seen.look)), ("fd_look_clip", split(&|seen| &seen.clips))]
        {
            let (name, unit) = (name.to_owned(), Unit::Variance);
            sets.push(Sets { name, control: true, digest, real, others, placed: None, unit });
        }
        for (at, given) in lookers.given.iter().enumerate() {
            let (real, others) = split(&|seen| &seen.given[at]);
            let (name, digest, unit) = (given.name.to_owned(), given.digest(), Unit::Features);
            sets.push(Sets { name, control: true, digest, real, others, placed: None, unit });
        }
        sets
    }

    /// Ranks scenes by how far a source's frames are apart for the panel; of those that come first, the frame that differs most is to be shown.
    pub(super) fn worst(&self, panel: &[&Measured], at: usize, source: &Source) -> Vec<Scene> {
        let looked = self.config.looked();
        let apart = |scene: usize, frame: usize| {
            panel.iter().map(|found| found.pairs[at][scene][frame]).sum::<f64>() / panel.len() as f64 * HUNDREDTHS
        };
        let mut ranked: Vec<(usize, f64, usize)> = (0..self.takes.len())
            .map(|scene| {
                let frames: Vec<f64> = (0..looked.len()).map(|frame| apart(scene, frame)).collect();
                let most = (0..frames.len()).fold(0, |most, k| if frames[k] > frames[most] { k } else { most });
                (scene, frames.iter().sum::<f64>() / frames.len() as f64, most)
            })
            .collect();
        ranked.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        let one = |(rank, (scene, apart, most)): (usize, &(usize, f64, usize))| {
            let (name, frame) = (self.takes[*scene].scene.name.clone(), looked[*most]);
            let picture = (rank < SHOWN).then(|| format!("{}-{name}-{frame}.png", source.name()));
            Scene { name, apart: *apart, frame, picture }
        };
        ranked.iter().enumerate().map(one).collect()
    }

    /// Names every source with the picture of the moment that is shown of all.
    pub(super) fn looks(&self) -> Vec<(String, String)> {
        let one = |source: &Source| (source.name().to_owned(), format!("look-{}.png", source.name()));
        self.config.sources.iter().map(one).collect()
    }

    /// Draws the pictures that an outcome names: scenes below the real set's, and one moment as every source shows it.
    ///
    /// # Errors
    /// If a frame cannot be made or a file cannot be written.
    pub(super) fn show<'b>(&'b self, outcome: &'b Outcome) -> Result<(), EvaluationError> {
        let folder = self.scenes()?;
        let [real, layout] = [ObservationSource::Reference, ObservationSource::Layout].map(Source::plain);
        let mut pictures = Vec::new();
        for (_, source) in self.config.others() {
            let picture = |(name, scenario, frame): (&'b str, &str, u32), sources| {
                let take = self.takes.iter().find(|take| take.scene.name == scenario)?;
                Some(Picture { name, take, sources, frame })
            };
            for scene in outcome.worst.get(source.name()).into_iter().flatten() {
                let named = scene.picture.as_deref().map(|name| (name, scene.name.as_str(), scene.frame));
                pictures.extend(named.and_then(|named| picture(named, vec![&real, source])));
            }
            let furthest = outcome.parts.iter().filter_map(|parts| parts.furthest.get(source.name()));
            for apart in furthest.flatten() {
                let named = (apart.picture.as_str(), apart.scenario.as_str(), apart.frame);
                pictures.extend(picture(named, vec![&real, source, &layout]));
            }
        }
        let frame = LOOKED_AT.min(self.config.frames);
        let looks = outcome.looks.iter().zip(&self.config.sources);
        pictures.extend(looks.map(|((_, name), source)| Picture {
            name,
            take: &self.takes[0],
            sources: vec![source],
            frame,
        }));
        let draw = |at: usize| {
            let Picture { name, take, sources, frame } = &pictures[at];
            let row = |source: &&Source| Ok(vec![self.frame(take, source, *frame)?]);
            let rows = sources.iter().map(row).collect::<Result<Vec<_>, EvaluationError>>()?;
            ds_train::sheet::write(&folder.join(name), &rows).map_err(|source| EvaluationError::Stills { source })
        };
        self.crew.each(pictures.len(), draw).map(|_| ())
    }

    /// Returns the folder of pictures, made if it is not there.
    ///
    /// # Errors
    /// If it cannot be made.
    pub(super) fn scenes(&self) -> Result<PathBuf, EvaluationError> {
        let folder = self.config.out.join("scenes");
        std::fs::create_dir_all(&folder).map_err(EvaluationError::io("folder of pictures", &folder))?;
        Ok(folder)
    }

    fn frame(&self, take: &Take, source: &Source, frame: u32) -> Result<RgbImage, EvaluationError> {
        let (_, mut frames) = self.frames(take, source, frame)?;
        Ok(frames.swap_remove(frame as usize))
    }
}
