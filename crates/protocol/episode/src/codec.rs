//! What the machines must read and write of bodies: the outline of a scene, orders, plans and events.
//!
//! The wire implements it in protobuf; tests implement it with plain tables. All other bodies stay opaque bytes.

use bytes::Bytes;
use ds_space::SimTime;
use ds_topic::{Advance, EpisodeSpec, Event, Plan};

/// What the protocol needs to know of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Outline {
    /// The settings of the episode.
    pub spec: EpisodeSpec,
    /// The number of cameras.
    pub cameras: u16,
    /// The length of a tick.
    pub dt: SimTime,
}

/// A body could not be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct CodecError(pub String);

/// Reads and writes the few bodies that the protocol looks into; `header.content` stays the caller's business.
pub trait Codec: Send + Sync {
    /// Reads the outline of a `scene` body.
    ///
    /// # Errors
    /// The text names the field and the value.
    fn outline(&self, scene: &Bytes) -> Result<Outline, CodecError>;

    /// Writes an `advance` body, owners included.
    fn encode_advance(&self, advance: &Advance) -> Bytes;

    /// Reads an `advance` body.
    ///
    /// # Errors
    /// The text names the field and the value.
    fn decode_advance(&self, body: &Bytes) -> Result<Advance, CodecError>;

    /// Reads and checks a `plan` body.
    ///
    /// # Errors
    /// The text names the field and the value.
    fn decode_plan(&self, body: &Bytes) -> Result<Plan, CodecError>;

    /// Writes an `event` body.
    fn encode_event(&self, event: &Event) -> Bytes;
}
