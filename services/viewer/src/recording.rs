//! A whole recording in a stream of the viewer: messages by time, then by slot.

use std::collections::BTreeSet;
use std::path::Path;

use ds_record::Recording;
use ds_topic::{Diagnosis, Topic};
use rerun::RecordingStream;

use crate::logger::Logger;
use crate::stream::{builder, connect, flush};
use crate::{ViewError, arrangement};

/// Writes a recording to a file that the viewer opens; no display is needed.
///
/// # Errors
/// If a body cannot be decoded or the file not be written.
pub fn save_rrd(recording: &Recording, path: &Path) -> Result<(), ViewError> {
    let stream = builder(recording.scene()).save(path)?;
    log_recording(recording, &stream)
}

/// Sends a recording to a running viewer, for instance at `rerun+http://127.0.0.1:9876/proxy`.
///
/// # Errors
/// If a body cannot be decoded or the viewer does not take it.
pub fn show(recording: &Recording, url: &str) -> Result<(), ViewError> {
    let stream = connect(recording.scene(), url)?;
    log_recording(recording, &stream)
}

/// Logs a whole recording and waits until it has been taken.
///
/// # Errors
/// If a body cannot be decoded or the stream does not take it.
pub fn log_recording(recording: &Recording, stream: &RecordingStream) -> Result<(), ViewError> {
    arrangement::send(recording.scene(), stream, &diagnosed(recording)?)?;
    let mut logger = Logger::new(recording.scene(), stream.clone())?;
    let mut messages: Vec<_> = recording.messages().collect();
    messages.sort_by_key(|envelope| (envelope.header.time, envelope.header.slot));
    messages.into_iter().try_for_each(|envelope| logger.log(envelope))?;
    flush(stream)
}

/// Returns the effects that the diagnoses of a recording name, in order; nothing where it holds none.
fn diagnosed(recording: &Recording) -> Result<Vec<String>, ViewError> {
    let mut named = BTreeSet::new();
    for envelope in recording.topic(Topic::Diagnosis) {
        let diagnosis: Diagnosis = recording.body(envelope.header.slot)?;
        named.extend(diagnosis.effects.into_iter().map(|effect| effect.id));
    }
    Ok(named.into_iter().collect())
}
