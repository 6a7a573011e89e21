//! An ended drive → the record of its cell: scores in both profiles and the outcome, read from the recording.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result};
use ds_benchmark::{Cell, Judged, Keep, Record};
use ds_perception::look::LookReader;
use ds_record::Recording;
use ds_run_report::Episode;
use ds_run_report::results::Outcome;
use ds_space::Tick;
use ds_topic::{Topic, World};
use ds_wire::{Body, control as pb};

use crate::shown;

/// Makes the record of a cell that was driven in `folder`; the recording is named there only if it stays. A completed drive
/// without a recording counts as aborted. `look` is needed where cells are driven on generated frames under a condition.
///
/// # Errors
/// If the recording of a completed drive is there and cannot be read or is not whole.
pub(crate) fn record(
    cell: Cell,
    round: u32,
    result: &pb::EpisodeResult,
    folder: &Path,
    keep: Keep,
    look: Option<&LookReader>,
) -> Result<Record> {
    let mut episode = Episode::driven(result, "", folder);
    let path = folder.join(&episode.recording);
    if episode.outcome() == Outcome::Completed && !path.exists() {
        // Its line was lost after the recording was deleted: nothing is left to judge it by, so it is driven again.
        "aborted".clone_into(&mut episode.status);
        "recording_gone".clone_into(&mut episode.reason);
    }
    let recording = match episode.outcome() {
        Outcome::Completed => Some(Recording::open(&path)?),
        Outcome::Failed => Recording::open_partial(&path).ok(),
        Outcome::Aborted => None,
    };
    let judged = recording.as_ref().map(judged).transpose()?;
    let seen =
        look.zip(recording.as_ref()).map(|(look, recording)| shown::shown(look, &cell, recording)).transpose()?;
    let success = judged.as_ref().is_some_and(|judged| judged.outcome.success());
    let stays = match keep {
        Keep::All | Keep::States => true,
        Keep::Failures => !success,
        Keep::None => false,
    };
    if !stays {
        episode.recording.clear();
    }
    Ok(Record { shown: seen.flatten(), ..Record::new(cell, round, episode, judged) })
}

fn judged(recording: &Recording) -> Result<Judged> {
    let message = recording.scene();
    let mut states: BTreeMap<Tick, World> = BTreeMap::new();
    for envelope in recording.messages().filter(|envelope| envelope.header.slot.topic == Topic::World) {
        let world = World::from_bytes(&envelope.body).context("a recorded world")?;
        states.insert(world.state.tick, world);
    }
    let states: Vec<_> = states.values().map(|world| &world.state).collect();
    let spec = &message.spec;
    Ok(ds_benchmark::judge(&message.scene, spec.taken_over_at(), spec.last_tick, &states))
}

/// Deletes the recording of a drive, if it is there.
///
/// # Errors
/// If it cannot be deleted.
pub(crate) fn delete(result: &pb::EpisodeResult) -> Result<()> {
    let path = Path::new(&result.recording);
    if !result.recording.is_empty() && path.exists() {
        std::fs::remove_file(path).with_context(|| format!("remove {}", path.display()))?;
    }
    Ok(())
}

/// Leaves world states, plans and scores in the recording of a drive; one that is not whole stays as it is.
///
/// # Errors
/// If it cannot be written.
pub(crate) fn thin(result: &pb::EpisodeResult) -> Result<()> {
    let path = Path::new(&result.recording);
    if path.exists() && ds_record::damage(path).is_none() {
        ds_record::thin(path, &[Topic::World, Topic::Plan, Topic::Score])?;
    }
    Ok(())
}
