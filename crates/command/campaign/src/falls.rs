//! The worst falls of a benchmark → an animation of each of their drives whose recording was kept, in the run itself, in the runs that
//! were merged, or in others that drove it again.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use ds_benchmark::report::falls::{Side, worst};
use ds_benchmark::{Results, record};
use ds_process::terminal::bar;
use ds_record::Recording;
use ds_topic::{Topic, World};
use ds_wire::Body;
use ds_world::WorldState;
use rayon::prelude::*;

use crate::above;

/// The folder of the animations, in that of the report.
const FOLDER: &str = "falls";

/// Draws what recordings are left of, and returns each animation by the key of its cell.
///
/// # Errors
/// If a folder of `recordings` cannot be read or drove a cell to another end, a recording is damaged or of another drive, or an
/// animation cannot be written.
pub(crate) fn draw(results: &Results, recordings: &[PathBuf]) -> Result<BTreeMap<String, String>> {
    let falls = worst(results);
    let sides: BTreeMap<&str, &Side> =
        falls.iter().flat_map(|fall| &fall.sides).map(|side| (side.key.as_str(), side)).collect();
    let again = again(&sides, recordings)?;
    let merged = results.merged.iter().flat_map(|merged| &merged.folders);
    let folders: Vec<&Path> = merged.map(PathBuf::as_path).chain([results.folder.as_path()]).collect();
    let kept = |side: &Side| {
        let name = Some(&side.drive.recording).filter(|name| !name.is_empty());
        let own = name.into_iter().flat_map(|name| folders.iter().map(move |folder| folder.join(name)));
        own.chain(again.get(side.key.as_str()).cloned()).find(|path| path.exists())
    };
    let found: Vec<(&Side, PathBuf)> = sides.values().filter_map(|side| Some((*side, kept(side)?))).collect();
    let out = results.folder.join(FOLDER);
    if !found.is_empty() {
        std::fs::create_dir_all(&out).with_context(|| format!("create {}", out.display()))?;
    }
    let bar = bar(found.len() as u64, "animations");
    let drawn = found.par_iter().map(|(side, recording)| {
        let name = format!("{}.gif", side.name());
        let path = out.join(&name);
        if !path.exists() {
            animate(side, recording, &path).with_context(|| format!("recording {}", recording.display()))?;
        }
        bar.inc(1);
        Ok((side.key.clone(), format!("{FOLDER}/{name}")))
    });
    let drawn = drawn.collect::<Result<_>>();
    bar.finish_and_clear();
    drawn
}

/// Returns the recordings of cells that were driven again, by their keys.
fn again<'a>(sides: &BTreeMap<&'a str, &Side>, folders: &[PathBuf]) -> Result<BTreeMap<&'a str, PathBuf>> {
    let mut found = BTreeMap::new();
    for folder in folders {
        let mut other = None;
        record::read(folder, |_, record| {
            let Some((key, side)) = sides.get_key_value(record.key.as_str()) else { return };
            if record.ended() && record.digest != side.drive.digest {
                other.get_or_insert_with(|| format!("{} ({})", record.key, record.cell.told()));
            } else if record.ended() && !record.episode.recording.is_empty() {
                found.insert(*key, folder.join(&record.episode.recording));
            }
        })?;
        if let Some(cell) = other {
            bail!("divergent_cell {cell}: {} drove it to another end than the results", folder.display());
        }
    }
    Ok(found)
}

fn animate(side: &Side, recording: &Path, path: &Path) -> Result<()> {
    let recording = Recording::open_partial(recording)?;
    let scene = &recording.scene().scene;
    let said = &side.entry.scenario_digest;
    ensure!(scene.digest.to_string() == *said, "of scenario {} with digest {}, not {said}", scene.name, scene.digest);
    let worlds = recording.topic(Topic::World).map(|envelope| Ok(World::from_bytes(&envelope.body)?.state));
    let states: Vec<WorldState> = worlds.collect::<Result<_>>()?;
    let from = states.partition_point(|state| state.tick.0 < side.entry.hand_over);
    let scored = &states[from..];
    ensure!(!scored.is_empty(), "no world state from the hand-over on");
    above::animate(scene, scored, path)
}
