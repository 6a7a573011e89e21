//! The cache of keys and values: a permanent sink of the first frames and a ring of the newest ones.
//!
//! Keys are kept un-rotated (after their norm); reading rotates them, by default at positions relative to the
//! window: sink first, past next, the current chunk last. Frames stay where they were written; the ring overwrites the
//! oldest. Every commit extends a digest over all keys and values since the start of the rollout.

use std::sync::Arc;

use burn::tensor::Tensor;
use ds_space::{Digest, DigestWriter};

use crate::array::Array;
use crate::attention::{Rotation, Visible};
use crate::body::{Held, Transformer};
use crate::dit::Dit;
use crate::fast::buffer::Pooled;
use crate::fast::{Captured, FrameRows, Sight};
use crate::graph::array_of;

/// Keys and values per layer, [1, rows, d], on the framework's device.
type Pairs = Vec<(Tensor<3>, Tensor<3>)>;

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

/// Keys and values of one chunk, keys un-rotated.
#[derive(Clone)]
pub struct ChunkKv {
    pub(crate) held: Held<Pairs, Arc<Captured>>,
    pub(crate) frames: usize,
}

/// Keys and values of one frame of a chunk.
#[derive(Clone)]
pub struct FrameKv(pub(crate) Held<Pairs, FrameRows>);

impl ChunkKv {
    fn digest_into(&self, writer: &mut DigestWriter) {
        match &self.held {
            Held::Graph(layers) => {
                for tensor in layers.iter().flat_map(|(k, v)| [k, v]) {
                    array_of(tensor.clone()).digest_into(writer);
                }
            }
            Held::Fast(captured) => captured.digest_into(writer),
        }
    }

    /// Returns the digest of all keys and values of the chunk.
    #[must_use]
    pub fn digest(&self) -> Digest {
        let mut writer = DigestWriter::new();
        self.digest_into(&mut writer);
        writer.finish()
    }

    fn frame(&self, index: usize) -> FrameKv {
        match &self.held {
            Held::Graph(layers) => {
                let part = |x: &Tensor<3>| {
                    let [b, n, d] = x.dims();
                    let n = n / self.frames;
                    x.clone().slice([0..b, index * n..(index + 1) * n, 0..d])
                };
                FrameKv(Held::Graph(layers.iter().map(|(k, v)| (part(k), part(v))).collect()))
            }
            Held::Fast(captured) => FrameKv(Held::Fast(FrameRows::new(captured, index))),
        }
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
        self.extend(|writer| chunk.digest_into(writer));
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
        for index in 0..chunk.frames {
            let slot = Slot { frame: self.written, kv: chunk.frame(index) };
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

/// The rotated keys and the values that a chunk sees, and the rotation of the chunk itself.
pub struct Window(pub(crate) Held<GraphWindow, Pooled<Sight>>);

/// A window on the framework's device.
pub(crate) struct GraphWindow {
    layers: Pairs,
    pub(crate) current: Rotation,
}

impl Window {
    pub(crate) fn of_graph(dit: &Dit, frames: &[(&FrameKv, usize)], current: &[usize]) -> Self {
        let heads = dit.shape.heads();
        let current = heads.rotation(&dit.graph, current);
        if frames.is_empty() {
            return Self(Held::Graph(GraphWindow { layers: Vec::new(), current }));
        }
        let positions: Vec<usize> = frames.iter().map(|(_, position)| *position).collect();
        let rotation = heads.rotation(&dit.graph, &positions);
        let read = |layer: usize| {
            let pairs = || frames.iter().map(|(frame, _)| &frame.0.graph()[layer]);
            let k = Tensor::cat(pairs().map(|(k, _)| k.clone()).collect(), 1);
            let v = Tensor::cat(pairs().map(|(_, v)| v.clone()).collect(), 1);
            (dit.graph.lower(rotation.apply(k)), v)
        };
        Self(Held::Graph(GraphWindow { layers: (0..dit.shape.layers).map(read).collect(), current }))
    }
}

impl GraphWindow {
    /// Puts the cached keys and values of a layer in front of the chunk's own.
    pub(crate) fn extend(&self, layer: usize, k: Tensor<3>, v: Tensor<3>) -> (Tensor<3>, Tensor<3>) {
        match self.layers.get(layer) {
            Some((cached_k, cached_v)) => {
                (Tensor::cat(vec![cached_k.clone(), k], 1), Tensor::cat(vec![cached_v.clone(), v], 1))
            }
            None => (k, v),
        }
    }
}
