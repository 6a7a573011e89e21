//! The transformer's weights in panels, and the forward pass over any number of sequences at once.
//!
//! Rows of a sequence are cut into an even number of blocks of at most 72 rows; a pass makes one parallel visit to all
//! blocks per layer and one at the start. Between visits keys and values of one layer are in one set of buffers while
//! those of the next are written to the other.

use std::ops::Range;
use std::sync::Arc;

use ds_nn::array::Weights;
use ds_nn::dit::DitShape;
use rayon::prelude::*;

use super::Buffer;
use super::arch::Arch;
use super::attention::{Keys, Seen};
use super::block::{Attention, Block, Cross, Layer, Modulation};
use super::buffer::Pool;
use super::cache::Sight;
use super::convolution::Convolution;
use super::norm::rms_norm;
use super::panels::Packed;
use super::product::{Finish, Source, Target, product};
use super::rotary::{Grid, Rotary};

/// Most rows of a block.
const BLOCK_ROWS: usize = 72;
/// Sequences of fewer rows are one block.
const LEAST_TO_CUT: usize = 16;

/// Keys and values of the prompt and the first frame, per layer that attends to them.
pub(crate) struct ContextKeys(Vec<Option<Keys>>);

/// One sequence to run.
pub(crate) struct Sequence<'a> {
    /// [rows, 4, z].
    pub(crate) noisy: &'a [f32],
    /// [rows, 4, control channels].
    pub(crate) control: &'a [f32],
    /// Factor of the control.
    pub(crate) control_on: f32,
    /// [rows, 4, z].
    pub(crate) start: &'a [f32],
    /// The timestep of each frame, or one for all.
    pub(crate) times: &'a [f32],
    /// What cross-attention sees.
    pub(crate) context: &'a ContextKeys,
    /// What was cached before.
    pub(crate) window: Option<&'a Sight>,
    /// Rotation of the sequence's rows.
    pub(crate) rotary: &'a Rotary,
}

/// Buffers of one pass.
#[derive(Default)]
pub(crate) struct Scratch {
    pub(crate) blocks: Vec<Block>,
    keys: [Vec<Keys>; 2],
    ranges: Vec<Range<usize>>,
    modulation: Modulation,
    times: [Buffer; 4],
}

/// The weights.
pub(crate) struct Network {
    pub(crate) shape: DitShape,
    pub(crate) arch: Arch,
    pub(crate) grid: Grid,
    pub(crate) captures: Arc<Pool<Buffer>>,
    control: Packed,
    patch: Packed,
    time: [Packed; 3],
    text: Option<[Packed; 2]>,
    image: Option<Packed>,
    layers: Vec<Layer>,
    head: Packed,
    head_modulation: Buffer,
}

/// Reads named weights that were checked against their declarations.
pub(crate) struct Named<'a>(pub(crate) &'a Weights);

impl Named<'_> {
    pub(crate) fn values(&self, name: &str) -> &[f32] {
        self.0.get(name).expect("the weights were checked against the declarations").values()
    }

    pub(crate) fn buffer(&self, name: &str) -> Buffer {
        Buffer::of(self.values(name))
    }

    /// Packs a convolution whose inputs come from images of these channels.
    pub(crate) fn convolution(&self, name: &str, inputs: &[usize]) -> Convolution {
        Convolution::new(self.values(&format!("{name}.weight")), self.values(&format!("{name}.bias")), inputs)
    }

    /// Packs linear layers side by side.
    pub(crate) fn linear(&self, names: &[String]) -> Packed {
        let parts = names.iter().map(|name| format!("{name}.weight"));
        let weight: Vec<f32> = parts.flat_map(|name| self.values(&name).to_vec()).collect();
        let bias: Vec<f32> = names.iter().flat_map(|name| self.values(&format!("{name}.bias")).to_vec()).collect();
        Packed::linear(&weight, Some(&bias), weight.len() / bias.len())
    }
}

impl Network {
    pub(crate) fn new(shape: &DitShape, weights: &Weights) -> Self {
        let named = Named(weights);
        let linear = |name: &str| named.linear(&[name.to_owned()]);
        let (dim, inputs) = (shape.dim, shape.in_dim());
        // The file holds (channel, row, column) per patch; tokens here hold (row·2 + column, channel).
        let patch = named.values("patch_embedding.weight");
        let value = |k: usize, column: usize| patch[(column * inputs + k % inputs) * 4 + k / inputs];
        let patch = Packed::new(4 * inputs, dim, Some(named.values("patch_embedding.bias")), value);
        let layers: Vec<Layer> =
            (0..shape.layers).into_par_iter().map(|layer| Self::layer(shape, &named, layer)).collect();
        Self {
            arch: Arch::new(),
            grid: Grid::new(shape),
            captures: Arc::default(),
            control: linear("control_embedding"),
            patch,
            time: ["time_embedding.0", "time_embedding.2", "time_projection.1"].map(linear),
            text: (shape.text_len > 0).then(|| ["text_embedding.0", "text_embedding.2"].map(linear)),
            image: shape.image_context.then(|| linear("img_emb.proj.1")),
            layers,
            head: linear("head.head"),
            head_modulation: named.buffer("head.modulation"),
            shape: shape.clone(),
        }
    }

    fn layer(shape: &DitShape, named: &Named<'_>, layer: usize) -> Layer {
        let name = |part: &str| format!("blocks.{layer}.{part}");
        let head_dim = shape.dim / shape.heads;
        let scale = std::f32::consts::LOG2_E / (head_dim as f32).sqrt();
        let attention = |kind: &str, parts: &[&str]| {
            let parts: Vec<String> = parts.iter().map(|part| name(&format!("{kind}.{part}"))).collect();
            let mut norm_q = named.buffer(&name(&format!("{kind}.norm_q.weight")));
            norm_q.iter_mut().for_each(|weight| *weight *= scale);
            Attention {
                project: named.linear(&parts),
                out: named.linear(&[name(&format!("{kind}.o"))]),
                norm_q,
                norm_k: named.buffer(&name(&format!("{kind}.norm_k.weight"))),
            }
        };
        let cross = || Cross {
            norm: [named.buffer(&name("norm3.weight")), named.buffer(&name("norm3.bias"))],
            attention: attention("cross_attn", &["q"]),
            keys: named.linear(&[name("cross_attn.k")]),
            values: named.linear(&[name("cross_attn.v")]),
        };
        Layer {
            modulation: named.buffer(&name("modulation")),
            attention: attention("self_attn", &["q", "k", "v"]),
            cross: shape.crosses(layer).then(cross),
            ffn: [named.linear(&[name("ffn.0")]), named.linear(&[name("ffn.2")])],
        }
    }

    /// Applies a linear layer to rows.
    fn rows(&self, packed: &Packed, x: &[f32], finish: Finish<'_>) -> Buffer {
        let mut y = Buffer::zeros(x.len() / packed.depth * packed.columns);
        self.apply(packed, x, &mut y, finish);
        y
    }

    fn apply(&self, packed: &Packed, x: &[f32], y: &mut [f32], finish: Finish<'_>) {
        let source = Source::rows(x, packed.depth);
        product(self.arch, x.len() / packed.depth, &[source], packed, Target::rows(y, packed.columns), finish);
    }

    /// Computes what cross-attention sees of one prompt [text_len, text_dim] and first frame [tokens, 4, z].
    pub(crate) fn context(&self, text: &[f32], first: &[f32]) -> ContextKeys {
        let dim = self.shape.dim;
        let mut tokens = Vec::new();
        if let Some(image) = &self.image {
            tokens.extend_from_slice(&self.rows(image, first, Finish::Plain));
        }
        if let Some([first, second]) = &self.text {
            let hidden = self.rows(first, text, Finish::Gelu);
            tokens.extend_from_slice(&self.rows(second, &hidden, Finish::Plain));
        }
        let keys = |layer: &Layer| {
            let cross = layer.cross.as_ref()?;
            let mut k = self.rows(&cross.keys, &tokens, Finish::Plain);
            rms_norm(self.arch, &mut k, 0, dim, &cross.attention.norm_k);
            let v = self.rows(&cross.values, &tokens, Finish::Plain);
            let mut keys = Keys::default();
            keys.reset(tokens.len() / dim, self.shape.heads, self.grid.head_dim());
            keys.fill(0, &k, &v, dim, self.grid.head_dim());
            Some(keys)
        };
        ContextKeys(self.layers.par_iter().map(keys).collect())
    }

    /// Computes the control latent of space-to-depth layouts [.., control inputs].
    pub(crate) fn control(&self, layouts: &[f32]) -> Buffer {
        let (inputs, channels) = (self.control.depth, self.control.columns);
        let pixels = layouts.len() / inputs;
        let mut latent = Buffer::zeros(pixels * channels);
        let parts = layouts.par_chunks(BLOCK_ROWS * inputs).zip(latent.par_chunks_mut(BLOCK_ROWS * channels));
        parts.for_each(|(x, y)| self.apply(&self.control, x, y, Finish::Plain));
        latent
    }

    /// Fills the modulation tables: the sinusoidal embedding (cosines first, angles in f64) through its layers, plus
    /// each layer's own rows.
    fn modulate(&self, times: &[f32], scratch: &mut Scratch) {
        let (dim, half) = (self.shape.dim, self.shape.freq_dim / 2);
        let [waves, e, silu_e, e0] = &mut scratch.times;
        waves.resize(times.len() * 2 * half);
        for (time, row) in times.iter().zip(waves.chunks_exact_mut(2 * half)) {
            let angle = |i: usize| f64::from(*time) * 10_000f64.powf(-(i as f64) / half as f64);
            #[expect(clippy::cast_possible_truncation, reason = "the embedding is single precision")]
            for i in 0..half {
                (row[i], row[half + i]) = (angle(i).cos() as f32, angle(i).sin() as f32);
            }
        }
        silu_e.resize(times.len() * dim);
        self.apply(&self.time[0], waves, silu_e, Finish::Silu);
        e.resize(times.len() * dim);
        self.apply(&self.time[1], silu_e, e, Finish::Plain);
        for (to, from) in silu_e.iter_mut().zip(e.iter()) {
            *to = super::lanes::silu(*from);
        }
        e0.resize(times.len() * 6 * dim);
        self.apply(&self.time[2], silu_e, e0, Finish::Plain);
        let modulation = &mut scratch.modulation;
        (modulation.times, modulation.dim) = (times.len(), dim);
        modulation.layers.resize(self.layers.len() * e0.len());
        for (rows, layer) in modulation.layers.chunks_exact_mut(e0.len()).zip(&self.layers) {
            for (row, e0) in rows.chunks_exact_mut(6 * dim).zip(e0.chunks_exact(6 * dim)) {
                row.iter_mut().zip(e0).zip(layer.modulation.iter()).for_each(|((m, a), b)| *m = a + b);
            }
        }
        modulation.head.resize(times.len() * 2 * dim);
        for (rows, e) in modulation.head.chunks_exact_mut(2 * dim).zip(e.chunks_exact(dim)) {
            for (row, own) in rows.chunks_exact_mut(dim).zip(self.head_modulation.chunks_exact(dim)) {
                row.iter_mut().zip(e).zip(own).for_each(|((m, a), b)| *m = a + b);
            }
        }
    }

    /// Cuts the sequences into blocks and lays out their input.
    fn lay_out(&self, sequences: &[Sequence<'_>], capture: bool, scratch: &mut Scratch) {
        let (z, tokens) = (4 * self.shape.latent_channels, self.shape.tokens());
        let (mut count, mut times) = (0, 0);
        scratch.ranges.clear();
        for (at, sequence) in sequences.iter().enumerate() {
            let rows = sequence.noisy.len() / z;
            let cuts = if rows < LEAST_TO_CUT { 1 } else { 2 * rows.div_ceil(2 * BLOCK_ROWS) };
            let size = rows.div_ceil(cuts).next_multiple_of(super::product::ROWS);
            scratch.ranges.push(count..count + rows.div_ceil(size));
            for first in (0..rows).step_by(size) {
                if scratch.blocks.len() == count {
                    scratch.blocks.push(Block::default());
                }
                let block = &mut scratch.blocks[count];
                (block.sequence, block.first, block.rows) = (at, first, size.min(rows - first));
                block.index.clear();
                let time = |row: usize| if sequence.times.len() == 1 { 0 } else { row / tokens };
                #[expect(clippy::cast_possible_truncation, reason = "there are few times")]
                block.index.extend((first..first + block.rows).map(|row| (times + time(row)) as u32));
                let size = self.layers.len() * 2 * block.rows * self.shape.dim;
                block.capture = capture.then(|| {
                    let mut buffer = self.captures.take(Buffer::default);
                    buffer.resize(size);
                    buffer
                });
                count += 1;
            }
            times += sequence.times.len();
        }
        scratch.blocks.truncate(count);
        scratch.keys.iter_mut().for_each(|keys| keys.resize_with(count, Keys::default));
    }

    /// Copies a block's rows of noisy, control and start latents side by side.
    fn gather(&self, sequence: &Sequence<'_>, block: &mut Block) {
        let (z, c) = (self.shape.latent_channels, self.shape.control_channels);
        block.y.resize(block.rows * 4 * (2 * z + c));
        let pixels = 4 * block.first..4 * (block.first + block.rows);
        for (pixel, row) in pixels.zip(block.y.chunks_exact_mut(2 * z + c)) {
            row[..z].copy_from_slice(&sequence.noisy[pixel * z..(pixel + 1) * z]);
            let control = &sequence.control[pixel * c..(pixel + 1) * c];
            row[z..z + c].iter_mut().zip(control).for_each(|(to, from)| *to = from * sequence.control_on);
            row[z + c..].copy_from_slice(&sequence.start[pixel * z..(pixel + 1) * z]);
        }
    }

    /// Runs the network; results lie in the scratch's blocks.
    pub(crate) fn forward(&self, sequences: &[Sequence<'_>], capture: bool, scratch: &mut Scratch) {
        let times: Vec<f32> = sequences.iter().flat_map(|sequence| sequence.times).copied().collect();
        self.modulate(&times, scratch);
        self.lay_out(sequences, capture, scratch);
        let Scratch { blocks, keys: [now, next], ranges, modulation, .. } = scratch;
        let (arch, head_dim, modulation): (_, _, &Modulation) = (self.arch, self.grid.head_dim(), modulation);
        let visit = |blocks: &mut [Block], keys: &mut [Keys], each: &(dyn Fn(&mut Block, &mut Keys) + Sync)| {
            let pairs = blocks.par_iter_mut().zip(keys).with_max_len(1);
            pairs.for_each(|(block, keys)| each(block, keys));
        };
        let project = |layer: usize, block: &mut Block, keys: &mut Keys| {
            let rotary = sequences[block.sequence].rotary;
            block.project(arch, (layer, &self.layers[layer]), modulation, rotary, head_dim, keys);
        };
        rayon::scope(|_| {
            visit(blocks, now, &|block, keys| {
                self.gather(&sequences[block.sequence], block);
                block.enter(arch, &self.patch);
                project(0, block, keys);
            });
            for (at, layer) in self.layers.iter().enumerate() {
                let current: &[Keys] = now;
                visit(blocks, next, &|block, keys| {
                    let sequence = &sequences[block.sequence];
                    let window = sequence.window.and_then(|window| window.layer(at));
                    let seen = Seen { window, blocks: &current[ranges[block.sequence].clone()] };
                    block.conclude(arch, (at, layer), modulation, head_dim, seen, sequence.context.0[at].as_ref());
                    match at + 1 < self.layers.len() {
                        true => project(at + 1, block, keys),
                        false => block.leave(arch, &self.head, modulation),
                    }
                });
                std::mem::swap(now, next);
            }
        });
    }
}
