//! An ended drive → the record of its cell: scores in both profiles and the outcome, read from the recording.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result};
use ds_benchmark::{Cell, Judged, Keep, Losses, Record};
use ds_perception::look::LookReader;
use ds_record::Recording;
use ds_run_report::Episode;
use ds_run_report::results::Outcome;
use ds_space::Tick;
use ds_topic::{Event, EventKind, Role, Topic, World};
use ds_wire::{Body, control as pb};

use crate::shown;

/// An iteration that takes longer beside the video model's work stands, in microseconds: it waits for somebody.
const STALL_MICROS: u32 = 5_000_000;

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
    let lost = match &recording {
        Some(recording) => lost(recording, result),
        None => Recording::open_partial(&path).map_or_else(|_| Losses::default(), |it| lost(&it, result)),
    };
    Ok(Record { shown: seen.flatten(), lost, ..Record::new(cell, round, episode, judged) })
}

/// Returns what a fleet lost in the attempt that was recorded: workers by role, orders that went unanswered, and the time of
/// iterations in which it stood.
fn lost(recording: &Recording, result: &pb::EpisodeResult) -> Losses {
    let orders_repeated = result.counts.get("repeats").copied().unwrap_or_default();
    let mut losses = Losses { orders_repeated, ..Losses::default() };
    for envelope in recording.topic(Topic::Event) {
        let Ok(event) = Event::from_bytes(&envelope.body) else { continue };
        if let (EventKind::Fault, Some(role)) = (event.kind, lost_role(&event.reason)) {
            *losses.workers.entry(role.name().to_owned()).or_default() += 1;
        }
    }
    let stalls = result.overhead_micros.iter().filter(|micros| **micros > STALL_MICROS);
    losses.stalled_millis = stalls.map(|micros| u64::from(*micros) / 1000).sum();
    losses
}

/// Returns the role whose holder was lost, where a driver says so: `ROLE lost INSTANCE epoch N: why`.
fn lost_role(reason: &str) -> Option<Role> {
    let mut words = reason.split(' ');
    let role = words.next()?;
    if words.next() == Some("lost") { Role::from_name(role) } else { None }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_was_lost_is_read_from_what_the_driver_says() {
        for (reason, role) in [
            ("video lost video-3 epoch 2: lease ran out", Some(Role::Video)),
            ("policy lost policy-0 epoch 1: stream closed", Some(Role::Policy)),
            ("video to video-4 epoch 3", None),
            ("nobody lost video-3 epoch 2: why", None),
            ("", None),
        ] {
            assert_eq!(lost_role(reason), role, "{reason:?}");
        }
    }
}
