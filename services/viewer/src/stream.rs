//! Streams of the viewer: to a file or to a running window.
//!
//! One timeline, `sim_time`.

use ds_topic::SceneMessage;
use rerun::{RecordingStream, RecordingStreamBuilder};

use crate::ViewError;

/// The name under which the viewer lists recordings.
pub const APPLICATION: &str = "dreamstream";
/// The timeline.
pub const TIMELINE: &str = "sim_time";
/// Where a viewer on the same machine listens by default.
pub const DEFAULT_URL: &str = rerun::DEFAULT_CONNECT_URL;

/// Opens a stream to a running viewer for an episode that is still being driven.
///
/// # Errors
/// If the address is not one of a viewer.
pub fn connect(scene: &SceneMessage, url: &str) -> Result<RecordingStream, ViewError> {
    Ok(builder(scene).connect_grpc_opts(url)?)
}

/// Returns what opens streams of an episode.
pub(crate) fn builder(scene: &SceneMessage) -> RecordingStreamBuilder {
    let spec = &scene.spec;
    RecordingStreamBuilder::new(APPLICATION)
        .recording_id(spec.episode.as_str())
        .recording_name(format!("{} by {} on {}", spec.scenario, spec.policy, spec.observation.name()))
        .send_properties(true)
}

/// Waits until a stream has been taken.
pub(crate) fn flush(stream: &RecordingStream) -> Result<(), ViewError> {
    stream.flush_blocking().map_err(|error| ViewError::Flush { reason: error.to_string() })
}
