//! The patch diffusion transformer with a timestep per latent frame, in the layer order and weight naming of Wan.
//!
//! Tokens are 2×2 patches of latent pixels; a frame of `grid_h`×`grid_w` tokens comes as [tokens, 4 pixels, channels]
//! with pixels in row-major order inside the patch. The input is the concatenation noisy ++ control ++ start along
//! channels; control is a linear map of the space-to-depth layout, or a latent of the autoencoder. Time, modulation and
//! norms are f32. Cross-attention to the context sits in every `cross_every`-th block; CLIP states have keys and values
//! of their own there, whose result is added.

use std::sync::atomic::{AtomicU64, Ordering};

use burn::tensor::{Tensor, activation, module};
use ds_nn::array::{Array, Weights, WeightsError};
use ds_nn::body::{ChunkKv, Window};
use ds_nn::checkpoint::{CheckpointError, Finite, Fitted};
use ds_nn::dit::{DitShape, Gelu};

use crate::attention::{Heads, Rotation};
use crate::device::Precision;
use crate::graph::{Graph, Linear, Mode, array_of};

mod body;
mod clip;
mod image;
mod modulation;
#[cfg(test)]
mod tests;
mod window;

pub use clip::Clip;
use image::{ImageEmbedding, ImageKv};
use modulation::{Modulation, rms_norm};
use window::{ChunkLayers, GraphWindow};

const EPSILON: f64 = 1e-6;

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
        let linear = |part: &str| graph.large(&format!("{name}.{part}"));
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

/// Cross-attention of a block: its norm, the attention to the prompt, and keys and values of CLIP states.
struct Cross {
    norm: [Tensor<1>; 2],
    attention: Attention,
    image: Option<ImageKv>,
}

struct Block {
    modulation: Tensor<3>,
    self_attn: Attention,
    cross: Option<Cross>,
    ffn: [Linear; 2],
}

/// Queries, keys (both normalised, not rotated) and values of one layer, each [B, frames·tokens, d].
pub(crate) struct Qkv {
    pub(crate) q: Tensor<3>,
    pub(crate) k: Tensor<3>,
    pub(crate) v: Tensor<3>,
}

/// The keys and values of the prompt and the first frame, per block that attends to them; those of CLIP states are a
/// pair of their own.
#[derive(Clone)]
pub struct Context {
    pairs: Vec<Option<Pairs>>,
}

type Pairs = ((Tensor<3>, Tensor<3>), Option<(Tensor<3>, Tensor<3>)>);

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
    control: Option<Linear>,
    patch: Linear,
    time: [Linear; 3],
    text: Option<[Linear; 2]>,
    image: Option<Linear>,
    clip: Option<ImageEmbedding>,
    reference: Option<Linear>,
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

    /// Binds a checkpoint that was fitted to [`DitShape::declare`]. Blocks' layers, keys and values take the precision;
    /// embeddings, modulation, norms and head stay f32.
    ///
    /// # Errors
    /// If a value is not finite and that is checked.
    pub fn load(
        shape: &DitShape,
        fitted: &Fitted<'_>,
        finite: Finite,
        precision: Precision,
    ) -> Result<Self, CheckpointError> {
        let mut graph = Graph::empty(Mode::Infer, precision);
        fitted.each(finite, |name, array| graph.bind(name, &array, format(name, array.shape(), precision)))?;
        let mut dit = Self::of(shape, graph);
        dit.graph.forget();
        Ok(dit)
    }

    /// Binds drawn weights, for measurements.
    #[must_use]
    pub fn drawn(shape: &DitShape, precision: Precision) -> Self {
        let mut graph = Graph::empty(Mode::Infer, precision);
        graph.bind_drawn(&shape.declare(), |weight| format(&weight.name, &weight.shape, precision));
        let mut dit = Self::of(shape, graph);
        dit.graph.forget();
        dit
    }

    pub(crate) fn bind(shape: &DitShape, weights: &Weights, mode: Mode) -> Self {
        Self::bind_in(Precision::F32, shape, weights, mode)
    }

    pub(crate) fn bind_in(precision: Precision, shape: &DitShape, weights: &Weights, mode: Mode) -> Self {
        Self::of(shape, Graph::new_in(precision, weights, mode))
    }

    /// Builds the layers of weights that were put on the device and fit the declarations.
    pub(crate) fn of(shape: &DitShape, graph: Graph) -> Self {
        let d = shape.dim;
        // The file holds (channel, row, column) per patch; tokens here hold (row·2 + column, channel).
        let patch = |name: &str, channels: usize| {
            let weight = graph.weight::<3>(&format!("{name}.weight"), [d, channels, 4]).swap_dims(1, 2);
            Linear::of(weight.reshape([d, 4 * channels]).transpose(), graph.weight(&format!("{name}.bias"), [d]))
        };
        let block = |layer: usize| {
            let name = |part: &str| format!("blocks.{layer}.{part}");
            let cross = || Cross {
                norm: [graph.weight(&name("norm3.weight"), [d]), graph.weight(&name("norm3.bias"), [d])],
                attention: Attention::new(&graph, &name("cross_attn"), d),
                image: (shape.clip_dim > 0).then(|| ImageKv::new(&graph, &name("cross_attn"), d)),
            };
            Block {
                modulation: graph.weight(&name("modulation"), [1, 6, d]),
                self_attn: Attention::new(&graph, &name("self_attn"), d),
                cross: shape.crosses(layer).then(cross),
                ffn: [graph.large(&name("ffn.0")), graph.large(&name("ffn.2"))],
            }
        };
        Self {
            control: (shape.control_inputs > 0).then(|| graph.linear("control_embedding")),
            patch: patch("patch_embedding", shape.in_dim()),
            time: ["time_embedding.0", "time_embedding.2", "time_projection.1"].map(|name| graph.linear(name)),
            text: (shape.text_len > 0).then(|| ["text_embedding.0", "text_embedding.2"].map(|name| graph.linear(name))),
            image: shape.image_context.then(|| graph.linear("img_emb.proj.1")),
            clip: (shape.clip_dim > 0).then(|| ImageEmbedding::new(&graph, shape)),
            reference: shape.reference.then(|| patch("ref_conv", shape.latent_channels)),
            blocks: (0..shape.layers).map(block).collect(),
            head: graph.linear("head.head"),
            head_modulation: graph.weight("head.modulation", [1, 2, d]),
            forwards: AtomicU64::new(0),
            shape: shape.clone(),
            graph,
        }
    }

    /// Computes the context's keys and values: `text` is [B, text_len, text_dim], `first` the first frame's clean
    /// tokens [B, tokens, 4, z], or its CLIP states [B, tokens, clip_dim] where the shape asks for those.
    #[must_use]
    pub fn context(&self, text: &Array, first: &Array) -> Context {
        let batch = first.shape()[0];
        let mut parts = Vec::new();
        if let Some(image) = &self.image {
            let first = self.graph.tensor::<4>(first);
            parts.push(image.apply(first.reshape([batch, self.shape.tokens(), 4 * self.shape.latent_channels])));
        }
        if let Some([first, second]) = &self.text {
            parts.push(second.apply(self.gelu(first.apply(self.graph.tensor::<3>(text)))));
        }
        if parts.is_empty() {
            return Context { pairs: vec![None; self.blocks.len()] };
        }
        let tokens = Tensor::cat(parts, 1);
        let states = self.clip.as_ref().map(|clip| clip.apply(self.graph.tensor::<3>(first)));
        let pair = |block: &Block| {
            let Cross { attention, image, .. } = block.cross.as_ref()?;
            let lower = |x| self.graph.lower(x);
            let k = rms_norm(attention.k.apply(tokens.clone()), &attention.norm_k);
            let image = image.as_ref().zip(states.clone()).map(|(image, states)| image.apply(states));
            let image = image.map(|(k, v)| (lower(k), lower(v)));
            Some(((lower(k), lower(attention.v.apply(tokens.clone()))), image))
        };
        Context { pairs: self.blocks.iter().map(pair).collect() }
    }

    /// Computes the control latent of space-to-depth layouts [B, F·tokens, 4, control inputs]; without a control
    /// embedding the argument is the control latent itself.
    #[must_use]
    pub fn control(&self, layouts: &Array) -> Control {
        Control(match &self.control {
            Some(embedding) => embedding.apply(self.graph.coarse::<4>(layouts)),
            None => self.graph.tensor::<4>(layouts),
        })
    }

    /// Reads a control latent [frames, tokens, 4, channels] back from its values; none where there are no channels.
    #[must_use]
    pub fn control_of(&self, latent: &Array) -> Control {
        if self.shape.control_channels == 0 {
            return self.control_off(latent.shape()[0]);
        }
        let shape = [1, latent.values().len() / (4 * self.shape.control_channels), 4, self.shape.control_channels];
        Control(self.graph.tensor::<4>(&Array::new(&shape, latent.values().to_vec())))
    }

    /// Returns the control latent that stands for "no layout".
    #[must_use]
    pub fn control_off(&self, frames: usize) -> Control {
        let shape = [1, frames * self.shape.tokens(), 4, self.shape.control_channels.max(1)];
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
        let (heads, window) = (self.heads(), window.0.of::<GraphWindow>());
        let mut kept = Vec::with_capacity(self.blocks.len());
        let output = self.forward(tokens, context, &mut |layer, Qkv { q, k, v }| {
            let rotation: &Rotation = &window.current;
            let v = self.graph.lower(v);
            kept.push((self.graph.lower(k.clone()), v.clone()));
            let (q, k) = (self.graph.lower(rotation.apply(q)), self.graph.lower(rotation.apply(k)));
            let (k, v) = window.extend(layer, k, v);
            heads.attend(Mode::Infer, q, k, v)
        });
        (
            array_of(output.reshape([shape[0], shape[1], 4, shape[3]])),
            ChunkKv::new(ChunkLayers { layers: kept, frames: shape[0] }),
        )
    }

    /// Runs all blocks; `attend` does the self-attention of a layer. Returns [B, F·tokens, 4, z].
    pub(crate) fn forward(
        &self,
        tokens: Tokens,
        context: &Context,
        attend: &mut dyn FnMut(usize, Qkv) -> Tensor<3>,
    ) -> Tensor<4> {
        let [b, rows, _, z] = tokens.noisy.dims();
        let times = tokens.times.clone();
        self.run(self.embed(tokens), &times, context, attend).reshape([b, rows, 4, z])
    }

    /// Joins the inputs that the shape has along channels and embeds each patch: [B, F·tokens, d].
    fn embed(&self, tokens: Tokens) -> Tensor<3> {
        let [b, rows, _, _] = tokens.noisy.dims();
        let mut inputs = vec![tokens.noisy];
        inputs.extend((self.shape.control_channels > 0).then_some(tokens.control));
        inputs.extend((self.shape.start_channels > 0).then_some(tokens.start));
        self.patch.apply(Tensor::cat(inputs, 3).reshape([b, rows, 4 * self.shape.in_dim()]))
    }

    /// Runs all blocks and the head over embedded tokens [B, F·tokens, d]. Returns [B, F·tokens, 4·z].
    fn run(
        &self,
        mut x: Tensor<3>,
        times: &[f32],
        context: &Context,
        attend: &mut dyn FnMut(usize, Qkv) -> Tensor<3>,
    ) -> Tensor<3> {
        let (d, n) = (self.shape.dim, self.shape.tokens());
        let e = self.time(times);
        let e0 = self.time[2].apply(activation::silu(e.clone())).reshape([times.len(), 6, d]);
        for (layer, block) in self.blocks.iter().enumerate() {
            let m = Modulation { rows: e0.clone() + block.modulation.clone(), tokens: n };
            let y = m.norm(x.clone(), 1, 0);
            let attention = &block.self_attn;
            let q = rms_norm(attention.q.apply(y.clone()), &attention.norm_q);
            let k = rms_norm(attention.k.apply(y.clone()), &attention.norm_k);
            let y = attend(layer, Qkv { q, k, v: attention.v.apply(y) });
            x = x + m.gate(attention.o.apply(y), 2);
            if let (Some(cross), Some(pairs)) = (&block.cross, &context.pairs[layer]) {
                x = x.clone() + self.cross(cross, x, pairs);
            }
            let y = self.gelu(block.ffn[0].apply(m.norm(x.clone(), 4, 3)));
            x = x + m.gate(block.ffn[1].apply(y), 5);
        }
        let rows_of_head = e.reshape([times.len(), 1, d]) + self.head_modulation.clone();
        let y = Modulation { rows: rows_of_head, tokens: n }.norm(x, 1, 0);
        self.head.apply(y)
    }

    /// Attends to the prompt and, beside it, to the CLIP states; the two results are added.
    fn cross(&self, cross: &Cross, x: Tensor<3>, (text, image): &Pairs) -> Tensor<3> {
        let [weight, bias] = cross.norm.clone();
        let attention = &cross.attention;
        let y = module::layer_norm(x, weight, Some(bias), EPSILON);
        let q = self.graph.lower(rms_norm(attention.q.apply(y), &attention.norm_q));
        let heads = self.heads();
        let attend = |(k, v): &(Tensor<3>, Tensor<3>)| heads.attend(self.graph.mode, q.clone(), k.clone(), v.clone());
        let y = attend(text);
        attention.o.apply(match image {
            Some(image) => y + attend(image),
            None => y,
        })
    }

    pub(crate) fn heads(&self) -> Heads {
        let shape = &self.shape;
        Heads { heads: shape.heads, head_dim: shape.dim / shape.heads, grid_h: shape.grid_h, grid_w: shape.grid_w }
    }

    fn gelu(&self, x: Tensor<3>) -> Tensor<3> {
        match self.shape.gelu {
            Gelu::Exact => activation::gelu(x),
            Gelu::Tanh => activation::gelu_approximate(x),
        }
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

/// Returns the number format of a weight: blocks' matrices are lowered, all else stays f32.
fn format(name: &str, shape: &[usize], precision: Precision) -> Precision {
    if name.starts_with("blocks.") && shape.len() == 2 { precision } else { Precision::F32 }
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
