//! The journal of one attempt: every committed message in an MCAP file, and what successors may ask for in memory.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use ds_episode::driver::Ending;
use ds_record::{Outcome, RecordError, Recorder, partial_path};
use ds_space::Digest;
use ds_topic::{Diagnosis, Envelope, Slot, Topic};

/// The journal cannot be written or gone on from.
#[derive(Debug, thiserror::Error)]
pub(crate) enum JournalError {
    #[error("journal")]
    Record(#[from] RecordError),
    #[error("folder {path:?} cannot be made")]
    Folder {
        path: PathBuf,
        #[source]
        source: std::io::Error,
    },
    #[error("the journal was lost with an earlier error")]
    Lost,
    #[error("a background task panicked")]
    Task(#[from] tokio::task::JoinError),
}

impl JournalError {
    /// Tells whether the file system failed, which is no fault of the drive.
    pub(crate) fn of_storage(&self) -> bool {
        match self {
            Self::Record(error) => error.of_storage(),
            Self::Folder { .. } => true,
            Self::Lost | Self::Task(_) => false,
        }
    }
}

/// A journal that grows.
pub(crate) struct Journal {
    recorder: Option<Recorder>,
    path: PathBuf,
    committed: BTreeMap<Slot, Envelope>,
    notes: Vec<Envelope>,
    /// Diagnoses that are written or noted.
    diagnosed: BTreeSet<Slot>,
    /// As in the episode's settings.
    layout_memory_ticks: u32,
}

/// What an interrupted attempt left.
pub(crate) struct Resumed {
    pub(crate) journal: Journal,
    pub(crate) iterations: u32,
    pub(crate) messages: Vec<Envelope>,
}

/// A journal that is complete.
pub(crate) struct Finished {
    pub(crate) path: PathBuf,
    /// Of `world`, `layout` and `frame`.
    pub(crate) digests: [Digest; 3],
}

impl Journal {
    /// Begins the journal of an attempt.
    pub(crate) async fn create(path: &Path, scene: Envelope, layout_memory_ticks: u32) -> Result<Self, JournalError> {
        let path = path.to_path_buf();
        let file = path.clone();
        let made = tokio::task::spawn_blocking(move || {
            let folder = file.parent().unwrap_or(Path::new("."));
            let failed = |source| JournalError::Folder { path: folder.to_path_buf(), source };
            std::fs::create_dir_all(folder).map_err(failed)?;
            Ok::<_, JournalError>(Recorder::create(&file, &scene)?)
        });
        let (committed, diagnosed) = (BTreeMap::new(), BTreeSet::new());
        let recorder = Some(made.await??);
        Ok(Self { recorder, path, committed, notes: Vec::new(), diagnosed, layout_memory_ticks })
    }

    /// Goes on with the journal of an attempt that was interrupted, if there is one of the same scene.
    pub(crate) async fn resume(
        path: &Path,
        scene: Digest,
        layout_memory_ticks: u32,
    ) -> Result<Option<Resumed>, JournalError> {
        let path = path.to_path_buf();
        if !partial_path(&path).exists() {
            return Ok(None);
        }
        let file = path.clone();
        let resumed = tokio::task::spawn_blocking(move || Recorder::resume(&file)).await?;
        let resumed = match resumed {
            Ok(resumed) if resumed.scene.header.content == scene => resumed,
            Ok(_) => return Ok(None),
            Err(error) if error.of_storage() => return Err(error.into()),
            Err(error) => {
                tracing::warn!(%error, "the interrupted journal is of no use; the attempt begins anew");
                return Ok(None);
            }
        };
        let iterations = u32::try_from(resumed.iterations.len()).unwrap_or(u32::MAX);
        let messages: Vec<Envelope> = resumed.iterations.into_iter().flatten().collect();
        let committed = messages.iter().map(|message| (message.header.slot, message.clone())).collect();
        let slots = messages.iter().map(|message| message.header.slot);
        let diagnosed = slots.filter(|slot| slot.topic == Topic::Diagnosis).collect();
        let (recorder, notes) = (Some(resumed.recorder), Vec::new());
        let journal = Self { recorder, path, committed, notes, diagnosed, layout_memory_ticks };
        Ok(Some(Resumed { journal, iterations, messages }))
    }

    /// Takes a message of the orchestrator's own for the next commit.
    pub(crate) fn note(&mut self, envelope: Envelope) {
        self.notes.push(envelope);
    }

    /// Takes a diagnosis that somebody put beside the drive: the first one of each window that can be read. What is
    /// passed over costs the episode nothing.
    pub(crate) fn hear(&mut self, envelope: Envelope) {
        let Slot { index, .. } = envelope.header.slot;
        let sound = index == envelope.header.tick.0 && ds_wire::verify::<Diagnosis>(&envelope).is_ok();
        if sound && self.diagnosed.insert(envelope.header.slot) {
            self.notes.push(envelope);
        } else {
            tracing::debug!(window = index, publisher = %envelope.header.publisher, "diagnosis passed over");
        }
    }

    /// Appends the messages of an iteration and syncs the file.
    pub(crate) async fn commit(&mut self, iteration: u32, messages: Vec<Envelope>) -> Result<(), JournalError> {
        for message in &messages {
            self.committed.insert(message.header.slot, message.clone());
        }
        let mut recorder = self.recorder.take().ok_or(JournalError::Lost)?;
        let notes = std::mem::take(&mut self.notes);
        let written = tokio::task::spawn_blocking(move || {
            recorder.append(&messages)?;
            recorder.append(&notes)?;
            recorder.commit(iteration)?;
            Ok::<_, RecordError>(recorder)
        });
        self.recorder = Some(written.await??);
        self.prune(iteration);
        Ok(())
    }

    /// Forgets images and states that no successor can ask for any more: those of iterations before the last few, and
    /// layouts that no video model remembers either.
    fn prune(&mut self, iteration: u32) {
        let keep_from = iteration.saturating_sub(KEPT_ITERATIONS);
        let bulky = |slot: &Slot| matches!(slot.topic, Topic::World | Topic::Ego | Topic::Layout | Topic::Frame);
        let kept = self.committed.values().filter(|message| message.header.iteration >= keep_from);
        let oldest = kept.map(|message| message.header.tick.0).min().unwrap_or_default();
        let layouts_from = oldest.saturating_sub(self.layout_memory_ticks);
        self.committed.retain(|slot, message| {
            let remembered = slot.topic == Topic::Layout && slot.index >= layouts_from;
            !bulky(slot) || message.header.iteration >= keep_from || remembered
        });
    }

    /// Returns a committed message.
    pub(crate) fn lookup(&self, slot: Slot) -> Option<Envelope> {
        self.committed.get(&slot).cloned()
    }

    /// Lists the committed plans, in order.
    pub(crate) fn plans(&self) -> impl Iterator<Item = &Envelope> {
        self.committed.values().filter(|message| message.header.slot.topic == Topic::Plan)
    }

    /// Writes the completeness record and gives the file its final name.
    pub(crate) async fn finish(mut self, ending: &Ending) -> Result<Finished, JournalError> {
        let mut recorder = self.recorder.take().ok_or(JournalError::Lost)?;
        let outcome = Outcome { status: ending.status.name().to_owned(), reason: ending.reason.clone() };
        let notes = std::mem::take(&mut self.notes);
        let finished = tokio::task::spawn_blocking(move || {
            recorder.append(&notes)?;
            recorder.finish(&outcome)
        });
        let digests = finished.await??.digests;
        Ok(Finished { path: self.path, digests: [digests.world, digests.layout, digests.frame] })
    }
}

/// Iterations whose images stay in memory; K and the chunk length are bounded by 64 ticks.
const KEPT_ITERATIONS: u32 = 65;
