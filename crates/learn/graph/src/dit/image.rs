//! CLIP states of the first frame in the transformer: their embedding and, per block, keys and values of their own.

use burn::tensor::{Tensor, activation, module};
use ds_nn::dit::DitShape;

use super::modulation::rms_norm;
use crate::graph::{Graph, Linear};

/// Epsilon of the two norms, the default of the framework in which the weights were trained.
const EPSILON: f64 = 1e-5;

/// LayerNorm, linear, exact GELU, linear, LayerNorm.
pub(super) struct ImageEmbedding {
    norms: [[Tensor<1>; 2]; 2],
    layers: [Linear; 2],
}

impl ImageEmbedding {
    pub(super) fn new(graph: &Graph, shape: &DitShape) -> Self {
        let norm = |index: usize, width: usize| {
            ["weight", "bias"].map(|part| graph.weight::<1>(&format!("img_emb.proj.{index}.{part}"), [width]))
        };
        Self {
            norms: [norm(0, shape.clip_dim), norm(4, shape.dim)],
            layers: ["img_emb.proj.1", "img_emb.proj.3"].map(|name| graph.linear(name)),
        }
    }

    pub(super) fn apply(&self, states: Tensor<3>) -> Tensor<3> {
        let norm = |x, index: usize| {
            let [weight, bias] = self.norms[index].clone();
            module::layer_norm(x, weight, Some(bias), EPSILON)
        };
        let y = activation::gelu(self.layers[0].apply(norm(states, 0)));
        norm(self.layers[1].apply(y), 1)
    }
}

/// Keys and values of CLIP states in a block.
pub(super) struct ImageKv {
    k: Linear,
    v: Linear,
    norm: Tensor<1>,
}

impl ImageKv {
    pub(super) fn new(graph: &Graph, name: &str, dim: usize) -> Self {
        Self {
            k: graph.linear(&format!("{name}.k_img")),
            v: graph.linear(&format!("{name}.v_img")),
            norm: graph.weight(&format!("{name}.norm_k_img.weight"), [dim]),
        }
    }

    pub(super) fn apply(&self, states: Tensor<3>) -> (Tensor<3>, Tensor<3>) {
        (rms_norm(self.k.apply(states.clone()), &self.norm), self.v.apply(states))
    }
}
