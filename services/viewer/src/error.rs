//! What can go wrong when something is shown.

use ds_topic::Slot;

/// Says why something cannot be shown.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// The recording cannot be read.
    #[error("recording cannot be read")]
    Recording(#[from] ds_record::RecordError),
    /// A message cannot be decoded.
    #[error("message {slot} cannot be decoded")]
    Message {
        /// The slot.
        slot: Slot,
        /// Why.
        #[source]
        source: ds_wire::WireError,
    },
    /// An image cannot be encoded.
    #[error("picture cannot be encoded")]
    Picture(#[from] ds_raster::ImageError),
    /// A picture that is to be shown cannot be read.
    #[error("cannot read {path:?}")]
    File {
        /// The file.
        path: std::path::PathBuf,
        /// Why.
        #[source]
        source: std::io::Error,
    },
    /// The viewer's library refuses.
    #[error("viewer data cannot be written")]
    Stream(#[from] rerun::RecordingStreamError),
    /// The viewer's data could not be flushed.
    #[error("viewer data was not flushed: {reason}")]
    Flush {
        /// What the library says.
        reason: String,
    },
}
