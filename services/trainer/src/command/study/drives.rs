//! `study drives`: FDπ between folders of recorded drives, matched by scenario and seed, looked at every so many ticks; or between
//! folders of pictures, matched by name.

use std::collections::BTreeMap;
use std::error::Error;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use ds_evaluate::study::config::Recorded;
use ds_evaluate::study::{self, RecordedDrive, StudyConfig};
use ds_process::service::UsageError;
use ds_process::shipped;
use ds_process::terminal::{answer, bar};
use ds_record::Recording;
use ds_space::Tick;
use ds_topic::{Frame, Slot, Topic};

use super::{give, guests, load, refused, said, take, wrong};
use crate::cli::DrivesArgs;
use crate::command::video::Bar;

/// Which drive a recording is of: scenario, by name and digest, and seed.
type Key = (String, String, u64);

/// A drive that all folders hold.
struct Matched {
    /// Its recording by folder, as an index.
    files: BTreeMap<usize, PathBuf>,
    /// The last tick of which all hold a frame.
    last: Tick,
}

/// Runs the study.
///
/// # Errors
/// If recordings cannot be read, or the folders share no drives.
pub(super) fn run(args: &DrivesArgs) -> Result<()> {
    let path = args.config.clone().unwrap_or_else(|| shipped::find(Path::new("configs/study/fidelity.toml")));
    let mut config = load(&path)?;
    give(&mut config, &args.given)?;
    if let Some(twice) = (1..args.source.len()).find(|at| args.source[..*at].contains(&args.source[*at])) {
        return Err(UsageError(format!("--source {} stands twice", args.source[twice].display())).into());
    }
    let _held = args.out.as_deref().map(|out| take(out, "drives")).transpose()?;
    let mut progress = Bar(bar(0, "sets"));
    let real = args.real.as_ref().map(|real| real.display().to_string()).unwrap_or_default();
    let outcome = match &args.recorded {
        Some(file) => {
            let sets = Recorded::load(file).map_err(|error| wrong(file, error))?;
            study::pictures(&config, &guests()?, &sets, &mut progress).map_err(|error| refused(file, error))?
        }
        None => {
            let folders = || args.real.iter().chain(&args.source);
            let names: Vec<String> = folders().map(|folder| folder.display().to_string()).collect();
            let drives = matched(folders(), config.every)?;
            let mut drive = |set: usize, index: usize| recorded(&drives[index], set, &config);
            study::drives(&config, &guests()?, &names, drives.len(), &mut drive, &mut progress)
                .map_err(|error| refused(&path, error))?
        }
    };
    progress.0.finish_and_clear();
    said(&outcome);
    for (name, apart_m) in &outcome.apart_m {
        answer(&format!("cars of {name} stand {apart_m:.2} m from those of {real} on average"));
    }
    if let Some(out) = &args.out {
        study::write_json(out, &outcome)?;
        answer(&out.join("drives.json").display().to_string());
    }
    Ok(())
}

/// Returns the drives of which every folder holds frames at the first tick that is looked at, in order of their scenarios.
///
/// # Errors
/// If a folder holds a drive twice, or fewer than two are in all.
fn matched<'a>(folders: impl Iterator<Item = &'a PathBuf>, every: u32) -> Result<Vec<Matched>> {
    let mut all: BTreeMap<Key, Matched> = BTreeMap::new();
    let mut count = 0;
    for (place, folder) in folders.enumerate() {
        for (key, file, last) in recordings(folder)? {
            let found = all.entry(key).or_insert(Matched { files: BTreeMap::new(), last });
            found.last = found.last.min(last);
            if let Some(other) = found.files.insert(place, file.clone()) {
                bail!(
                    "{} and {} are of the same scenario and seed: one of a folder is needed",
                    other.display(),
                    file.display()
                );
            }
        }
        count = place + 1;
    }
    let drives: Vec<Matched> =
        all.into_values().filter(|drive| drive.files.len() == count && drive.last >= Tick(every)).collect();
    ensure!(
        drives.len() > 1,
        "the folders share {} drives with frames up to tick {every}; two at least of the same scenario and seed are needed",
        drives.len()
    );
    Ok(drives)
}

/// Returns the recordings in a folder, or in `recordings` there, with the last tick of which each holds a frame.
fn recordings(folder: &Path) -> Result<Vec<(Key, PathBuf, Tick)>> {
    let inner = folder.join("recordings");
    let folder = if inner.is_dir() { &inner } else { folder };
    let mut found = Vec::new();
    let listed = std::fs::read_dir(folder).with_context(|| format!("folder {}", folder.display()))?;
    for entry in listed {
        let path = entry.with_context(|| format!("folder {}", folder.display()))?.path();
        if path.extension().is_some_and(|ending| ending == "mcap") {
            let recording = Recording::open(&path).with_context(|| format!("recording {}", path.display()))?;
            let spec = &recording.scene().spec;
            let key = (spec.scenario.clone(), spec.scenario_digest.to_string(), spec.seed);
            let last = recording.topic(Topic::Frame).map(|frame| frame.header.tick).max();
            found.extend(last.map(|last| (key, path, last)));
        }
    }
    Ok(found)
}

/// Reads the frames of the first camera that are looked at, or all where clips are.
fn recorded(drive: &Matched, set: usize, config: &StudyConfig) -> Result<RecordedDrive, Box<dyn Error + Send + Sync>> {
    let recording = Recording::open(&drive.files[&set])?;
    let (mut frames, mut places) = (Vec::new(), Vec::new());
    let step = if config.fvd.is_some() { 1 } else { config.every };
    for tick in (step..=drive.last.0).step_by(step as usize) {
        frames.push(recording.body::<Frame>(Slot::of_camera(Topic::Frame, tick, 0))?.image);
        if tick.is_multiple_of(config.every) {
            places.push(recording.world(Tick(tick))?.ego.pose.position);
        }
    }
    let every = (config.every / step) as usize;
    let scene = &recording.scene().scene;
    let camera = scene.cameras.first().ok_or("the scenario has no camera")?.clone();
    Ok(RecordedDrive { name: scene.name.clone(), camera, frames, every, places })
}
