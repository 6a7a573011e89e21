//! The patch diffusion transformer with a timestep per latent frame, in the layer order and weight naming of Wan.
//!
//! Tokens are 2×2 patches of latent pixels; a frame of `grid_h`×`grid_w` tokens comes as [tokens, 4 pixels, channels]
//! with pixels in row-major order inside the patch. The input is the concatenation noisy ++ control ++ start along
//! channels; control is a linear map of the space-to-depth layout. Time, modulation and norms are f32. The
//! feed-forward uses the exact GELU. Cross-attention to the context sits in every `cross_every`-th block.

use std::sync::atomic::{AtomicU64, Ordering};

use burn::tensor::{Tensor, activation, module};

use crate::array::{Array, Declared, Initial, Weights, WeightsError};
use crate::attention::{Heads, Rotation};
use crate::cache::{ChunkKv, Window};
use crate::graph::{Graph, Linear, Mode, array_of};

const EPSILON: f64 = 1e-6;

/// Sizes of the transformer.
#[derive(Debug, Clone, PartialEq)]
pub struct DitShape {
    /// Blocks.
    pub layers: usize,
    /// Model width.
    pub dim: usize,
    /// Attention heads.
    pub heads: usize,
    /// Feed-forward width.
    pub ffn: usize,
    /// Latent channels.
    pub latent_channels: usize,
    /// Values per latent pixel of the space-to-depth layout.
    pub control_inputs: usize,
    /// Channels of the control latent.
    pub control_channels: usize,
    /// Width of the sinusoidal time embedding.
    pub freq_dim: usize,
    /// Width of a prompt token.
    pub text_dim: usize,
    /// Prompt tokens; 0 leaves the context out.
    pub text_len: usize,
    /// Whether the first frame's tokens join the context.
    pub image_context: bool,
    /// Whether the start latent stands in every frame, or in the first alone.
    pub start_every: bool,
    /// Every how many blocks cross-attention sits.
    pub cross_every: usize,
    /// Token rows of a frame.
    pub grid_h: usize,
    /// Token columns of a frame.
    pub grid_w: usize,
}

impl DitShape {
    /// Returns the tokens of a frame.
    #[must_use]
    pub fn tokens(&self) -> usize {
        self.grid_h * self.grid_w
    }

    /// Returns the input channels of a latent pixel.
    #[must_use]
    pub fn in_dim(&self) -> usize {
        2 * self.latent_channels + self.control_channels
    }

    pub(crate) fn heads(&self) -> Heads {
        Heads { heads: self.heads, head_dim: self.dim / self.heads, grid_h: self.grid_h, grid_w: self.grid_w }
    }

    fn crosses(&self, layer: usize) -> bool {
        (self.text_len > 0 || self.image_context) && layer.is_multiple_of(self.cross_every)
    }

    /// Lists the weights.
    #[must_use]
    pub fn declare(&self) -> Vec<Declared> {
        let (d, mut list) = (self.dim, Vec::new());
        Declared::linear(&mut list, "control_embedding", self.control_inputs, self.control_channels, 1.0);
        let patch = 1.0 / ((4 * self.in_dim()) as f32).sqrt();
        list.push(Declared::new("patch_embedding.weight", &[d, self.in_dim(), 1, 2, 2], Initial::Normal(patch)));
        list.push(Declared::new("patch_embedding.bias", &[d], Initial::Constant(0.0)));
        Declared::linear(&mut list, "time_embedding.0", self.freq_dim, d, 1.0);
        Declared::linear(&mut list, "time_embedding.2", d, d, 1.0);
        Declared::linear(&mut list, "time_projection.1", d, 6 * d, 0.1);
        if self.text_len > 0 {
            Declared::linear(&mut list, "text_embedding.0", self.text_dim, d, 1.0);
            Declared::linear(&mut list, "text_embedding.2", d, d, 1.0);
        }
        if self.image_context {
            Declared::linear(&mut list, "img_emb.proj.1", 4 * self.latent_channels, d, 1.0);
        }
        for layer in 0..self.layers {
            self.declare_block(&mut list, layer);
        }
        Declared::linear(&mut list, "head.head", d, 4 * self.latent_channels, 0.1);
        list.push(Declared::new("head.modulation", &[1, 2, d], Initial::Constant(0.0)));
        list
    }

    fn declare_block(&self, list: &mut Vec<Declared>, layer: usize) {
        let d = self.dim;
        let name = |part: &str| format!("blocks.{layer}.{part}");
        let attention = |list: &mut Vec<Declared>, kind: &str| {
            for part in ["q", "k", "v"] {
                Declared::linear(list, &name(&format!("{kind}.{part}")), d, d, 1.0);
            }
            Declared::linear(list, &name(&format!("{kind}.o")), d, d, 0.3);
            for part in ["norm_q", "norm_k"] {
                list.push(Declared::new(name(&format!("{kind}.{part}.weight")), &[d], Initial::Constant(1.0)));
            }
        };
        list.push(Declared::new(name("modulation"), &[1, 6, d], Initial::Gates));
        attention(list, "self_attn");
        if self.crosses(layer) {
            list.push(Declared::new(name("norm3.weight"), &[d], Initial::Constant(1.0)));
            list.push(Declared::new(name("norm3.bias"), &[d], Initial::Constant(0.0)));
            attention(list, "cross_attn");
        }
        Declared::linear(list, &name("ffn.0"), d, self.ffn, 1.0);
        Declared::linear(list, &name("ffn.2"), self.ffn, d, 0.3);
    }
}

struct Attention {
    q: Linear,
    k: Linear,
    v: Linear,
    o: Linear,
    norm_q: Tensor<1>,
    norm_k: Tensor<1>,
}

impl Attention {
    fn new(graph: &Graph, name: &str, dim: usize) -> Self {
        let linear = |part: &str| graph.linear(&format!("{name}.{part}"));
        Self {
            q: linear("q"),
            k: linear("k"),
            v: linear("v"),
            o: linear("o"),
            norm_q: graph.weight(&format!("{name}.norm_q.weight"), [dim]),
            norm_k: graph.weight(&format!("{name}.norm_k.weight"), [dim]),
        }
    }
}

struct Block {
    modulation: Tensor<3>,
    self_attn: Attention,
    cross: Option<(Tensor<1>, Tensor<1>, Attention)>,
    ffn: [Linear; 2],
}

/// Queries, keys (both normalised, not rotated) and values of one layer, each [B, frames·tokens, d].
pub(crate) struct Qkv {
    pub(crate) q: Tensor<3>,
    pub(crate) k: Tensor<3>,
    pub(crate) v: Tensor<3>,
}

/// The keys and values of the prompt and the first frame, one pair per block that attends to them.
#[derive(Clone)]
pub struct Context {
    pairs: Vec<Option<(Tensor<3>, Tensor<3>)>>,
}

/// A control latent on the device, [1, frames·tokens, 4, channels].
#[derive(Clone)]
pub struct Control(pub(crate) Tensor<4>);

impl Control {
    /// Reads the latent back, [1, frames·tokens, 4, channels].
    #[must_use]
    pub fn values(&self) -> Array {
        array_of(self.0.clone())
    }
}

/// What one forward pass denoises.
pub(crate) struct Tokens {
    /// [B, F·tokens, 4, z].
    pub(crate) noisy: Tensor<4>,
    /// [B, F·tokens, 4, control channels].
    pub(crate) control: Tensor<4>,
    /// [B, F·tokens, 4, z].
    pub(crate) start: Tensor<4>,
    /// The timestep of each frame, 0 to 1000: B·F values, or one for all.
    pub(crate) times: Vec<f32>,
}

/// The transformer bound to the device.
pub struct Dit {
    pub(crate) shape: DitShape,
    pub(crate) graph: Graph,
    control: Linear,
    patch: Linear,
    time: [Linear; 3],
    text: Option<[Linear; 2]>,
    image: Option<Linear>,
    blocks: Vec<Block>,
    head: Linear,
    head_modulation: Tensor<3>,
    forwards: AtomicU64,
}

impl Dit {
    /// Returns how often [`Self::denoise`] was run.
    #[must_use]
    pub fn forwards(&self) -> u64 {
        self.forwards.load(Ordering::Relaxed)
    }

    /// Binds weights for inference.
    ///
    /// # Errors
    /// If the weights do not fit the shape.
    pub fn new(shape: &DitShape, weights: &Weights) -> Result<Self, WeightsError> {
        weights.check(&shape.declare())?;
        Ok(Self::bind(shape, weights, Mode::Infer))
    }

    pub(crate) fn bind(shape: &DitShape, weights: &Weights, mode: Mode) -> Self {
        let graph = Graph::new(weights, mode);
        let (d, in_dim) = (shape.dim, shape.in_dim());
        // The file holds (channel, row, column) per patch; tokens here hold (row·2 + column, channel).
        let patch = graph.weight::<3>("patch_embedding.weight", [d, in_dim, 4]).swap_dims(1, 2);
        let patch = Linear::of(patch.reshape([d, 4 * in_dim]).transpose(), graph.weight("patch_embedding.bias", [d]));
        let block = |layer: usize| {
            let name = |part: &str| format!("blocks.{layer}.{part}");
            let cross = || {
                let norm = [graph.weight(&name("norm3.weight"), [d]), graph.weight(&name("norm3.bias"), [d])];
                let [weight, bias] = norm;
                (weight, bias, Attention::new(&graph, &name("cross_attn"), d))
            };
            Block {
                modulation: graph.weight(&name("modulation"), [1, 6, d]),
                self_attn: Attention::new(&graph, &name("self_attn"), d),
                cross: shape.crosses(layer).then(cross),
                ffn: [graph.linear(&name("ffn.0")), graph.linear(&name("ffn.2"))],
            }
        };
        Self {
            control: graph.linear("control_embedding"),
            time: ["time_embedding.0", "time_embedding.2", "time_projection.1"].map(|name| graph.linear(name)),
            text: (shape.text_len > 0).then(|| ["text_embedding.0", "text_embedding.2"].map(|name| graph.linear(name))),
            image: shape.image_context.then(|| graph.linear("img_emb.proj.1")),
            blocks: (0..shape.layers).map(block).collect(),
            head: graph.linear("head.head"),
            head_modulation: graph.weight("head.modulation", [1, 2, d]),
            forwards: AtomicU64::new(0),
            shape: shape.clone(),
            patch,
            graph,
        }
    }

    /// Computes the context's keys and values: `text` is [B, text_len, text_dim], `first` the first frame's clean
    /// tokens [B, tokens, 4, z].
    #[must_use]
    pub fn context(&self, text: &Array, first: &Array) -> Context {
        let batch = first.shape()[0];
        let mut parts = Vec::new();
        if let Some(image) = &self.image {
            let first = self.graph.tensor::<4>(first);
            parts.push(image.apply(first.reshape([batch, self.shape.tokens(), 4 * self.shape.latent_channels])));
        }
        if let Some([first, second]) = &self.text {
            parts.push(second.apply(activation::gelu(first.apply(self.graph.tensor::<3>(text)))));
        }
        if parts.is_empty() {
            return Context { pairs: vec![None; self.blocks.len()] };
        }
        let tokens = Tensor::cat(parts, 1);
        let pair = |block: &Block| {
            let (_, _, attention) = block.cross.as_ref()?;
            let k = rms_norm(attention.k.apply(tokens.clone()), &attention.norm_k);
            Some((k, attention.v.apply(tokens.clone())))
        };
        Context { pairs: self.blocks.iter().map(pair).collect() }
    }

    /// Computes the control latent of space-to-depth layouts [B, F·tokens, 4, control inputs].
    #[must_use]
    pub fn control(&self, layouts: &Array) -> Control {
        Control(self.control.apply(self.graph.tensor::<4>(layouts)))
    }

    /// Reads a control latent [frames, tokens, 4, channels] back from its values.
    #[must_use]
    pub fn control_of(&self, latent: &Array) -> Control {
        let shape = [1, latent.values().len() / (4 * self.shape.control_channels), 4, self.shape.control_channels];
        Control(self.graph.tensor::<4>(&Array::new(&shape, latent.values().to_vec())))
    }

    /// Returns the control latent that stands for "no layout".
    #[must_use]
    pub fn control_off(&self, frames: usize) -> Control {
        let shape = [1, frames * self.shape.tokens(), 4, self.shape.control_channels];
        Control(Tensor::zeros(shape, &self.graph.device))
    }

    /// Runs one chunk against a window of cached frames. `noisy` and `start` are [frames, tokens, 4, z], `time` is
    /// 0 to 1000. Returns the network's output in the shape of `noisy`, and the chunk's keys and values.
    #[must_use]
    pub fn denoise(&self, chunk: &Chunk<'_>, window: &Window, context: &Context) -> (Array, ChunkKv) {
        self.forwards.fetch_add(1, Ordering::Relaxed);
        let shape = chunk.noisy.shape().to_vec();
        let flat = |array: &Array| self.graph.tensor::<4>(array).reshape([1, shape[0] * shape[1], 4, shape[3]]);
        let tokens = Tokens {
            noisy: flat(chunk.noisy),
            control: chunk.control.0.clone(),
            start: flat(chunk.start),
            times: vec![chunk.time],
        };
        let heads = self.shape.heads();
        let mut kept = Vec::with_capacity(self.blocks.len());
        let output = self.forward(tokens, context, &mut |layer, Qkv { q, k, v }| {
            let rotation: &Rotation = &window.current;
            kept.push((k.clone(), v.clone()));
            let (q, k) = (rotation.apply(q), rotation.apply(k));
            let (k, v) = window.extend(layer, k, v);
            heads.attend(Mode::Infer, q, k, v)
        });
        (array_of(output.reshape([shape[0], shape[1], 4, shape[3]])), ChunkKv { layers: kept, frames: shape[0] })
    }

    /// Runs all blocks; `attend` does the self-attention of a layer. Returns [B, F·tokens, 4, z].
    pub(crate) fn forward(
        &self,
        tokens: Tokens,
        context: &Context,
        attend: &mut dyn FnMut(usize, Qkv) -> Tensor<3>,
    ) -> Tensor<4> {
        let (d, n) = (self.shape.dim, self.shape.tokens());
        let [b, rows, _, z] = tokens.noisy.dims();
        let x = Tensor::cat(vec![tokens.noisy, tokens.control, tokens.start], 3);
        let mut x = self.patch.apply(x.reshape([b, rows, 4 * self.shape.in_dim()]));
        let e = self.time(&tokens.times);
        let e0 = self.time[2].apply(activation::silu(e.clone())).reshape([tokens.times.len(), 6, d]);
        for (layer, block) in self.blocks.iter().enumerate() {
            let m = Modulation { rows: e0.clone() + block.modulation.clone(), tokens: n };
            let y = m.norm(x.clone(), 1, 0);
            let attention = &block.self_attn;
            let q = rms_norm(attention.q.apply(y.clone()), &attention.norm_q);
            let k = rms_norm(attention.k.apply(y.clone()), &attention.norm_k);
            let y = attend(layer, Qkv { q, k, v: attention.v.apply(y) });
            x = x + m.gate(attention.o.apply(y), 2);
            if let (Some((weight, bias, attention)), Some((k, v))) = (&block.cross, &context.pairs[layer]) {
                let y = module::layer_norm(x.clone(), weight.clone(), Some(bias.clone()), EPSILON);
                let q = rms_norm(attention.q.apply(y), &attention.norm_q);
                let y = self.shape.heads().attend(self.graph.mode, q, k.clone(), v.clone());
                x = x + attention.o.apply(y);
            }
            let y = activation::gelu(block.ffn[0].apply(m.norm(x.clone(), 4, 3)));
            x = x + m.gate(block.ffn[1].apply(y), 5);
        }
        let rows_of_head = e.reshape([tokens.times.len(), 1, d]) + self.head_modulation.clone();
        let y = Modulation { rows: rows_of_head, tokens: n }.norm(x, 1, 0);
        self.head.apply(y).reshape([b, rows, 4, z])
    }

    /// The sinusoidal embedding (cosines first, angles in f64) through its two layers: [times, d].
    fn time(&self, times: &[f32]) -> Tensor<2> {
        let half = self.shape.freq_dim / 2;
        let mut values = Vec::with_capacity(times.len() * 2 * half);
        for time in times {
            let angle = |i: usize| f64::from(*time) * 10_000f64.powf(-(i as f64) / half as f64);
            #[expect(clippy::cast_possible_truncation, reason = "the embedding is single precision")]
            values.extend((0..half).map(|i| angle(i).cos() as f32).chain((0..half).map(|i| angle(i).sin() as f32)));
        }
        let table = self.graph.tensor::<2>(&Array::new(&[times.len(), 2 * half], values));
        self.time[1].apply(activation::silu(self.time[0].apply(table)))
    }
}

/// A chunk to denoise.
pub struct Chunk<'a> {
    /// The noisy latent, [frames, tokens, 4, z].
    pub noisy: &'a Array,
    /// The start latent: the first frame's clean tokens in frame 0 of the rollout; elsewhere the same or zeros.
    pub start: &'a Array,
    /// The control latent of the chunk.
    pub control: &'a Control,
    /// The timestep, 0 to 1000.
    pub time: f32,
}

/// Modulation rows [times, rows, d], one time for all frames or one per batch entry and frame.
struct Modulation {
    rows: Tensor<3>,
    tokens: usize,
}

impl Modulation {
    fn row(&self, row: usize) -> Tensor<3> {
        let [times, _, d] = self.rows.dims();
        self.rows.clone().slice([0..times, row..row + 1, 0..d])
    }

    /// LayerNorm without affine, then ·(1 + scale) + shift.
    fn norm(&self, x: Tensor<3>, scale: usize, shift: usize) -> Tensor<3> {
        let ([b, n, d], times) = (x.dims(), self.rows.dims()[0]);
        let (scale, shift) = (self.row(scale) + 1.0, self.row(shift));
        if times == 1 {
            return module::layer_norm(x, scale.reshape([d]), Some(shift.reshape([d])), EPSILON);
        }
        let x = x.reshape([times, self.tokens, d]);
        let centred = x.clone() - x.mean_dim(2);
        let variance = centred.clone().powi_scalar(2).mean_dim(2);
        let y = centred * (variance + EPSILON).sqrt().recip();
        (y * scale + shift).reshape([b, n, d])
    }

    fn gate(&self, x: Tensor<3>, row: usize) -> Tensor<3> {
        let ([b, n, d], times) = (x.dims(), self.rows.dims()[0]);
        (x.reshape([times, b * n / times, d]) * self.row(row)).reshape([b, n, d])
    }
}

/// x / √(mean(x²) + ε) · weight, over the last axis.
fn rms_norm(x: Tensor<3>, weight: &Tensor<1>) -> Tensor<3> {
    let scale = (x.clone().powi_scalar(2).mean_dim(2) + EPSILON).sqrt().recip();
    x * scale * weight.clone().reshape([1, 1, -1])
}
