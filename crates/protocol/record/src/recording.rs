//! Reads the journal of one attempt: file → messages by slot, bodies, digests, what is missing.
//!
//! Only committed messages are given out. A file that is not whole (cut, never completed, or with a byte that a checksum
//! does not know) is refused, unless the caller asks for what is there and then says so. The whole file is read into
//! memory (bounded, see [`MAX_RECORDING_BYTES`]); bodies are decoded when they are asked for.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::Read;
use std::path::Path;

use ds_space::{CameraId, PoseSe2, Tick};
use ds_topic::{Advance, Envelope, Frame, Layout, Plan, SceneMessage, Slot, Topic, World};
use ds_world::WorldState;

use crate::channel::ChannelKey;
use crate::checksum::{self, Present};
use crate::completeness::{self, Completeness, Missing};
use crate::digests::{Digests, StreamDigests};
use crate::error::RecordError;
use crate::message::{self, Body};
use crate::pictures::{Moment, Reel};
use crate::scan::{BEGIN, COMMIT, COMPLETE, MAX_RECORDING_BYTES, Scan, scan};

/// The committed part of a recording.
pub struct Recording {
    scene_envelope: Envelope,
    scene: SceneMessage,
    cameras: Vec<CameraId>,
    messages: BTreeMap<Slot, Envelope>,
    iterations: Vec<Vec<Slot>>,
    completeness: Option<Completeness>,
    tail: Tail,
    damage: Option<String>,
}

/// What came after the last mark of a file.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Tail {
    /// Messages that were written but not committed, and are therefore not given out.
    pub dropped: u64,
    /// Where (byte) and why reading stopped, if the file is cut or broken there.
    pub stopped: Option<(u64, String)>,
}

impl Recording {
    /// Reads a whole recording: complete, every checksum right.
    ///
    /// # Errors
    /// If it cannot be read, is not a recording, or is damaged or incomplete; the error says where and what is missing.
    pub fn open(path: &Path) -> Result<Self, RecordError> {
        Self::from_bytes(&read(path)?, path)
    }

    /// Reads what is there of a recording, be it complete (`.mcap`), partial (`.mcap.partial`), damaged or cut anywhere
    /// after its scene. Whoever shows what comes of it also shows [`Recording::damage`].
    ///
    /// # Errors
    /// If it cannot be read, is not a recording, or a committed message has no readable header.
    pub fn open_partial(path: &Path) -> Result<Self, RecordError> {
        Self::from_partial_bytes(&read(path)?, path)
    }

    /// Reads a whole recording that is already in memory; the path only names it in errors.
    ///
    /// # Errors
    /// As [`Recording::open`].
    pub fn from_bytes(bytes: &[u8], path: &Path) -> Result<Self, RecordError> {
        let recording = Self::from_partial_bytes(bytes, path)?;
        match recording.damage {
            Some(what) => Err(RecordError::Damaged { what, path: path.to_path_buf() }),
            None => Ok(recording),
        }
    }

    /// Reads what is there of a recording that is already in memory; the path only names it in errors.
    ///
    /// # Errors
    /// As [`Recording::open_partial`].
    pub fn from_partial_bytes(bytes: &[u8], path: &Path) -> Result<Self, RecordError> {
        let foreign = |what: &str| RecordError::Foreign { what: what.to_owned(), path: path.to_path_buf() };
        let Scan { segments, dropped, stopped } = scan(bytes, path)?;
        let mut messages = BTreeMap::new();
        let mut iterations: Vec<Vec<Slot>> = Vec::new();
        let mut completeness = None;
        for (index, segment) in segments.into_iter().enumerate() {
            if (index == 0) != (segment.mark.name == BEGIN) {
                return Err(foreign("a mark out of order"));
            }
            let slots = take(&mut messages, segment.messages)?;
            match segment.mark.name.as_str() {
                COMMIT => {
                    let expected = iterations.len().to_string();
                    if segment.mark.metadata.get("iteration") != Some(&expected) {
                        return Err(foreign("a commit out of order"));
                    }
                    iterations.push(slots);
                }
                COMPLETE => {
                    let record = Completeness::from_metadata(&segment.mark.metadata);
                    completeness = Some(record.map_err(|what| foreign(&what))?);
                }
                _ => {}
            }
        }
        let slot = Slot::new(Topic::Scene, 0);
        let scene_envelope = messages.get(&slot).cloned().ok_or_else(|| match &stopped {
            Some((byte, why)) => {
                RecordError::Unreadable { what: format!("byte {byte}: {why}"), path: path.to_path_buf() }
            }
            None => foreign("no scene before the first mark"),
        })?;
        let scene: SceneMessage = message::body(&scene_envelope)?;
        let cameras = scene.scene.cameras.iter().map(|camera| camera.id.clone()).collect();
        let tail = Tail { dropped, stopped };
        let mut recording =
            Self { scene_envelope, scene, cameras, messages, iterations, completeness, tail, damage: None };
        recording.damage = recording.inspect(checksum::verify(bytes));
        Ok(recording)
    }

    /// Says why the file is not whole, given what its checksums say; `None` if it is.
    fn inspect(&self, checksums: Result<Present, String>) -> Option<String> {
        let fault = match (&self.tail.stopped, checksums) {
            (Some((byte, why)), _) => format!("byte {byte}: {why}"),
            (None, _) if self.completeness.is_none() => "the drive was not recorded to its end".to_owned(),
            (None, Err(why)) => why,
            (None, Ok(Present::Some)) => "it has no checksum over all its data".to_owned(),
            (None, Ok(Present::All)) => return None,
        };
        let lacking = if self.completeness.is_none() { self.missing().unwrap_or_default() } else { Vec::new() };
        let all = std::iter::once(fault).chain(lacking.iter().map(ToString::to_string));
        Some(all.collect::<Vec<_>>().join("; "))
    }

    /// Returns the scene.
    #[must_use]
    pub fn scene(&self) -> &SceneMessage {
        &self.scene
    }

    /// Returns the scene as it travelled.
    #[must_use]
    pub fn scene_envelope(&self) -> &Envelope {
        &self.scene_envelope
    }

    /// Returns the cameras, in index order.
    #[must_use]
    pub fn cameras(&self) -> &[CameraId] {
        &self.cameras
    }

    /// Returns the completeness record; `None` if the attempt never ended.
    #[must_use]
    pub fn completeness(&self) -> Option<&Completeness> {
        self.completeness.as_ref()
    }

    /// Returns why the file is not whole: where reading stopped, which checksum fails, what is missing; `None` if it is.
    #[must_use]
    pub fn damage(&self) -> Option<&str> {
        self.damage.as_deref()
    }

    /// Returns what came after the last mark.
    #[must_use]
    pub fn tail(&self) -> &Tail {
        &self.tail
    }

    /// Returns the messages of each committed iteration, in slot order.
    pub fn iterations(&self) -> impl Iterator<Item = impl Iterator<Item = &Envelope>> {
        self.iterations.iter().map(|slots| slots.iter().filter_map(|slot| self.messages.get(slot)))
    }

    /// Returns all messages, sorted by slot.
    pub fn messages(&self) -> impl Iterator<Item = &Envelope> {
        self.messages.values()
    }

    /// Returns the messages of a topic, sorted by index and camera.
    pub fn topic(&self, topic: Topic) -> impl DoubleEndedIterator<Item = &Envelope> {
        let (first, last) = (Slot::new(topic, 0), Slot::of_camera(topic, u32::MAX, u16::MAX));
        self.messages.range(first..=last).map(|(_, envelope)| envelope)
    }

    /// Returns the message of a slot.
    #[must_use]
    pub fn get(&self, slot: Slot) -> Option<&Envelope> {
        self.messages.get(&slot)
    }

    /// Decodes the body of a slot.
    ///
    /// # Errors
    /// If there is no such message or it cannot be decoded.
    pub fn body<B: Body>(&self, slot: Slot) -> Result<B, RecordError> {
        message::body(self.get(slot).ok_or(RecordError::Lacking { slot })?)
    }

    /// Decodes the world state of a tick.
    ///
    /// # Errors
    /// As [`Recording::body`].
    pub fn world(&self, tick: Tick) -> Result<WorldState, RecordError> {
        self.body::<World>(Slot::new(Topic::World, tick.0)).map(|world| world.state)
    }

    /// Returns the digests of the world, layout and frame streams.
    ///
    /// # Errors
    /// If a body cannot be decoded.
    pub fn digests(&self) -> Result<Digests, RecordError> {
        let mut digests = StreamDigests::default();
        self.messages().try_for_each(|envelope| digests.add(envelope))?;
        Ok(digests.finish())
    }

    /// Compares what is there with what the specification asks for; empty if nothing is missing.
    ///
    /// Which iterations end with a plan is taken from the recorded work orders; for those that are not there it is
    /// derived from the specification (from the end of the warm-up to the last but one).
    ///
    /// # Errors
    /// If a work order cannot be decoded.
    pub fn missing(&self) -> Result<Vec<Missing>, RecordError> {
        let spec = &self.scene.spec;
        let mut plans: BTreeSet<u32> = (spec.warm_up..spec.iterations().saturating_sub(1)).collect();
        for envelope in self.topic(Topic::Advance) {
            let order: Advance = message::body(envelope)?;
            if order.plan_due {
                plans.insert(order.iteration);
            } else {
                plans.remove(&order.iteration);
            }
        }
        let mut present: BTreeMap<ChannelKey, BTreeSet<u32>> = BTreeMap::new();
        for Slot { topic, index, camera } in self.messages.keys() {
            present.entry(ChannelKey { topic: *topic, camera: *camera }).or_default().insert(*index);
        }
        Ok(completeness::missing(spec, &self.cameras, &plans, &present))
    }

    /// Returns the drive, ready to be drawn; it has a moment for each recorded world state.
    ///
    /// # Errors
    /// If a world state cannot be decoded.
    pub fn reel(&self) -> Result<Reel<'_>, RecordError> {
        let (mut path, mut ticks) = (Vec::new(), Vec::new());
        for envelope in self.topic(Topic::World) {
            path.push(message::body::<World>(envelope)?.state.ego.pose.position);
            ticks.push(Tick(envelope.header.slot.index));
        }
        let moment = Box::new(move |index: usize| {
            let slot = Slot::new(Topic::World, u32::try_from(index).unwrap_or(u32::MAX));
            self.moment(*ticks.get(index).ok_or(RecordError::Lacking { slot })?)
        });
        Ok(Reel { scene: &self.scene.scene, path, moment })
    }

    /// Decodes what a picture of a tick is made of.
    ///
    /// # Errors
    /// If there is no world state of this tick or a body cannot be decoded.
    pub fn moment(&self, tick: Tick) -> Result<Moment, RecordError> {
        let state = self.world(tick)?;
        let (mut layouts, mut frames) = (Vec::new(), Vec::new());
        for camera in 0..u16::try_from(self.cameras.len()).unwrap_or(u16::MAX) {
            if let Some(layout) = self.get(Slot::of_camera(Topic::Layout, tick.0, camera)) {
                layouts.push(message::body::<Layout>(layout)?.image);
            }
            if let Some(frame) = self.get(Slot::of_camera(Topic::Frame, tick.0, camera)) {
                frames.push(message::body::<Frame>(frame)?.image);
            }
        }
        Ok(Moment { state, layouts, frames, plan: self.plan_at(tick)? })
    }

    /// Decodes the newest plan made at or before a tick, with the rig's pose when it was made.
    fn plan_at(&self, tick: Tick) -> Result<Option<(PoseSe2, Plan)>, RecordError> {
        let newest = self.topic(Topic::Plan).rev().find(|envelope| envelope.header.tick <= tick);
        let Some(envelope) = newest else { return Ok(None) };
        let made_at = self.world(envelope.header.tick)?.ego.pose;
        Ok(Some((made_at, message::body(envelope)?)))
    }
}

/// Splits messages into header and body; returns their slots in order.
fn take(
    into: &mut BTreeMap<Slot, Envelope>,
    messages: Vec<(ChannelKey, bytes::Bytes)>,
) -> Result<Vec<Slot>, RecordError> {
    let mut slots = Vec::with_capacity(messages.len());
    for (index, (channel, bytes)) in messages.into_iter().enumerate() {
        let envelope = message::envelope(bytes).map_err(|source| RecordError::Envelope {
            channel: channel.topic.name().to_owned(),
            index: index as u64,
            source,
        })?;
        let slot = envelope.header.slot;
        match into.get(&slot) {
            Some(there) if there.header.content != envelope.header.content => {
                return Err(RecordError::Divergent { slot });
            }
            Some(_) => {}
            None => {
                slots.push(slot);
                into.insert(slot, envelope);
            }
        }
    }
    slots.sort_unstable();
    Ok(slots)
}

fn read(path: &Path) -> Result<Vec<u8>, RecordError> {
    let error = |source| RecordError::File { action: "read", path: path.to_path_buf(), source };
    let mut file = File::open(path).map_err(error)?;
    let found = file.metadata().map_err(error)?.len();
    if found > MAX_RECORDING_BYTES {
        return Err(RecordError::TooLarge { found, limit: MAX_RECORDING_BYTES });
    }
    let mut bytes = Vec::with_capacity(usize::try_from(found).unwrap_or_default());
    file.read_to_end(&mut bytes).map_err(error)?;
    Ok(bytes)
}
