//! Payloads as `Bytes` without copying where they lie in one piece.

use bytes::Bytes;
use zenoh::bytes::ZBytes;

struct OnePiece(ZBytes);

impl AsRef<[u8]> for OnePiece {
    fn as_ref(&self) -> &[u8] {
        self.0.slices().next().unwrap_or(&[])
    }
}

/// Returns a payload's bytes; those of a large message that came in fragments are copied together.
pub(crate) fn bytes_of(payload: ZBytes) -> Bytes {
    match payload.slices().count() {
        0 => Bytes::new(),
        1 => Bytes::from_owner(OnePiece(payload)),
        _ => Bytes::from(payload.to_bytes().into_owned()),
    }
}
