//! The viewer's data: a recording, or messages as they come, as entities on the one timeline `sim_time`.
//!
//! World frame in metres: map (once), agents as boxes, ego with its path, plan and proposals as lines. Per camera the
//! frame with the projected boxes over it, and the layout, as JPEG. Scores and speed as curves, events as text, a running
//! diagnosis as curves and text. The
//! viewer itself is not part of this crate: it opens an `.rrd` file or is connected to.

mod arrangement;
mod boxes;
mod diagnosis;
pub mod explained;
pub mod live;
mod logger;
mod map;
pub mod training;

use std::collections::BTreeSet;
use std::path::Path;

use ds_topic::{Diagnosis, SceneMessage, Topic};
use rerun::{RecordingStream, RecordingStreamBuilder};

use crate::error::RecordError;
use crate::recording::Recording;

pub use live::{LiveView, Shown};
pub use logger::Logger;

/// The name under which the viewer lists recordings.
pub const APPLICATION: &str = "dreamstream";
/// The timeline.
pub const TIMELINE: &str = "sim_time";
/// Where a viewer on the same machine listens by default.
pub const DEFAULT_URL: &str = rerun::DEFAULT_CONNECT_URL;

/// Writes a recording to a file that the viewer opens; no display is needed.
///
/// # Errors
/// If a body cannot be decoded or the file not be written.
pub fn save_rrd(recording: &Recording, path: &Path) -> Result<(), RecordError> {
    let stream = builder(recording.scene()).save(path)?;
    log_recording(recording, &stream)
}

/// Sends a recording to a running viewer, for instance at [`DEFAULT_URL`].
///
/// # Errors
/// If a body cannot be decoded or the viewer does not take it.
pub fn show(recording: &Recording, url: &str) -> Result<(), RecordError> {
    let stream = connect(recording.scene(), url)?;
    log_recording(recording, &stream)
}

/// Opens a stream to a running viewer for an episode that is still being driven.
///
/// # Errors
/// If the address is not one of a viewer.
pub fn connect(scene: &SceneMessage, url: &str) -> Result<RecordingStream, RecordError> {
    Ok(builder(scene).connect_grpc_opts(url)?)
}

/// Logs a whole recording and waits until it has been taken.
///
/// # Errors
/// If a body cannot be decoded or the stream does not take it.
pub fn log_recording(recording: &Recording, stream: &RecordingStream) -> Result<(), RecordError> {
    arrangement::send(recording.scene(), stream, &diagnosed(recording)?)?;
    let mut logger = Logger::new(recording.scene(), stream.clone())?;
    let mut messages: Vec<_> = recording.messages().collect();
    messages.sort_by_key(|envelope| (envelope.header.time, envelope.header.slot));
    messages.into_iter().try_for_each(|envelope| logger.log(envelope))?;
    flush(stream)
}

/// Returns the effects that the diagnoses of a recording name, in order; nothing where it holds none.
fn diagnosed(recording: &Recording) -> Result<Vec<String>, RecordError> {
    let mut named = BTreeSet::new();
    for envelope in recording.topic(Topic::Diagnosis) {
        let diagnosis: Diagnosis = recording.body(envelope.header.slot)?;
        named.extend(diagnosis.effects.into_iter().map(|effect| effect.id));
    }
    Ok(named.into_iter().collect())
}

fn builder(scene: &SceneMessage) -> RecordingStreamBuilder {
    let spec = &scene.spec;
    RecordingStreamBuilder::new(APPLICATION)
        .recording_id(spec.episode.as_str())
        .recording_name(format!("{} by {} on {}", spec.scenario, spec.policy, spec.observation.name()))
        .send_properties(true)
}

fn flush(stream: &RecordingStream) -> Result<(), RecordError> {
    stream.flush_blocking().map_err(|error| RecordError::Flush { reason: error.to_string() })
}
