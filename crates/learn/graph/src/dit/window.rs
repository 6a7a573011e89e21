//! Keys and values of chunks on the framework's device, and the window that a chunk reads: rotated and joined.

use std::sync::Arc;

use burn::tensor::Tensor;
use ds_nn::body::{Cached, FrameKv, Handle};
use ds_space::DigestWriter;

use super::Dit;
use crate::attention::Rotation;
use crate::graph::array_of;

/// Keys and values per layer, [1, rows, d].
type Layers = Vec<(Tensor<3>, Tensor<3>)>;

/// Keys (un-rotated) and values of one chunk.
pub(super) struct ChunkLayers {
    pub(super) layers: Layers,
    pub(super) frames: usize,
}

impl Cached for ChunkLayers {
    fn frames(&self) -> usize {
        self.frames
    }

    fn digest_into(&self, writer: &mut DigestWriter) {
        for tensor in self.layers.iter().flat_map(|(k, v)| [k, v]) {
            array_of(tensor.clone()).digest_into(writer);
        }
    }

    fn frame(self: Arc<Self>, index: usize) -> FrameKv {
        let part = |x: &Tensor<3>| {
            let [b, n, d] = x.dims();
            let n = n / self.frames;
            x.clone().slice([0..b, index * n..(index + 1) * n, 0..d])
        };
        let layers: Layers = self.layers.iter().map(|(k, v)| (part(k), part(v))).collect();
        FrameKv(Handle::new(layers))
    }
}

/// The rotated keys and the values that a chunk sees, and the rotation of the chunk itself.
pub(super) struct GraphWindow {
    layers: Layers,
    pub(super) current: Rotation,
}

impl GraphWindow {
    /// Reads frames at their positions.
    pub(super) fn read(dit: &Dit, frames: &[(&FrameKv, usize)], current: &[usize]) -> Self {
        let heads = dit.heads();
        let current = heads.rotation(&dit.graph, current);
        if frames.is_empty() {
            return Self { layers: Vec::new(), current };
        }
        let positions: Vec<usize> = frames.iter().map(|(_, position)| *position).collect();
        let rotation = heads.rotation(&dit.graph, &positions);
        let read = |layer: usize| {
            let pairs = || frames.iter().map(|(frame, _)| &frame.0.of::<Layers>()[layer]);
            let k = Tensor::cat(pairs().map(|(k, _)| k.clone()).collect(), 1);
            let v = Tensor::cat(pairs().map(|(_, v)| v.clone()).collect(), 1);
            (dit.graph.lower(rotation.apply(k)), v)
        };
        Self { layers: (0..dit.shape.layers).map(read).collect(), current }
    }

    /// Puts the cached keys and values of a layer in front of the chunk's own.
    pub(super) fn extend(&self, layer: usize, k: Tensor<3>, v: Tensor<3>) -> (Tensor<3>, Tensor<3>) {
        match self.layers.get(layer) {
            Some((cached_k, cached_v)) => {
                (Tensor::cat(vec![cached_k.clone(), k], 1), Tensor::cat(vec![cached_v.clone(), v], 1))
            }
            None => (k, v),
        }
    }
}
