//! Digests of whole topic streams, by which two drives are compared.
//!
//! BLAKE3 over the payload fields without headers, per tick in order and camera in order, of the accepted message of
//! each tick; images as width, height and raw RGB rows. Encodings, publishers and attempts never matter.

use ds_space::{Digest, DigestWriter};
use ds_topic::{Envelope, Frame, Layout, Topic, World};

use crate::error::RecordError;
use crate::message;

/// The digests of the three streams that a drive is compared by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Digests {
    /// Of the world states.
    pub world: Digest,
    /// Of the layouts.
    pub layout: Digest,
    /// Of the frames.
    pub frame: Digest,
}

/// Takes messages in tick and camera order and digests the streams; topics without a digest are passed over.
#[derive(Default, Clone)]
pub struct StreamDigests {
    world: DigestWriter,
    layout: DigestWriter,
    frame: DigestWriter,
}

impl StreamDigests {
    /// Adds the next message of its topic.
    ///
    /// # Errors
    /// If its body cannot be decoded.
    pub fn add(&mut self, envelope: &Envelope) -> Result<(), RecordError> {
        match envelope.header.slot.topic {
            Topic::World => message::body::<World>(envelope)?.digest_into(&mut self.world),
            Topic::Layout => message::body::<Layout>(envelope)?.digest_into(&mut self.layout),
            Topic::Frame => message::body::<Frame>(envelope)?.digest_into(&mut self.frame),
            _ => {}
        }
        Ok(())
    }

    /// Returns the digests of what was added so far.
    #[must_use]
    pub fn finish(&self) -> Digests {
        Digests { world: self.world.finish(), layout: self.layout.finish(), frame: self.frame.finish() }
    }
}
