//! Headers, and messages as a header in front of an undecoded body.
//!
//! Protobuf fields may stand in any order, but this wire puts the header first, so that a stage reads it without
//! looking at the body; a message that does not begin with it is refused. A header without a content digest, as a stage
//! of another language may send it, gets the one of its body when it is read.

use bytes::{BufMut, Bytes, BytesMut};
use ds_space::{AttemptId, Digest, EpisodeId, InstanceId, SimTime, Tick};
use ds_topic::{
    Advance, Cache, Diagnosis, Ego, Envelope, Event, Frame, Header, Layout, Plan, SceneMessage, Score, Slot, Topic,
    World,
};
use prost::Message;
use prost::encoding::{decode_varint, encode_varint, encoded_len_varint};

use crate::body::{Body, max_bytes};
use crate::error::{FieldError, WireError};
use crate::field::{checked, choice, digest, enumeration, part, text, whole};
use crate::v1;

/// The longest header, in bytes.
pub const MAX_HEADER_BYTES: usize = 2_048;
/// The longest trace context, in bytes.
pub const MAX_TRACE_BYTES: usize = 256;
/// The key of field 1, length-delimited.
const HEADER_KEY: u8 = 0x0a;

enumeration!(v1::Topic, Topic, {
    Scene = Scene, Advance = Advance, World = World, Ego = Ego, Layout = Layout, Frame = Frame, Cache = Cache,
    Plan = Plan, Score = Score, Event = Event, Diagnosis = Diagnosis,
});

impl From<&Header> for v1::Header {
    fn from(value: &Header) -> Self {
        Self {
            episode: value.episode.as_str().to_owned(),
            attempt: value.attempt.0,
            term: value.term,
            epoch: value.epoch,
            iteration: value.iteration,
            tick: value.tick.0,
            time_ns: value.time.0,
            sequence: value.sequence,
            publisher: value.publisher.as_str().to_owned(),
            schema_version: value.schema_version,
            trace: value.trace.clone(),
            slot: Some(v1::Slot {
                topic: v1::Topic::from(value.slot.topic).into(),
                index: value.slot.index,
                camera: value.slot.camera.into(),
            }),
            content: value.content.0.to_vec().into(),
        }
    }
}

impl TryFrom<v1::Slot> for Slot {
    type Error = FieldError;
    fn try_from(message: v1::Slot) -> Result<Self, FieldError> {
        let topic: Topic = choice::<v1::Topic, _>("topic", message.topic)?;
        let most = if topic.per_camera() { u32::from(u16::MAX) } else { 0 };
        let camera = whole("camera", message.camera, 0, most)?;
        Ok(Self { topic, index: message.index, camera: u16::try_from(camera).unwrap_or(u16::MAX) })
    }
}

impl TryFrom<v1::Header> for Header {
    type Error = FieldError;
    fn try_from(message: v1::Header) -> Result<Self, FieldError> {
        if message.schema_version == 0 {
            return Err(FieldError::new("schema_version", "is 0"));
        }
        Ok(Self {
            episode: checked("episode", EpisodeId::new(&message.episode))?,
            attempt: AttemptId(message.attempt),
            term: message.term,
            epoch: message.epoch,
            iteration: message.iteration,
            tick: Tick(message.tick),
            time: SimTime(message.time_ns),
            sequence: message.sequence,
            publisher: checked("publisher", InstanceId::new(&message.publisher))?,
            schema_version: message.schema_version,
            trace: text("trace", message.trace, MAX_TRACE_BYTES)?,
            slot: part("slot", message.slot)?,
            content: digest("content", &message.content)?,
        })
    }
}

/// Puts a header in front of a body.
#[must_use]
pub fn encode(header: &Header, body: &[u8]) -> Bytes {
    let header = v1::Header::from(header);
    let length = header.encoded_len();
    let prefix = 1 + encoded_len_varint(length as u64);
    let mut bytes = BytesMut::with_capacity(prefix + length + body.len());
    bytes.put_u8(HEADER_KEY);
    encode_varint(length as u64, &mut bytes);
    header.encode(&mut bytes).expect("the buffer grows as needed");
    bytes.put_slice(body);
    bytes.freeze()
}

/// Reads the header of a message and leaves its body as it is, without copying it.
///
/// # Errors
/// [`WireError`] if the message does not begin with a sound header, or is longer than its topic allows.
pub fn split(bytes: Bytes) -> Result<Envelope, WireError> {
    const MESSAGE: &str = "header";
    let refuse = |problem: &str| WireError::Decode { message: MESSAGE, problem: problem.to_owned() };
    let Some((&HEADER_KEY, mut rest)) = bytes.split_first() else {
        return Err(refuse("the message does not begin with one"));
    };
    let length = decode_varint(&mut rest).map_err(|error| refuse(&error.to_string()))?;
    let length = usize::try_from(length).unwrap_or(usize::MAX);
    if length > MAX_HEADER_BYTES {
        return Err(WireError::TooLong { message: MESSAGE, bytes: length, most: MAX_HEADER_BYTES });
    }
    if length > rest.len() {
        return Err(refuse("the message ends inside it"));
    }
    let start = bytes.len() - rest.len();
    let message = v1::Header::decode(&rest[..length]).map_err(|error| refuse(&error.to_string()))?;
    let undigested = message.content.is_empty();
    let message = if undigested { v1::Header { content: vec![0; 32].into(), ..message } } else { message };
    let mut header = Header::try_from(message).map_err(|error| error.of(MESSAGE))?;
    let body = bytes.slice(start + length..);
    let topic = header.slot.topic;
    if body.len() > max_bytes(topic) {
        return Err(WireError::TooLong { message: topic.name(), bytes: body.len(), most: max_bytes(topic) });
    }
    if undigested {
        header.content = content_of(topic, &body)?;
    }
    Ok(Envelope { header, body })
}

/// Returns the digest over the fields of a body that its publisher did not digest.
fn content_of(topic: Topic, body: &[u8]) -> Result<Digest, WireError> {
    fn of<B: Body>(body: &[u8]) -> Result<Digest, WireError> {
        B::from_bytes(body).map(|read| read.content())
    }
    match topic {
        Topic::Scene => of::<SceneMessage>(body),
        Topic::Advance => of::<Advance>(body),
        Topic::World => of::<World>(body),
        Topic::Ego => of::<Ego>(body),
        Topic::Layout => of::<Layout>(body),
        Topic::Frame => of::<Frame>(body),
        Topic::Cache => of::<Cache>(body),
        Topic::Plan => of::<Plan>(body),
        Topic::Score => of::<Score>(body),
        Topic::Event => of::<Event>(body),
        Topic::Diagnosis => of::<Diagnosis>(body),
    }
}

/// Returns the full protobuf name of a topic's message.
#[must_use]
pub fn message_name(topic: Topic) -> &'static str {
    match topic {
        Topic::Scene => "dreamstream.v1.Scene",
        Topic::Advance => "dreamstream.v1.Advance",
        Topic::World => "dreamstream.v1.World",
        Topic::Ego => "dreamstream.v1.Ego",
        Topic::Layout => "dreamstream.v1.Layout",
        Topic::Frame => "dreamstream.v1.Frame",
        Topic::Cache => "dreamstream.v1.Cache",
        Topic::Plan => "dreamstream.v1.Plan",
        Topic::Score => "dreamstream.v1.Score",
        Topic::Event => "dreamstream.v1.Event",
        Topic::Diagnosis => "dreamstream.v1.Diagnosis",
    }
}
