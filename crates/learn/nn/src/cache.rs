//! The cache of keys and values: a permanent sink of the first frames and a ring of the newest ones.
//!
//! Keys are kept un-rotated (after their norm); reading rotates them, by default at positions relative to the
//! window: sink first, past next, the current chunk last. Frames stay where they were written; the ring overwrites the
//! oldest. Every commit extends a digest over all keys and values since the start of the rollout.

use std::sync::Arc;

use ds_space::{Digest, DigestWriter};

use crate::array::Array;
use crate::body::{ChunkKv, FrameKv, Transformer, Window};

/// Where cached keys stand in time when they are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Positions {
    /// At their place in the window.
    #[default]
    CacheRelative,
    /// At their index since the start of the rollout.
    Absolute,
}

/// In which order cached frames are read; attention does not depend on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ReadOrder {
    /// As they lie in the ring.
    #[default]
    Slot,
    /// Oldest first, as if the buffer were shifted at each eviction.
    Age,
}

/// Sizes and policy of a cache.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CachePolicy {
    /// Frames that a chunk sees: sink, past and itself.
    pub window: usize,
    /// First frames that are never dropped.
    pub sink: usize,
    /// Frames denoised together.
    pub chunk: usize,
    /// Positions of cached keys.
    pub positions: Positions,
    /// Reading order.
    pub order: ReadOrder,
}

/// The frames of earlier chunks that a chunk sees.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Visible {
    /// Number of sink frames, from frame 0.
    pub(crate) sink: usize,
    /// Frames after the sink, oldest first.
    pub(crate) past: std::ops::Range<usize>,
    /// Frames that were dropped between sink and past.
    pub(crate) evicted: usize,
}

impl Visible {
    /// Says what a chunk of `chunk` frames beginning at frame `start` sees within a window of `window` frames, the
    /// first `sink` frames of the rollout and the chunk itself included.
    pub(crate) fn of(start: usize, chunk: usize, window: usize, sink: usize) -> Self {
        let sink = sink.min(start);
        let past = (start - sink).min(window.saturating_sub(sink + chunk));
        Self { sink, past: start - past..start, evicted: start - sink - past }
    }
}

#[derive(Clone)]
struct Slot {
    frame: usize,
    kv: FrameKv,
}

/// The cache of one rollout. A clone shares all tensors and costs a few pointers per frame.
#[derive(Clone)]
pub struct KvCache {
    policy: CachePolicy,
    written: usize,
    sink: Vec<Slot>,
    ring: Vec<Slot>,
    next: usize,
    digest: Digest,
}

impl KvCache {
    /// Makes an empty cache.
    #[must_use]
    pub fn new(policy: CachePolicy) -> Self {
        Self { policy, written: 0, sink: Vec::new(), ring: Vec::new(), next: 0, digest: Digest::default() }
    }

    /// Returns the number of frames written since the start of the rollout.
    #[must_use]
    pub fn written(&self) -> usize {
        self.written
    }

    /// Returns the digest over all that was ever committed, in order.
    #[must_use]
    pub fn digest(&self) -> Digest {
        self.digest
    }

    /// Appends a chunk; frames beyond the window fall out.
    pub fn commit(&mut self, chunk: &ChunkKv) {
        self.extend(|writer| chunk.0.digest_into(writer));
        self.append(chunk);
    }

    /// As [`Self::commit`], but the output of the pass that made the keys and values stands for them in the digest: it
    /// depends on all of them, and they stay on the device.
    pub fn commit_by(&mut self, chunk: &ChunkKv, output: &Array) {
        self.extend(|writer| output.digest_into(writer));
        self.append(chunk);
    }

    fn extend(&mut self, add: impl FnOnce(&mut DigestWriter)) {
        let mut writer = DigestWriter::new();
        writer.digest(&self.digest);
        add(&mut writer);
        self.digest = writer.finish();
    }

    /// As [`Self::commit`], but leaves the digest behind: nothing is read back from the device.
    pub fn append(&mut self, chunk: &ChunkKv) {
        let capacity = self.policy.window.saturating_sub(self.policy.sink + self.policy.chunk);
        for index in 0..chunk.0.frames() {
            let slot = Slot { frame: self.written, kv: Arc::clone(&chunk.0).frame(index) };
            self.written += 1;
            if self.sink.len() < self.policy.sink {
                self.sink.push(slot);
            } else if self.ring.len() < capacity {
                self.ring.push(slot);
            } else if capacity > 0 {
                self.ring[self.next] = slot;
                self.next = (self.next + 1) % capacity;
            }
        }
    }

    /// Reads the window of the next chunk of `frames` frames: rotates cached keys at their positions.
    #[must_use]
    pub fn window(&self, dit: &dyn Transformer, frames: usize) -> Window {
        let visible = Visible::of(self.written, frames, self.policy.window, self.policy.sink);
        let mut slots: Vec<&Slot> = self.sink.iter().chain(&self.ring).collect();
        if self.policy.order == ReadOrder::Age {
            slots.sort_by_key(|slot| slot.frame);
        }
        slots.retain(|slot| slot.frame < visible.sink || visible.past.contains(&slot.frame));
        let evicted = match self.policy.positions {
            Positions::CacheRelative => visible.evicted,
            Positions::Absolute => 0,
        };
        let place = |frame: usize| if frame < visible.sink { frame } else { frame - evicted };
        let current: Vec<usize> = (0..frames).map(|index| place(self.written + index)).collect();
        let cached: Vec<(&FrameKv, usize)> = slots.iter().map(|slot| (&slot.kv, place(slot.frame))).collect();
        dit.window(&cached, &current)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(input: (usize, usize, usize, usize), expected: (usize, std::ops::Range<usize>, usize)) {
        let visible = Visible::of(input.0, input.1, input.2, input.3);
        assert_eq!((visible.sink, visible.past, visible.evicted), expected, "Visible::of{input:?}");
    }

    #[test]
    fn the_window_holds_sink_past_and_current() {
        check((0, 1, 8, 1), (0, 0..0, 0));
        check((1, 1, 8, 1), (1, 1..1, 0));
        check((7, 1, 8, 1), (1, 1..7, 0));
        check((8, 1, 8, 1), (1, 2..8, 1));
        check((10, 3, 9, 3), (3, 7..10, 4));
        check((2, 1, 2, 1), (1, 2..2, 1));
    }
}
