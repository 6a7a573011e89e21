//! Writes the journal of one attempt as MCAP: messages → one file, closed and synced at every commit.
//!
//! While it grows the file is named `….mcap.partial`; [`Recorder::finish`] writes the completeness record and renames it
//! to `….mcap`. Messages are held back until their commit and written in time and slot order, so that the file depends
//! on what was said, not on when it arrived. Log time and publish time are simulation time in nanoseconds.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use ds_space::{CameraId, Digest};
use ds_topic::{Envelope, SceneMessage, Slot, Topic};
use mcap::records::{MessageHeader, Metadata};
use mcap::{Compression, WriteOptions, Writer};

use crate::channel::ChannelKey;
use crate::completeness::Completeness;
use crate::digests::{Digests, StreamDigests};
use crate::error::RecordError;
use crate::message;
use crate::recording::Recording;
use crate::scan::{BEGIN, CLOSES, COMMIT, COMPLETE};
use crate::schema::Schemas;

/// A chunk is closed at each commit, and earlier if it grows beyond this.
const CHUNK_BYTES: u64 = 4 << 20;

/// The journal of one attempt while it is written.
pub struct Recorder {
    path: PathBuf,
    partial: PathBuf,
    cameras: Vec<CameraId>,
    sink: Option<Sink>,
    pending: BTreeMap<Slot, Envelope>,
    contents: BTreeMap<Slot, Digest>,
    counts: BTreeMap<ChannelKey, u64>,
    digests: StreamDigests,
    next: u32,
}

/// What an interrupted attempt left behind.
pub struct Resumed {
    /// Goes on after the last committed iteration.
    pub recorder: Recorder,
    /// The scene.
    pub scene: Envelope,
    /// The messages of each committed iteration, in slot order.
    pub iterations: Vec<Vec<Envelope>>,
}

/// How an attempt ended.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Outcome {
    /// `completed`, `failed` or `aborted`.
    pub status: String,
    /// Why; empty if there is nothing to say.
    pub reason: String,
}

struct Sink {
    writer: Option<Writer<BufWriter<File>>>,
    file: File,
    channels: BTreeMap<ChannelKey, u16>,
}

impl Drop for Sink {
    /// Leaves the file as it is: dropping the writer itself would write a summary after uncommitted data.
    fn drop(&mut self) {
        if let Some(writer) = self.writer.take() {
            drop(writer.into_inner());
        }
    }
}

/// Returns the name that a recording bears until it is complete.
#[must_use]
pub fn partial_path(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".partial");
    PathBuf::from(name)
}

/// Returns what is wrong with the recording of a drive, finished or not; nothing where there is none, which was moved or
/// stayed with its fleet.
#[must_use]
pub fn damage(path: &Path) -> Option<String> {
    let unfinished = partial_path(path);
    if path.exists() {
        Recording::open(path).err().map(|error| error.to_string())
    } else if unfinished.exists() {
        let damage = Recording::open(&unfinished).err().map(|error| error.to_string());
        Some(damage.unwrap_or_else(|| format!("{} bears the name of an unfinished one", unfinished.display())))
    } else {
        None
    }
}

/// Leaves only the scene and the messages of some topics in a finished recording, in one step. Status, iterations and the
/// digests of its streams stay those of the whole drive.
///
/// # Errors
/// If the recording is damaged or not finished, or cannot be written; then it stays as it is.
pub fn thin(path: &Path, topics: &[Topic]) -> Result<(), RecordError> {
    let whole = Recording::open(path)?;
    let unfinished = || RecordError::Foreign { what: "no completeness record".to_owned(), path: path.to_path_buf() };
    let told = whole.completeness().ok_or_else(unfinished)?;
    let outcome = Outcome { status: told.status.clone(), reason: told.reason.clone() };
    let stays = |envelope: &&Envelope| topics.contains(&envelope.header.slot.topic);
    let iterations: Vec<Vec<Envelope>> =
        whole.iterations().map(|messages| messages.filter(stays).cloned().collect()).collect();
    let mut recorder = Recorder::create(path, whole.scene_envelope())?.copy(&iterations)?;
    let all: Vec<Envelope> = whole.messages().filter(stays).cloned().collect();
    recorder.append(&all)?;
    recorder.end(&outcome, Some(told.digests)).map(drop)
}

impl Recorder {
    /// Begins the recording `path` (`….mcap`) with its scene, which is synced to disk before this returns.
    /// A partial recording of the same name is replaced; see [`Recorder::resume`].
    ///
    /// # Errors
    /// If the scene cannot be decoded or the file not be written.
    pub fn create(path: &Path, scene: &Envelope) -> Result<Self, RecordError> {
        Self::create_at(path, partial_path(path), scene)
    }

    fn copy(mut self, iterations: &[Vec<Envelope>]) -> Result<Self, RecordError> {
        for (iteration, messages) in iterations.iter().enumerate() {
            self.append(messages)?;
            self.commit(u32::try_from(iteration).unwrap_or(u32::MAX))?;
        }
        Ok(self)
    }

    fn create_at(path: &Path, partial: PathBuf, scene: &Envelope) -> Result<Self, RecordError> {
        let decoded: SceneMessage = message::body(scene)?;
        let cameras: Vec<CameraId> = decoded.scene.cameras.iter().map(|camera| camera.id.clone()).collect();
        let mut recorder = Self {
            path: path.to_path_buf(),
            partial,
            cameras,
            sink: None,
            pending: BTreeMap::new(),
            contents: BTreeMap::new(),
            counts: BTreeMap::new(),
            digests: StreamDigests::default(),
            next: 0,
        };
        recorder.sink = Some(Sink::open(&recorder.partial, &recorder.cameras)?);
        recorder.append(std::slice::from_ref(scene))?;
        let entry = |key: &str, value: String| (key.to_owned(), value);
        let head = &scene.header;
        let metadata = [
            entry("episode", head.episode.to_string()),
            entry("attempt", head.attempt.to_string()),
            entry("scenario", decoded.spec.scenario.clone()),
            entry("schema_version", head.schema_version.to_string()),
        ];
        recorder.close(BEGIN, BTreeMap::from(metadata))?;
        sync_folder(&recorder.partial)?;
        Ok(recorder)
    }

    /// Takes up an interrupted recording: its committed part is copied to a fresh file, which then replaces the
    /// interrupted one in one step; what was not committed is gone.
    ///
    /// # Errors
    /// If there is no partial recording, it is complete, or it cannot be read or written.
    pub fn resume(path: &Path) -> Result<Resumed, RecordError> {
        let partial = partial_path(path);
        let old = Recording::open_partial(&partial)?;
        if old.completeness().is_some() {
            return Err(RecordError::Complete { path: partial });
        }
        let scene = old.scene_envelope().clone();
        let mut fresh = partial.as_os_str().to_owned();
        fresh.push(".new");
        let fresh = PathBuf::from(fresh);
        let iterations: Vec<Vec<Envelope>> = old.iterations().map(|messages| messages.cloned().collect()).collect();
        let copied = Self::create_at(path, fresh.clone(), &scene).and_then(|recorder| recorder.copy(&iterations));
        let mut recorder = copied.inspect_err(|_| {
            // Half a copy is of no use, and its bytes are needed.
            drop(fs::remove_file(&fresh));
        })?;
        let error = |source| RecordError::File { action: "replace", path: partial.clone(), source };
        fs::rename(&recorder.partial, &partial).map_err(error)?;
        sync_folder(&partial)?;
        recorder.partial = partial;
        Ok(Resumed { recorder, scene, iterations })
    }

    /// Takes messages for the next commit. A message that is there already with equal content is passed over.
    ///
    /// # Errors
    /// If a message differs from the one of its slot, or names a camera that the scene does not have. Then none of the
    /// messages after it is taken.
    pub fn append(&mut self, messages: &[Envelope]) -> Result<(), RecordError> {
        for envelope in messages {
            let slot = envelope.header.slot;
            let cameras = if slot.topic.per_camera() { self.cameras.len() } else { 1 };
            if usize::from(slot.camera) >= cameras {
                return Err(RecordError::Camera { slot, cameras });
            }
            match self.contents.get(&slot) {
                Some(content) if *content == envelope.header.content => {}
                Some(_) => return Err(RecordError::Divergent { slot }),
                None => {
                    self.contents.insert(slot, envelope.header.content);
                    self.pending.insert(slot, envelope.clone());
                }
            }
        }
        Ok(())
    }

    /// Commits the messages taken since the last commit as those of an iteration: closes the chunk, writes the mark,
    /// and syncs the file. After this returns a killed process loses nothing of them.
    ///
    /// # Errors
    /// If the iteration is not the next one, a message cannot be decoded, or the file cannot be written; after a failed
    /// write the recorder refuses everything.
    pub fn commit(&mut self, iteration: u32) -> Result<(), RecordError> {
        if iteration != self.next {
            return Err(RecordError::Order { found: iteration, expected: self.next });
        }
        self.close(COMMIT, BTreeMap::from([("iteration".to_owned(), iteration.to_string())]))?;
        self.next += 1;
        Ok(())
    }

    /// Returns the next iteration to commit.
    #[must_use]
    pub fn next_iteration(&self) -> u32 {
        self.next
    }

    /// Writes what is left and the completeness record, and gives the file its final name.
    ///
    /// # Errors
    /// If a message cannot be decoded or the file not be written.
    pub fn finish(self, outcome: &Outcome) -> Result<Completeness, RecordError> {
        self.end(outcome, None)
    }

    /// Finishes; the completeness record tells other digests than those of the messages where some are given.
    fn end(mut self, outcome: &Outcome, told: Option<Digests>) -> Result<Completeness, RecordError> {
        let written = self.write_pending()?;
        let messages = self.counts.iter().map(|(channel, count)| (channel.name(&self.cameras), *count)).collect();
        let completeness = Completeness {
            status: outcome.status.clone(),
            reason: outcome.reason.clone(),
            iterations: self.next,
            messages,
            digests: told.unwrap_or_else(|| self.digests.finish()),
        };
        self.mark(COMPLETE, completeness.to_metadata(), written)?;
        self.with_sink(Sink::end)?;
        let error = |source| RecordError::File { action: "rename", path: self.partial.clone(), source };
        fs::rename(&self.partial, &self.path).map_err(error)?;
        sync_folder(&self.path)?;
        Ok(completeness)
    }

    fn close(&mut self, mark: &str, metadata: BTreeMap<String, String>) -> Result<(), RecordError> {
        let written = self.write_pending()?;
        self.mark(mark, metadata, written)
    }

    /// Writes a mark, which says how many messages it closes.
    fn mark(&mut self, name: &str, mut metadata: BTreeMap<String, String>, closes: usize) -> Result<(), RecordError> {
        metadata.insert(CLOSES.to_owned(), closes.to_string());
        let mark = Metadata { name: name.to_owned(), metadata };
        self.with_sink(|sink| sink.mark(&mark))
    }

    /// Writes the pending messages and returns how many they were.
    fn write_pending(&mut self) -> Result<usize, RecordError> {
        let mut digests = self.digests.clone();
        for envelope in self.pending.values() {
            digests.add(envelope)?;
        }
        self.digests = digests;
        let mut messages: Vec<Envelope> = std::mem::take(&mut self.pending).into_values().collect();
        messages.sort_by_key(|envelope| (envelope.header.time, envelope.header.slot));
        for envelope in &messages {
            let Slot { topic, camera, .. } = envelope.header.slot;
            let channel = ChannelKey { topic, camera };
            self.with_sink(|sink| sink.message(channel, envelope))?;
            *self.counts.entry(channel).or_default() += 1;
        }
        Ok(messages.len())
    }

    /// Writes; a failure gives the file up, for what then is in it is not known.
    fn with_sink(&mut self, write: impl FnOnce(&mut Sink) -> mcap::McapResult<()>) -> Result<(), RecordError> {
        let sink = self.sink.as_mut().ok_or_else(|| RecordError::GivenUp { path: self.partial.clone() })?;
        write(sink).map_err(|source| {
            self.sink = None;
            RecordError::Write { path: self.partial.clone(), source }
        })
    }
}

impl Sink {
    fn open(path: &Path, cameras: &[CameraId]) -> Result<Self, RecordError> {
        let file_error = |source| RecordError::File { action: "create", path: path.to_path_buf(), source };
        let file = File::create(path).map_err(file_error)?;
        let handle = file.try_clone().map_err(file_error)?;
        let write_error = |source| RecordError::Write { path: path.to_path_buf(), source };
        // Chunks are buffered and written whole; compression runs on one thread and gives the same bytes every time.
        let writer = WriteOptions::new()
            .library(concat!("dreamstream ", env!("CARGO_PKG_VERSION")))
            .compression(Some(Compression::Zstd))
            .compression_level(1)
            .compression_threads(0)
            .chunk_size(Some(CHUNK_BYTES))
            .disable_seeking(true)
            .create(BufWriter::new(file))
            .map_err(write_error)?;
        let mut sink = Self { writer: Some(writer), file: handle, channels: BTreeMap::new() };
        sink.add_channels(cameras).map_err(write_error)?;
        Ok(sink)
    }

    fn writer(&mut self) -> mcap::McapResult<&mut Writer<BufWriter<File>>> {
        self.writer.as_mut().ok_or(mcap::McapError::AttemptedWriteAfterFailure)
    }

    fn add_channels(&mut self, cameras: &[CameraId]) -> mcap::McapResult<()> {
        let schemas = Schemas::read(ds_wire::DESCRIPTOR_SET);
        let mut ids: BTreeMap<Topic, u16> = BTreeMap::new();
        for topic in Topic::ALL {
            let name = ds_wire::message_name(topic);
            let schema = schemas.of_message(name).unwrap_or_default();
            ids.insert(topic, self.writer()?.add_schema(name, "protobuf", &schema)?);
        }
        for key in ChannelKey::all(cameras) {
            let schema = ids.get(&key.topic).copied().unwrap_or_default();
            let id = self.writer()?.add_channel(schema, &key.name(cameras), "protobuf", &key.metadata())?;
            self.channels.insert(key, id);
        }
        Ok(())
    }

    fn message(&mut self, channel: ChannelKey, envelope: &Envelope) -> mcap::McapResult<()> {
        let channel_id = self.channels.get(&channel).copied().unwrap_or_default();
        let time = u64::try_from(envelope.header.time.0).unwrap_or_default();
        let sequence = (envelope.header.sequence & u64::from(u32::MAX)) as u32;
        let header = MessageHeader { channel_id, sequence, log_time: time, publish_time: time };
        self.writer()?.write_to_known_channel(&header, &message::wire_bytes(envelope))
    }

    /// Closes the chunk, writes a mark and syncs.
    fn mark(&mut self, mark: &Metadata) -> mcap::McapResult<()> {
        let writer = self.writer()?;
        writer.write_metadata(mark)?;
        writer.flush()?;
        Ok(self.file.sync_data()?)
    }

    fn end(&mut self) -> mcap::McapResult<()> {
        self.writer()?.finish()?;
        if let Some(writer) = self.writer.take() {
            writer.into_inner().into_inner().map_err(|error| error.into_error())?;
        }
        Ok(self.file.sync_all()?)
    }
}

/// Syncs the folder of a file, so that its name survives a crash of the machine.
fn sync_folder(path: &Path) -> Result<(), RecordError> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let error = |source| RecordError::File { action: "sync", path: folder.to_path_buf(), source };
    File::open(folder).and_then(|folder| folder.sync_all()).map_err(error)
}
