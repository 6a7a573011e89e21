//! A message in transit: its header and its undecoded body.

use bytes::Bytes;
use ds_space::{AttemptId, Digest, EpisodeId, InstanceId, SimTime, Tick};

use crate::slot::Slot;

/// The version of the topic schemas.
pub const SCHEMA_VERSION: u32 = 1;

/// What stands in front of every message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Header {
    /// The episode.
    pub episode: EpisodeId,
    /// The attempt at it.
    pub attempt: AttemptId,
    /// The orchestrator's term under which it was made.
    pub term: u64,
    /// The epoch of the publisher's role; receivers refuse any other than the assigned one.
    pub epoch: u64,
    /// The iteration in which it was made.
    pub iteration: u32,
    /// The tick that it describes.
    pub tick: Tick,
    /// The simulation time of that tick.
    pub time: SimTime,
    /// Counts the publisher's messages in this episode, from 0.
    pub sequence: u64,
    /// Who published it.
    pub publisher: InstanceId,
    /// [`SCHEMA_VERSION`] of the publisher.
    pub schema_version: u32,
    /// W3C trace context, empty if there is none.
    pub trace: String,
    /// The message's place in the episode.
    pub slot: Slot,
    /// Digest over the decoded fields of the body in a fixed order.
    pub content: Digest,
}

/// A header and the encoded body; cheap to clone.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Envelope {
    /// The header.
    pub header: Header,
    /// The body's fields in protobuf encoding, without the header.
    pub body: Bytes,
}
