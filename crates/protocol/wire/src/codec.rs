//! The protocol's view of bodies in protobuf: outlines, orders, plans and events.

use bytes::Bytes;
use ds_episode::{Codec, CodecError, Outline};
use ds_topic::{Advance, Event, Plan, SceneMessage};

use crate::body::Body;
use crate::error::WireError;

/// Reads and writes the bodies that the protocol looks into.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct WireCodec;

fn refused(error: WireError) -> CodecError {
    CodecError(error.to_string())
}

impl Codec for WireCodec {
    fn outline(&self, scene: &Bytes) -> Result<Outline, CodecError> {
        let message = SceneMessage::from_bytes(scene).map_err(refused)?;
        let cameras = u16::try_from(message.scene.cameras.len()).unwrap_or(u16::MAX);
        Ok(Outline { dt: message.scene.dt, spec: message.spec, cameras })
    }

    fn encode_advance(&self, advance: &Advance) -> Bytes {
        advance.to_bytes()
    }

    fn decode_advance(&self, body: &Bytes) -> Result<Advance, CodecError> {
        Advance::from_bytes(body).map_err(refused)
    }

    fn decode_plan(&self, body: &Bytes) -> Result<Plan, CodecError> {
        Plan::from_bytes(body).map_err(refused)
    }

    fn encode_event(&self, event: &Event) -> Bytes {
        event.to_bytes()
    }
}
