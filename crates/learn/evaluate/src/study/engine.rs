//! The engine of all studies over frames: declared sources, what networks see of them, distances with their resamples.
//!
//! Features are kept per scenario and source. What a study asks of the distances is in a file of its own.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::Path;
use std::sync::Arc;

use ds_fidelity::{Compared, Features, Interval, ratio, recentred};
use ds_perception::look::LookReader;
use ds_raster::RgbImage;
use ds_topic::ObservationSource;

use super::config::{Study, StudyConfig};
use super::features::{Lookers, Rows, Seen, key, look, matrix};
use super::found::{Found, Measured, Sets};
use super::frames::Take;
use super::outcome::{Figure, Outcome, Ratio, Row, Scene, Table};
use super::panel::Guests;
use super::source::Source;
use super::{anchor, correlation, page, panel, rollout, sensitivity};
use crate::Progress;
use crate::arm::Arm;
use crate::column;
use crate::error::AppraisalError;
use crate::store::Store;

/// Scenes that are shown of each source.
const SHOWN: usize = 4;
/// The frame that is shown of every source.
const LOOKED_AT: u32 = 40;
/// Distances are stated in hundredths of the variance.
const HUNDREDTHS: f64 = 100.0;

/// Makes the frames, looks at them and measures; what was looked at before is kept. `guests` are the policies that connect,
/// `seconds` is a running clock.
///
/// # Errors
/// If weights cannot be used, a frame cannot be made, or features cannot be compared.
pub fn run(
    study: Study,
    config: &StudyConfig,
    guests: &Guests<'_>,
    progress: &mut dyn Progress,
    seconds: &dyn Fn() -> f64,
) -> Result<Outcome, AppraisalError> {
    config.check_for(study)?;
    let mut under_way = UnderWay::open(study, config, guests)?;
    under_way.greet()?;
    let recorded = anchor::look(config, &mut under_way.lookers.panel)?;
    let seen = under_way.look(progress, seconds)?;
    let sets = under_way.sets(&seen);
    progress.note("distances and intervals");
    let names: Vec<&str> = config.sources.iter().map(Source::name).collect();
    let measured: Vec<Measured> =
        sets.iter().map(|sets| measure(sets, &names, config.draws)).collect::<Result<_, _>>()?;
    let policies = under_way.lookers.panel.len();
    let pdms = under_way.pdms(&seen);
    let found = Found { config, takes: &under_way.takes, sets, measured, pdms, policies };
    let mut outcome = Outcome {
        study: study.name().to_owned(),
        kind: "sim-to-reference".to_owned(),
        world: format!("{:?}", config.world),
        first_seed: config.first_seed,
        scenarios: under_way.takes.len(),
        seconds: under_way.seconds,
        ..Outcome::default()
    };
    distances(&found, &mut outcome);
    outcome.anchor = (!recorded.is_empty()).then(|| anchor::of(&found, &recorded)).transpose()?;
    let panel: Vec<&Measured> = found.panel().iter().map(|at| &found.measured[*at]).collect();
    for (at, source) in config.others() {
        let scenes = under_way.worst(&panel, at, source)?;
        outcome.worst.insert(source.name().to_owned(), scenes);
    }
    outcome.looks = under_way.looks(&config.sources)?;
    match study {
        Study::Fidelity | Study::Ablation | Study::Anchor => {}
        Study::Correlation => outcome.correlation = Some(correlation::of(&found)),
        Study::Sensitivity => outcome.sensitivity = Some(sensitivity::of(&found)?),
        Study::Rollout => outcome.rollout = Some(rollout::of(&found)?),
    }
    for (at, measured) in found.measured.into_iter().enumerate() {
        let tables = if at < policies { &mut outcome.policies } else { &mut outcome.others };
        tables.insert(measured.name, measured.table);
    }
    Ok(outcome)
}

/// States FDπ of every source and the ratios.
fn distances(found: &Found<'_>, outcome: &mut Outcome) {
    let config = found.config;
    let all: Vec<(f64, Vec<f64>)> = (0..config.sources.len()).map(|at| found.fd_pi(at)).collect();
    for (source, (value, drawn)) in config.sources.iter().zip(&all) {
        outcome.fd_pi.insert(source.name().to_owned(), Figure::of(recentred(*value, drawn.clone()), 1.0));
    }
    for [above, below] in &config.ratios {
        let places = config.place(above).zip(config.place(below));
        let ratio = places.and_then(|(above, below)| {
            let found: Option<Interval> = ratio(all[above].0, all[below].0, (&all[above].1, &all[below].1));
            Some(Figure::of(found?, 1.0))
        });
        outcome.ratios.push(Ratio { above: above.clone(), below: below.clone(), ratio });
    }
}

/// Writes `STUDY.json` and `index.html` into the study's folder.
///
/// # Errors
/// If a file cannot be written.
pub fn write(config: &StudyConfig, outcome: &Outcome) -> Result<(), AppraisalError> {
    write_json(&config.out, outcome)?;
    let path = config.out.join("index.html");
    std::fs::write(&path, page::html(outcome)).map_err(AppraisalError::io("page", &path))
}

/// Writes `STUDY.json` alone.
///
/// # Errors
/// If the file cannot be written.
pub fn write_json(folder: &Path, outcome: &Outcome) -> Result<(), AppraisalError> {
    let path = folder.join(format!("{}.json", outcome.study));
    let text = serde_json::to_string_pretty(outcome)
        .map_err(|source| AppraisalError::Record { path: path.display().to_string(), source })?;
    std::fs::write(&path, text + "\n").map_err(AppraisalError::io("outcome", &path))
}

/// Measures how far sets of these names look from the real one to a network.
pub(super) fn measure(sets: &Sets, names: &[&str], draws: u64) -> Result<Measured, AppraisalError> {
    let compared = Compared::new(&sets.name, sets.real.clone())?;
    let sources: Vec<(&str, &Features)> = names.iter().copied().zip(&sets.others).collect();
    let mut drawn = compared.resampled(&sources, draws)?;
    drawn.iter_mut().flatten().for_each(|value| *value *= HUNDREDTHS);
    let placed = match &sets.placed {
        None => None,
        Some((real, others)) => Some((Compared::new(&sets.name, real.clone())?, others)),
    };
    let mut rows = BTreeMap::new();
    let mut pairs = Vec::new();
    let mut size = (0, 0);
    for (at, (name, other)) in sources.iter().enumerate() {
        let found = compared.distance(name, other)?;
        size = (found.frames, found.features);
        let placed = placed.as_ref().map(|(compared, others)| compared.distance(name, &others[at])).transpose()?;
        let row = Row {
            fd: Figure::of(recentred(found.value * HUNDREDTHS, drawn[at].clone()), 1.0),
            bound: found.bound * HUNDREDTHS,
            bias: found.bias * HUNDREDTHS,
            extrapolated: found.extrapolated * HUNDREDTHS,
            warnings: found.warnings,
            placed: placed.map(|placed| placed.value * HUNDREDTHS),
        };
        rows.insert((*name).to_owned(), row);
        pairs.push(compared.pairs(name, other)?);
    }
    let table = Table {
        control: sets.control,
        features: size.1,
        frames: size.0,
        halves: compared.halves()? * HUNDREDTHS,
        sources: rows,
        digest: sets.digest.to_string(),
    };
    Ok(Measured { name: sets.name.clone(), table, drawn, pairs })
}

/// A study under way.
struct UnderWay<'a> {
    config: &'a StudyConfig,
    /// Whether policies also plan.
    plans: bool,
    lookers: Lookers,
    takes: Vec<Take>,
    /// What makes the frames of generated sources.
    arms: BTreeMap<ObservationSource, Arm>,
    size_px: (u32, u32),
    seconds: f64,
}

impl<'a> UnderWay<'a> {
    fn open(study: Study, config: &'a StudyConfig, guests: &Guests<'_>) -> Result<Self, AppraisalError> {
        let panel = panel::load(config, guests)?;
        let lookers = Lookers { panel, look: LookReader::load(&config.path(&config.look_weights))? };
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
        let takes = (0..config.scenarios).map(take).collect::<Result<_, AppraisalError>>()?;
        Ok(Self { config, plans: study == Study::Correlation, lookers, takes, arms, size_px, seconds: 0.0 })
    }

    /// Shows the guests the first frame of the real set.
    fn greet(&mut self) -> Result<(), AppraisalError> {
        let (take, real) = (&self.takes[0], Source::reference());
        for guest in self.lookers.panel.iter_mut().filter(|member| member.guest) {
            let mut drive = take.drive(&real, self.size_px)?;
            let frames = take.frames(&real, None, &mut drive, 0)?;
            guest.greet(&drive.model, &frames[0], &drive.name)?;
        }
        Ok(())
    }

    /// Returns what is seen of every scenario: the real set, then every source.
    fn look(
        &mut self,
        progress: &mut dyn Progress,
        seconds: &dyn Fn() -> f64,
    ) -> Result<Vec<Vec<Seen>>, AppraisalError> {
        let store = Store::open(&self.config.out.join("features"))?;
        let sources: Vec<Source> = std::iter::once(Source::reference()).chain(self.config.sources.clone()).collect();
        progress.ahead((self.takes.len() * sources.len()) as u64);
        let asked = (self.config, self.plans);
        let mut all = Vec::new();
        for take in &self.takes {
            let mut row = Vec::new();
            for source in &sources {
                let arm = self.arms.get(&source.from);
                let key = key(asked.0, asked.1, &self.lookers, take, (source, arm), self.size_px);
                let what = format!("{} of {}", source.name(), take.scene.name);
                let stored = store.get::<Seen>(&key)?;
                progress.done(&what, stored.is_some());
                row.push(match stored {
                    Some(seen) => seen,
                    None => {
                        let began = seconds();
                        let mut drive = take.drive(source, self.size_px)?;
                        let frames = take.frames(source, arm, &mut drive, self.config.frames)?;
                        let seen = look(asked.0, asked.1, &mut self.lookers, take, &drive, &frames)?;
                        store.put(&key, &seen)?;
                        self.seconds += seconds() - began;
                        seen
                    }
                });
            }
            all.push(row);
        }
        Ok(all)
    }

    /// Returns PDMS by policy, source (the real set first) and scenario.
    fn pdms(&self, seen: &[Vec<Seen>]) -> Vec<Vec<Vec<Vec<f64>>>> {
        let of = |policy: usize| {
            let source = |at: usize| seen.iter().map(|row| row[at].pdms[policy].clone()).collect();
            (0..=self.config.sources.len()).map(source).collect()
        };
        if self.plans { (0..self.lookers.panel.len()).map(of).collect() } else { Vec::new() }
    }

    /// Sorts what was seen by network: the panel in its order, then the look network's.
    fn sets(&self, seen: &[Vec<Seen>]) -> Vec<Sets> {
        let split = |of: &dyn Fn(&Seen) -> &Rows| {
            let set = |at: usize| Features(seen.iter().map(|row| matrix(of(&row[at]))).collect());
            let mut all: Vec<Features> = (0..=self.config.sources.len()).map(set).collect();
            (all.remove(0), all)
        };
        let mut sets = Vec::new();
        for (at, member) in self.lookers.panel.iter().enumerate() {
            let (real, others) = split(&|seen| &seen.mean[at]);
            let placed = Some(split(&|seen| &seen.placed[at]));
            let (name, control, digest) = (member.name.clone(), member.control, member.digest);
            sets.push(Sets { name, control, digest, real, others, placed });
        }
        let digest = self.lookers.look.digest();
        for (name, (real, others)) in
            [("fd_look", split(&|seen| &seen.look)), ("fd_look_clip", split(&|seen| &seen.clips))]
        {
            sets.push(Sets { name: name.to_owned(), control: true, digest, real, others, placed: None });
        }
        sets
    }

    /// Ranks scenes by how far a source's frames are apart for the panel, and shows the frame that differs most.
    fn worst(&self, panel: &[&Measured], at: usize, source: &Source) -> Result<Vec<Scene>, AppraisalError> {
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
            let (take, frame) = (&self.takes[*scene], looked[*most]);
            let picture = format!("{}-{}-{frame}.png", source.name(), take.scene.name);
            let picture = (rank < SHOWN).then_some(picture);
            if let Some(name) = &picture {
                self.show(take, source, frame, name)?;
            }
            Ok(Scene { name: take.scene.name.clone(), apart: *apart, frame, picture })
        };
        ranked.iter().enumerate().map(one).collect()
    }

    fn show(&self, take: &Take, source: &Source, frame: u32, name: &str) -> Result<(), AppraisalError> {
        let rows = [Source::reference(), source.clone()].map(|source| self.frame(take, &source, frame));
        let [real, shown] = rows;
        self.sheet(name, &[vec![real?], vec![shown?]])
    }

    fn frame(&self, take: &Take, source: &Source, frame: u32) -> Result<RgbImage, AppraisalError> {
        let mut drive = take.drive(source, self.size_px)?;
        let mut frames = take.frames(source, self.arms.get(&source.from), &mut drive, frame)?;
        Ok(frames.swap_remove(frame as usize))
    }

    fn sheet(&self, name: &str, rows: &[Vec<RgbImage>]) -> Result<(), AppraisalError> {
        let folder = self.config.out.join("scenes");
        std::fs::create_dir_all(&folder).map_err(AppraisalError::io("folder of pictures", &folder))?;
        ds_train::sheet::write(&folder.join(name), rows).map_err(|source| AppraisalError::Stills { source })
    }

    /// Shows one moment of one scenario as every source shows it; returns names of source and picture.
    fn looks(&self, sources: &[Source]) -> Result<Vec<(String, String)>, AppraisalError> {
        let frame = LOOKED_AT.min(self.config.frames);
        let one = |source: &Source| {
            let name = format!("look-{}.png", source.name());
            self.sheet(&name, &[vec![self.frame(&self.takes[0], source, frame)?]])?;
            Ok((source.name().to_owned(), name))
        };
        sources.iter().map(one).collect()
    }
}
