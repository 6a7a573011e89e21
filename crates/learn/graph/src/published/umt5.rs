//! The encoder of UMT5, which turns the tokens of a prompt into the states that Wan's transformer attends to.
//!
//! Gated feed-forward with the tanh GELU, RMS norms, attention without scaling and with a relative position bias of
//! its own in every layer. Only the tokens there are go through; states beyond them are zero, as Wan takes them. The
//! table of token embeddings stays in the mapped file.

use burn::tensor::{Tensor, activation};
use ds_nn::array::{Array, Declared, Initial};
use ds_nn::checkpoint::{Checkpoint, CheckpointError, Finite, Naming};

use crate::device::Precision;
use crate::graph::{Graph, Linear, Mode, array_of};

const EPSILON: f64 = 1e-6;
const TABLE: &str = "token_embedding.weight";

/// Sizes of the encoder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Umt5Shape {
    /// Tokens of the vocabulary.
    pub vocabulary: usize,
    /// Width.
    pub dim: usize,
    /// Width of all heads together.
    pub attention: usize,
    /// Heads.
    pub heads: usize,
    /// Width of the feed-forward.
    pub ffn: usize,
    /// Layers.
    pub layers: usize,
    /// Buckets of relative positions.
    pub buckets: usize,
    /// Distance from which positions share the last bucket.
    pub far: usize,
}

impl Umt5Shape {
    /// UMT5-XXL, the prompt encoder of Wan.
    pub const XXL: Self = Self {
        vocabulary: 256_384,
        dim: 4096,
        attention: 4096,
        heads: 64,
        ffn: 10_240,
        layers: 24,
        buckets: 32,
        far: 128,
    };

    /// Lists the weights.
    #[must_use]
    pub fn declare(&self) -> Vec<Declared> {
        let matrix = |name: String, outputs: usize, inputs: usize| {
            Declared::new(name, &[outputs, inputs], Initial::Normal(1.0 / (inputs as f32).sqrt()))
        };
        let norm = |name: String| Declared::new(name, &[self.dim], Initial::Constant(1.0));
        let mut list = vec![matrix(TABLE.to_owned(), self.vocabulary, self.dim), norm("norm.weight".to_owned())];
        for layer in 0..self.layers {
            let name = |part: &str| format!("blocks.{layer}.{part}.weight");
            list.extend([norm(name("norm1")), norm(name("norm2"))]);
            list.extend(["attn.q", "attn.k", "attn.v"].map(|part| matrix(name(part), self.attention, self.dim)));
            list.push(matrix(name("attn.o"), self.dim, self.attention));
            list.extend(["ffn.gate.0", "ffn.fc1"].map(|part| matrix(name(part), self.ffn, self.dim)));
            list.push(matrix(name("ffn.fc2"), self.dim, self.ffn));
            list.push(matrix(name("pos_embedding.embedding"), self.buckets, self.heads));
        }
        list
    }

    /// Returns the bucket of a key's position relative to the query's: half of the buckets for each direction, near
    /// distances one each, far ones by the logarithm.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a bucket is a small whole number")]
    fn bucket(&self, relative: isize) -> usize {
        let half = self.buckets / 2;
        let near = half / 2;
        let distance = relative.unsigned_abs();
        let within = if distance < near {
            distance
        } else {
            // In single precision, as the published code has it: the borders of buckets depend on it.
            let part = (distance as f32 / near as f32).ln() / (self.far as f64 / near as f64).ln() as f32;
            (near + (part * (half - near) as f32) as usize).min(half - 1)
        };
        within + if relative > 0 { half } else { 0 }
    }
}

struct Block {
    norms: [Tensor<1>; 2],
    attention: [Linear; 4],
    gate: Linear,
    up: Linear,
    down: Linear,
    bias: Array,
}

/// The encoder bound to the device, its token embeddings in the file.
pub struct Umt5 {
    shape: Umt5Shape,
    graph: Graph,
    file: Checkpoint,
    table: String,
    blocks: Vec<Block>,
    norm: Tensor<1>,
}

impl Umt5 {
    /// Binds a checkpoint.
    ///
    /// # Errors
    /// [`CheckpointError`] names the first weight that is wrong.
    pub fn load(
        shape: &Umt5Shape,
        file: Checkpoint,
        finite: Finite,
        precision: Precision,
    ) -> Result<Self, CheckpointError> {
        let mut graph = Graph::empty(Mode::Infer, precision);
        let mut fitted = file.fit(&shape.declare(), Naming::Umt5)?;
        let table = fitted.leave(TABLE).unwrap_or_default();
        let mut biases = Vec::new();
        fitted.each(finite, |name, array| {
            if name.contains("pos_embedding") {
                biases.push((name.to_owned(), array));
            } else {
                graph.bind(name, &array, if array.shape().len() > 1 { precision } else { Precision::F32 });
            }
        })?;
        let bias = |name: &str| biases.iter().find(|(found, _)| found == name).map(|(_, array)| array.clone());
        let block = |layer: usize| {
            let name = |part: &str| format!("blocks.{layer}.{part}");
            let norm = |part: &str| graph.weight::<1>(&name(&format!("{part}.weight")), [shape.dim]);
            Block {
                norms: [norm("norm1"), norm("norm2")],
                attention: ["attn.q", "attn.k", "attn.v", "attn.o"].map(|part| graph.linear(&name(part))),
                gate: graph.linear(&name("ffn.gate.0")),
                up: graph.linear(&name("ffn.fc1")),
                down: graph.linear(&name("ffn.fc2")),
                bias: bias(&name("pos_embedding.embedding.weight")).expect("it was fitted"),
            }
        };
        let blocks = (0..shape.layers).map(block).collect();
        let norm = graph.weight("norm.weight", [shape.dim]);
        graph.forget();
        drop(fitted);
        Ok(Self { shape: *shape, blocks, norm, table, graph, file })
    }

    /// Returns the states [1, length, dim] of tokens; states beyond the tokens are zero.
    ///
    /// # Errors
    /// If the table of embeddings cannot be read.
    ///
    /// # Panics
    /// If a token is beyond the vocabulary, or there are more than `length`.
    pub fn states(&self, tokens: &[u32], length: usize) -> Result<Array, CheckpointError> {
        let (n, d) = (tokens.len(), self.shape.dim);
        assert!(n <= length, "{n} tokens, at most {length} expected");
        let mut values = Vec::with_capacity(length * d);
        if n > 0 {
            let rows: Vec<usize> = tokens.iter().map(|token| *token as usize).collect();
            assert!(rows.iter().all(|row| *row < self.shape.vocabulary), "a token is beyond the vocabulary");
            let mut x = self.graph.tensor::<3>(&Array::new(&[1, n, d], self.file.rows(&self.table, &rows)?));
            for block in &self.blocks {
                x = self.block(block, x);
            }
            values.extend(array_of(norm(x, &self.norm)).into_values());
        }
        values.resize(length * d, 0.0);
        Ok(Array::new(&[1, length, d], values))
    }

    fn block(&self, block: &Block, x: Tensor<3>) -> Tensor<3> {
        let [_, n, _] = x.dims();
        let (heads, attention) = (self.shape.heads, self.shape.attention);
        let [q, k, v, o] = &block.attention;
        let y = norm(x.clone(), &block.norms[0]);
        let split = |layer: &Linear| layer.apply(y.clone()).reshape([1, n, heads, attention / heads]).swap_dims(1, 2);
        let scores = split(q).matmul(split(k).swap_dims(2, 3)) + self.bias(&block.bias, n);
        let y = activation::softmax(scores, 3).matmul(split(v)).swap_dims(1, 2).reshape([1, n, attention]);
        let x = x + o.apply(y);
        let y = norm(x.clone(), &block.norms[1]);
        x + block.down.apply(block.up.apply(y.clone()) * activation::gelu_approximate(block.gate.apply(y)))
    }

    /// Returns the position bias of a layer, [1, heads, n, n].
    fn bias(&self, table: &Array, n: usize) -> Tensor<4> {
        let heads = self.shape.heads;
        let mut values = vec![0.0; heads * n * n];
        for query in 0..n {
            for key in 0..n {
                let bucket = self.shape.bucket(key.cast_signed() - query.cast_signed());
                for head in 0..heads {
                    values[(head * n + query) * n + key] = table.values()[bucket * heads + head];
                }
            }
        }
        self.graph.tensor(&Array::new(&[1, heads, n, n], values))
    }
}

fn norm(x: Tensor<3>, weight: &Tensor<1>) -> Tensor<3> {
    let scale = (x.clone().powi_scalar(2).mean_dim(2) + EPSILON).sqrt().recip();
    x * scale * weight.clone().reshape([1, 1, -1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_published_tensors_are_asked_for() {
        let declared = Umt5Shape::XXL.declare();
        let parameters: usize = declared.iter().map(|weight| weight.shape.iter().product::<usize>()).sum();
        assert_eq!((declared.len(), parameters), (242, 5_680_910_336));
    }

    #[test]
    fn near_positions_have_buckets_of_their_own() {
        let bucket = |relative| Umt5Shape::XXL.bucket(relative);
        assert_eq!([0, -1, -7, -8, -16, -500].map(bucket), [0, 1, 7, 8, 10, 15]);
        assert_eq!([1, 7, 8, 127, 500].map(bucket), [17, 23, 24, 31, 31]);
    }
}
