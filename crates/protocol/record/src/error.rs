//! What can go wrong when a recording is written or read; the offending value is part of the text.

use std::io;
use std::path::PathBuf;

use ds_topic::Slot;

/// Says why a recording cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The file system refuses.
    #[error("cannot {action} {path:?}")]
    File {
        /// What was being done.
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// Why.
        #[source]
        source: io::Error,
    },
    /// The container refuses what was to be written.
    #[error("cannot write to recording {path:?}")]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        #[source]
        source: mcap::McapError,
    },
    /// The file is not a recording of this project.
    #[error("not a recording: {what} in {path:?}")]
    Foreign {
        /// What is missing or odd.
        what: String,
        /// The file.
        path: PathBuf,
    },
    /// The recording is not whole.
    #[error("recording is damaged or incomplete: {what}, in {path:?}")]
    Damaged {
        /// Where it breaks and what is missing.
        what: String,
        /// The file.
        path: PathBuf,
    },
    /// The recording is damaged before its scene ends.
    #[error("recording is damaged before its scene ends, nothing of it can be read: {what}, in {path:?}")]
    Unreadable {
        /// Where it breaks.
        what: String,
        /// The file.
        path: PathBuf,
    },
    /// The recording is larger than this reader takes.
    #[error("recording holds {found} bytes, the limit is {limit}")]
    TooLarge {
        /// What was found or announced.
        found: u64,
        /// The limit.
        limit: u64,
    },
    /// Two messages of one slot differ.
    #[error("two messages of {slot} differ")]
    Divergent {
        /// The slot.
        slot: Slot,
    },
    /// A message names a camera that the scene does not have.
    #[error("message {slot} names a camera, the scene has {cameras}")]
    Camera {
        /// The slot.
        slot: Slot,
        /// How many cameras there are.
        cameras: usize,
    },
    /// An iteration is committed out of order.
    #[error("iteration {found} cannot be committed, {expected} is next")]
    Order {
        /// The iteration that was given.
        found: u32,
        /// The one that is due.
        expected: u32,
    },
    /// The recording is complete; there is nothing to go on with.
    #[error("recording {path:?} is complete")]
    Complete {
        /// The file.
        path: PathBuf,
    },
    /// The recording was given up after a failed write.
    #[error("recording {path:?} was given up after a failed write")]
    GivenUp {
        /// The file.
        path: PathBuf,
    },
    /// A message cannot be decoded.
    #[error("message {slot} cannot be decoded")]
    Message {
        /// The slot.
        slot: Slot,
        /// Why.
        #[source]
        source: ds_wire::WireError,
    },
    /// A message of the file has no readable header.
    #[error("message {index} of channel {channel:?} cannot be read")]
    Envelope {
        /// The channel.
        channel: String,
        /// Its place among the channel's messages.
        index: u64,
        /// Why.
        #[source]
        source: ds_wire::WireError,
    },
    /// The recording lacks a message that is asked for.
    #[error("recording has no {slot}")]
    Lacking {
        /// The slot.
        slot: Slot,
    },
    /// An image cannot be encoded.
    #[error("picture cannot be encoded")]
    Picture(#[from] ds_raster::ImageError),
    /// An animation cannot be encoded.
    #[error("animation cannot be encoded")]
    Animation(#[from] gif::EncodingError),
}

impl RecordError {
    /// Tells whether the file system failed, such as on a full disk, and not the content.
    #[must_use]
    pub fn of_storage(&self) -> bool {
        matches!(self, Self::File { .. } | Self::Write { .. } | Self::GivenUp { .. })
    }
}
