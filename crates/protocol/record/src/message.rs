//! Messages of the recording and their bodies: the one place where this crate calls the wire.

use bytes::Bytes;
use ds_topic::Envelope;
use ds_wire::WireError;

use crate::error::RecordError;

pub use ds_wire::Body;

/// Reads the body of a message and compares it with its header.
pub(crate) fn body<B: Body>(envelope: &Envelope) -> Result<B, RecordError> {
    ds_wire::verify(envelope).map_err(|source| RecordError::Message { slot: envelope.header.slot, source })
}

/// Returns a message as it stands on the wire and in the file: the header, then the body.
pub(crate) fn wire_bytes(envelope: &Envelope) -> Bytes {
    ds_wire::encode(&envelope.header, &envelope.body)
}

/// Splits a message of the file into header and body.
pub(crate) fn envelope(bytes: Bytes) -> Result<Envelope, WireError> {
    ds_wire::split(bytes)
}
