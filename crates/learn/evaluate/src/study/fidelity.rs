//! The study `fidelity`: FDπ of each source over paired frames, with bias, intervals and the scenes that differ.

use std::collections::BTreeMap;
use std::sync::Arc;

use ds_camera::ReferenceWorld;
use ds_fidelity::{Compared, Features, Interval, mean_of, ratio, recentred};
use ds_perception::look::LookReader;
use ds_space::Digest;
use nalgebra::DMatrix;

use super::config::{FidelityConfig, Source};
use super::features::{Lookers, Rows, Seen, key, look};
use super::frames::Take;
use super::outcome::{Figure, Outcome, Ratio, Row, Scene, Table};
use super::{page, panel};
use crate::Progress;
use crate::arm::Arm;
use crate::column;
use crate::error::AppraisalError;
use crate::store::Store;

/// Scenes that are shown of each source.
const SHOWN: usize = 4;
/// Distances are stated in hundredths of the variance.
const HUNDREDTHS: f64 = 100.0;

/// Features of one network on the real set and on each source.
struct Sets {
    name: String,
    control: bool,
    digest: Digest,
    real: Features,
    others: Vec<Features>,
    placed: Option<(Features, Vec<Features>)>,
}

/// One network's distances: the table, the draws of each source, |φ - φ̃|²/Tr Σ by source, scenario and frame.
struct Measured {
    table: Table,
    drawn: Vec<Vec<f64>>,
    pairs: Vec<Vec<Vec<f64>>>,
}

/// Makes the frames, looks at them and measures; what was looked at before is kept. `seconds` is a running clock.
///
/// # Errors
/// If weights cannot be used, a frame cannot be made, or features cannot be compared.
pub fn fidelity(
    config: &FidelityConfig,
    progress: &mut dyn Progress,
    seconds: &dyn Fn() -> f64,
) -> Result<Outcome, AppraisalError> {
    let mut study = Study::open(config)?;
    let seen = study.look(progress, seconds)?;
    let sets = study.sets(&seen);
    progress.note("distances and intervals");
    let measured: Vec<Measured> = sets.iter().map(|sets| measure(sets, config)).collect::<Result<_, _>>()?;
    let panel: Vec<&Measured> =
        measured.iter().take(study.lookers.panel.len()).filter(|found| !found.table.control).collect();
    let mut outcome = Outcome {
        kind: "sim-to-reference".to_owned(),
        first_seed: config.first_seed,
        scenarios: study.takes.len(),
        seconds: study.seconds,
        ..Outcome::default()
    };
    let values: Vec<f64> = (0..config.sources.len()).map(|at| fd_pi(&panel, config, at)).collect();
    let drawn: Vec<Vec<f64>> = (0..config.sources.len())
        .map(|at| mean_of(&panel.iter().map(|found| found.drawn[at].as_slice()).collect::<Vec<_>>()))
        .collect();
    for ((source, value), drawn) in config.sources.iter().zip(&values).zip(&drawn) {
        let figure = Figure::of(recentred(*value, drawn.clone()), 1.0);
        outcome.fd_pi.insert(source.name().to_owned(), figure);
    }
    let place = |source: &Source| config.sources.iter().position(|other| other == source);
    for [above, below] in &config.ratios {
        let found = place(above).zip(place(below)).and_then(|(above, below)| {
            let found: Option<Interval> = ratio((values[above], values[below]), (&drawn[above], &drawn[below]));
            Some(Figure::of(found?, 1.0))
        });
        outcome.ratios.push(Ratio { above: above.name().to_owned(), below: below.name().to_owned(), ratio: found });
    }
    for (at, source) in config.sources.iter().enumerate().filter(|(_, source)| **source != Source::Reference) {
        let scenes = study.worst(&panel, at, *source)?;
        outcome.worst.insert(source.name().to_owned(), scenes);
    }
    let count = study.lookers.panel.len();
    for (at, (sets, found)) in sets.iter().zip(measured).enumerate() {
        let tables = if at < count { &mut outcome.policies } else { &mut outcome.others };
        tables.insert(sets.name.clone(), found.table);
    }
    Ok(outcome)
}

/// Writes `fidelity.json` and `index.html` into the study's folder.
///
/// # Errors
/// If a file cannot be written.
pub fn write(config: &FidelityConfig, outcome: &Outcome) -> Result<(), AppraisalError> {
    let path = config.out.join("fidelity.json");
    let text = serde_json::to_string_pretty(outcome)
        .map_err(|source| AppraisalError::Record { path: path.display().to_string(), source })?;
    std::fs::write(&path, text + "\n").map_err(AppraisalError::io("outcome", &path))?;
    let path = config.out.join("index.html");
    std::fs::write(&path, page::html(outcome)).map_err(AppraisalError::io("page", &path))
}

/// The mean over the panel of the values of a source, × 100.
fn fd_pi(panel: &[&Measured], config: &FidelityConfig, at: usize) -> f64 {
    let name = config.sources[at].name();
    panel.iter().map(|found| found.table.sources[name].fd.value).sum::<f64>() / panel.len() as f64
}

fn measure(sets: &Sets, config: &FidelityConfig) -> Result<Measured, AppraisalError> {
    let compared = Compared::new(&sets.name, sets.real.clone())?;
    let sources: Vec<(&str, &Features)> = config.sources.iter().map(|source| source.name()).zip(&sets.others).collect();
    let mut drawn = compared.resampled(&sources, config.draws)?;
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
    Ok(Measured { table, drawn, pairs })
}

/// A study under way.
struct Study<'a> {
    config: &'a FidelityConfig,
    lookers: Lookers,
    takes: Vec<Take>,
    arm: Option<Arm>,
    size_px: (u32, u32),
    seconds: f64,
}

impl<'a> Study<'a> {
    fn open(config: &'a FidelityConfig) -> Result<Self, AppraisalError> {
        let panel = panel::load(config)?;
        let lookers = Lookers { panel, look: LookReader::load(&config.path(&config.look_weights))? };
        let arm = match &config.video {
            Some(files) if config.sources.contains(&Source::Dreamstream) => {
                Some(Arm::student("dreamstream", &config.path(&files.model), &config.path(&files.weights))?)
            }
            _ => None,
        };
        let size_px = arm.as_ref().map_or(config.size_px, Arm::size_px);
        let take = |index: u64| {
            let scene = column::scenario(&ReferenceWorld, config.first_seed, index);
            Ok(Take::new(index, Arc::new(scene), column::look(&config.look, config.first_seed + index)?))
        };
        let takes = (0..config.scenarios).map(take).collect::<Result<_, AppraisalError>>()?;
        Ok(Self { config, lookers, takes, arm, size_px, seconds: 0.0 })
    }

    /// Returns what is seen of every scenario: the real set, then every source.
    fn look(
        &mut self,
        progress: &mut dyn Progress,
        seconds: &dyn Fn() -> f64,
    ) -> Result<Vec<Vec<Seen>>, AppraisalError> {
        let store = Store::open(&self.config.out.join("features"))?;
        let mut sources = vec![Source::Reference];
        sources.extend(self.config.sources.iter().filter(|source| **source != Source::Reference));
        progress.ahead((self.takes.len() * sources.len()) as u64);
        let mut all = Vec::new();
        for take in &self.takes {
            let mut drive = None;
            let mut row = BTreeMap::new();
            for source in &sources {
                let key = key(self.config, &self.lookers, take, (*source, self.arm.as_ref()), self.size_px);
                let what = format!("{} of {}", source.name(), take.scene.name);
                if let Some(seen) = store.get::<Seen>(&key)? {
                    progress.done(&what, true);
                    row.insert(*source, seen);
                    continue;
                }
                let began = seconds();
                let mut ready = drive.take().map_or_else(|| take.drive(self.size_px), Ok)?;
                let frames = take.frames(*source, self.arm.as_ref(), &mut ready, self.config.frames)?;
                let seen = look(self.config, &mut self.lookers, &ready, &frames)?;
                store.put(&key, &seen)?;
                drive = Some(ready);
                self.seconds += seconds() - began;
                progress.done(&what, false);
                row.insert(*source, seen);
            }
            let order = std::iter::once(&Source::Reference).chain(&self.config.sources);
            all.push(order.map(|source| row[source].clone()).collect());
        }
        Ok(all)
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
    fn worst(&self, panel: &[&Measured], at: usize, source: Source) -> Result<Vec<Scene>, AppraisalError> {
        let looked: Vec<u32> = self.config.looked().collect();
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

    fn show(&self, take: &Take, source: Source, frame: u32, name: &str) -> Result<(), AppraisalError> {
        let folder = self.config.out.join("scenes");
        std::fs::create_dir_all(&folder).map_err(AppraisalError::io("folder of pictures", &folder))?;
        let mut drive = take.drive(self.size_px)?;
        let mut at = |source| -> Result<_, AppraisalError> {
            let frames = take.frames(source, self.arm.as_ref(), &mut drive, frame)?;
            Ok(vec![frames[frame as usize].clone()])
        };
        let rows = [at(Source::Reference)?, at(source)?];
        ds_train::sheet::write(&folder.join(name), &rows).map_err(|source| AppraisalError::Stills { source })
    }
}

fn matrix(rows: &Rows) -> DMatrix<f64> {
    DMatrix::from_fn(rows.len(), rows.first().map_or(0, Vec::len), |row, column| rows[row][column])
}
