//! A viewer that is fed while the episode is driven, and never holds it up.
//!
//! Messages go through a bounded queue to a thread of the view's own; when the queue is full the newest message is
//! dropped and counted. A message that cannot be decoded is counted and passed over.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

use ds_topic::{Envelope, SceneMessage};
use rerun::RecordingStream;

use crate::stream::flush;
use crate::{Logger, ViewError, arrangement};

/// What became of the messages that a live view was fed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LiveCounts {
    /// Messages that reached the viewer's stream.
    pub logged: u64,
    /// Messages dropped because the view was behind.
    pub dropped: u64,
    /// Messages that could not be decoded.
    pub refused: u64,
}

/// Feeds one episode's messages to a viewer.
pub struct LiveView {
    queue: Option<SyncSender<Envelope>>,
    dropped: Arc<AtomicU64>,
    thread: Option<JoinHandle<Result<LiveCounts, ViewError>>>,
}

impl LiveView {
    /// Starts a view of an episode; at most `capacity` messages wait. `effects` are those that a running diagnosis may
    /// name, nothing where there is none.
    ///
    /// # Errors
    /// If the stream does not take the scene.
    pub fn start(
        scene: &SceneMessage,
        stream: RecordingStream,
        capacity: usize,
        effects: &[String],
    ) -> Result<Self, ViewError> {
        arrangement::send(scene, &stream, effects)?;
        let logger = Logger::new(scene, stream.clone())?;
        let (queue, inbox) = sync_channel(capacity.max(1));
        let thread = std::thread::spawn(move || show(logger, &inbox, &stream));
        Ok(Self { queue: Some(queue), dropped: Arc::new(AtomicU64::new(0)), thread: Some(thread) })
    }

    /// Hands a message over if there is room; says whether it was taken. Never waits.
    pub fn feed(&self, envelope: Envelope) -> bool {
        let taken = self.queue.as_ref().is_some_and(|queue| queue.try_send(envelope).is_ok());
        if !taken {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
        taken
    }

    /// Waits until what was taken has been shown.
    ///
    /// # Errors
    /// If the viewer's stream broke.
    pub fn finish(mut self) -> Result<LiveCounts, ViewError> {
        self.queue = None;
        let shown = match self.thread.take().map(JoinHandle::join) {
            Some(Ok(shown)) => shown?,
            Some(Err(_)) | None => return Err(ViewError::Flush { reason: "the view's thread broke".to_owned() }),
        };
        Ok(LiveCounts { dropped: self.dropped.load(Ordering::Relaxed), ..shown })
    }
}

impl Drop for LiveView {
    fn drop(&mut self) {
        self.queue = None;
        if let Some(thread) = self.thread.take() {
            drop(thread.join());
        }
    }
}

fn show(mut logger: Logger, inbox: &Receiver<Envelope>, stream: &RecordingStream) -> Result<LiveCounts, ViewError> {
    let mut shown = LiveCounts::default();
    for envelope in inbox {
        match logger.log(&envelope) {
            Ok(()) => shown.logged += 1,
            Err(ViewError::Message { .. } | ViewError::Picture(_)) => shown.refused += 1,
            Err(error) => return Err(error),
        }
    }
    flush(stream)?;
    Ok(shown)
}
