//! The weights of the transformer by their place, and the forward pass that keeps what the backward pass needs.
//!
//! The layer order is that of `ds_graph::dit`. Kept per layer: normalised rows and their scales, queries and keys before
//! and after norm and rotation, values, the logs of the softmax, what attention mixed, and what gates multiply.

use std::ops::Range;

use ds_nn::array::Weights;
use ds_nn::dit::DitShape;

use super::attention::{Heads, Tiles};
use super::linear::{Linear, values};
use super::rows;
use super::sequence::{Link, Run, Sequence};
use super::time::{Time, TimeTape};
use crate::Buffer;
use crate::arch::Arch;
use crate::rotary::{Grid, Rotary};

/// Attention; the norm of queries carries the scale of scores.
pub(super) struct Attention<'a> {
    pub(super) name: String,
    pub(super) q: Linear<'a>,
    pub(super) k: Linear<'a>,
    pub(super) v: Linear<'a>,
    pub(super) o: Linear<'a>,
    pub(super) norm_q: Vec<f32>,
    pub(super) norm_k: &'a [f32],
}

/// Attention to the context after a layer norm with weight and bias.
pub(super) struct Cross<'a> {
    pub(super) norm: [&'a [f32]; 2],
    pub(super) attention: Attention<'a>,
}

/// One layer.
pub(super) struct Layer<'a> {
    /// Its place among the layers.
    pub(super) at: usize,
    pub(super) name: String,
    pub(super) modulation: &'a [f32],
    pub(super) own: Attention<'a>,
    pub(super) cross: Option<Cross<'a>>,
    pub(super) ffn: [Linear<'a>; 2],
}

/// The weights.
pub(super) struct Network<'a> {
    pub(super) shape: &'a DitShape,
    pub(super) arch: Arch,
    pub(super) heads: Heads,
    pub(super) control: Linear<'a>,
    /// The patch embedding with its values in the order of tokens: (row·2 + column, channel).
    pub(super) patch: Vec<f32>,
    pub(super) patch_bias: &'a [f32],
    pub(super) time: Time<'a>,
    pub(super) text: Option<[Linear<'a>; 2]>,
    pub(super) image: Option<Linear<'a>>,
    pub(super) layers: Vec<Layer<'a>>,
    pub(super) head: Linear<'a>,
    /// Factor by which norms of queries were scaled.
    pub(super) query_scale: f32,
    grid: Grid,
}

/// What one attention keeps.
#[derive(Default)]
pub(super) struct AttentionTape {
    pub(super) normal: Buffer,
    pub(super) scales: Buffer,
    /// Queries and keys before their norms.
    pub(super) raw: [Buffer; 2],
    pub(super) raw_scales: [Buffer; 2],
    pub(super) q: Buffer,
    pub(super) k: Buffer,
    pub(super) v: Buffer,
    /// Keys of moved sinks.
    pub(super) moved: Buffer,
    pub(super) logs: Buffer,
    pub(super) mixed: Buffer,
    pub(super) out: Buffer,
}

/// What one layer keeps.
#[derive(Default)]
pub(super) struct LayerTape {
    pub(super) own: AttentionTape,
    pub(super) cross: AttentionTape,
    pub(super) normal: Buffer,
    pub(super) scales: Buffer,
    pub(super) hidden: Buffer,
    pub(super) out: Buffer,
}

/// What one pass keeps.
#[derive(Default)]
pub(super) struct Tape {
    pub(super) runs: Vec<Run>,
    pub(super) links: Vec<Link>,
    pub(super) moved: Vec<(usize, Rotary)>,
    pub(super) rotary: Rotary,
    pub(super) time: TimeTape,
    pub(super) control: Buffer,
    pub(super) input: Buffer,
    /// The context before and after its GELU, and its tokens.
    pub(super) prompt: [Buffer; 2],
    pub(super) context: Buffer,
    pub(super) layers: Vec<LayerTape>,
    pub(super) normal: Buffer,
    pub(super) scales: Buffer,
    /// The network's output, [rows, 4, z].
    pub(super) output: Buffer,
    pub(super) tiles: Tiles,
    pub(super) x: Buffer,
    pub(super) y: Buffer,
    pub(super) hidden: Buffer,
}

/// Returns the values of some rows.
pub(super) fn span(rows: &Range<usize>, width: usize) -> Range<usize> {
    rows.start * width..rows.end * width
}

impl<'a> Attention<'a> {
    fn new(weights: &'a Weights, name: String, scale: f32) -> Self {
        let linear = |part: &str| Linear::new(weights, format!("{name}.{part}"));
        let norm_q = values(weights, &format!("{name}.norm_q.weight")).iter().map(|weight| weight * scale).collect();
        let norm_k = values(weights, &format!("{name}.norm_k.weight"));
        let (q, k, v, o) = (linear("q"), linear("k"), linear("v"), linear("o"));
        Self { q, k, v, o, norm_q, norm_k, name }
    }
}

impl<'a> Network<'a> {
    pub(super) fn new(shape: &'a DitShape, weights: &'a Weights) -> Self {
        assert!(shape.is_own(), "only the project's own networks are trained");
        let linear = |name: &str| Linear::new(weights, name);
        let (inputs, width) = (shape.in_dim(), shape.dim / shape.heads);
        let query_scale = std::f32::consts::LOG2_E / (width as f32).sqrt();
        let layer = |layer: usize| {
            let name = format!("blocks.{layer}");
            let part = |part: &str| format!("{name}.{part}");
            let cross = || Cross {
                norm: [values(weights, &part("norm3.weight")), values(weights, &part("norm3.bias"))],
                attention: Attention::new(weights, part("cross_attn"), query_scale),
            };
            Layer {
                at: layer,
                modulation: values(weights, &part("modulation")),
                own: Attention::new(weights, part("self_attn"), query_scale),
                cross: shape.crosses(layer).then(cross),
                ffn: [linear(&part("ffn.0")), linear(&part("ffn.2"))],
                name,
            }
        };
        // The file holds (channel, row, column) per patch.
        let patch = values(weights, "patch_embedding.weight").chunks_exact(4 * inputs);
        let patch = patch.flat_map(|row| (0..4 * inputs).map(|at| row[at % inputs * 4 + at / inputs])).collect();
        let arch = Arch::new();
        Self {
            shape,
            arch,
            heads: Heads { arch, heads: shape.heads, width },
            control: linear("control_embedding"),
            patch,
            patch_bias: values(weights, "patch_embedding.bias"),
            time: Time::new(shape, weights),
            text: (shape.text_len > 0).then(|| ["text_embedding.0", "text_embedding.2"].map(linear)),
            image: shape.image_context.then(|| linear("img_emb.proj.1")),
            layers: (0..shape.layers).map(layer).collect(),
            head: linear("head.head"),
            query_scale,
            grid: Grid::new(shape),
        }
    }

    pub(super) fn patch(&self) -> Linear<'_> {
        Linear { name: "patch_embedding".to_owned(), weight: &self.patch, bias: self.patch_bias }
    }

    /// Runs the network; the output lies on the tape.
    pub(super) fn forward(&self, sequence: &Sequence<'_>, tape: &mut Tape) {
        let (d, tokens) = (self.shape.dim, self.shape.tokens());
        let rows = sequence.times.len() * tokens;
        let (times, runs) = sequence.runs(tokens);
        self.time.forward(self.arch, &times, &mut tape.time);
        tape.runs = runs;
        let (links, moved) = sequence.links(tokens);
        tape.links = links;
        self.grid.fill(&sequence.positions, &mut tape.rotary);
        let turned = |moved: &super::sequence::Moved| {
            let mut rotary = Rotary::default();
            self.grid.fill(&(moved.by..moved.by + moved.frames).collect::<Vec<_>>(), &mut rotary);
            (moved.frames * tokens, rotary)
        };
        tape.moved = moved.iter().map(turned).collect();
        self.gather(sequence, tape);
        self.patch().forward(&tape.input, tape.x.sized(rows * d));
        self.context(sequence, tape);
        tape.layers.resize_with(self.layers.len(), LayerTape::default);
        let mut layers = std::mem::take(&mut tape.layers);
        for (layer, kept) in self.layers.iter().zip(&mut layers) {
            self.attend(layer, &mut kept.own, tape);
            if let Some(cross) = &layer.cross {
                self.cross(cross, &mut kept.cross, tape);
            }
            self.feed_forward(layer, kept, tape);
        }
        tape.layers = layers;
        tape.normal.sized(rows * d);
        tape.scales.sized(rows);
        for Run { rows, time } in &tape.runs {
            let (now, [shift, factor]) = (span(rows, d), tape.time.head_rows(*time, d));
            let (normal, y) = (&mut tape.normal[now.clone()], &mut tape.y[now.clone()]);
            rows::layer_norm(self.arch, &tape.x[now], [factor, shift], normal, &mut tape.scales[rows.clone()], y);
        }
        self.head.forward(&tape.y, tape.output.sized(rows * self.head.outputs()));
    }

    /// Computes the control latents, and lays states, control and start latents side by side.
    fn gather(&self, sequence: &Sequence<'_>, tape: &mut Tape) {
        let (z, c, pixels) = (self.shape.latent_channels, self.shape.control_channels, 4 * self.shape.tokens());
        let layouts = sequence.layouts;
        let control = tape.control.sized(layouts.len() / self.control.inputs() * c);
        if sequence.layout_on == 0.0 {
            control.fill(0.0);
        } else {
            self.control.forward(layouts, control);
        }
        let input = tape.input.sized(sequence.times.len() * pixels * (2 * z + c));
        for (at, row) in input.chunks_exact_mut(2 * z + c).enumerate() {
            let (frame, pixel) = (at / pixels, at % pixels);
            row[..z].copy_from_slice(&sequence.noisy[at * z..(at + 1) * z]);
            let from = (sequence.positions[frame] * pixels + pixel) * c;
            let control = &control[from..from + c];
            row[z..z + c].iter_mut().zip(control).for_each(|(to, from)| *to = from * sequence.layout_on);
            if frame == 0 || self.shape.start_every {
                row[z + c..].copy_from_slice(&sequence.start[pixel * z..(pixel + 1) * z]);
            } else {
                row[z + c..].fill(0.0);
            }
        }
    }

    /// Computes the tokens that cross-attention sees.
    fn context(&self, sequence: &Sequence<'_>, tape: &mut Tape) {
        let (d, tokens) = (self.shape.dim, self.shape.tokens());
        let split = if self.image.is_some() { tokens * d } else { 0 };
        let context = tape.context.sized(split + self.shape.text_len * d);
        if let Some(image) = &self.image {
            image.forward(&sequence.start, &mut context[..split]);
        }
        if let Some([first, second]) = &self.text {
            let [raw, hidden] = &mut tape.prompt;
            first.forward(&sequence.text, raw.sized(self.shape.text_len * d));
            rows::gelu(self.arch, raw, hidden.sized(self.shape.text_len * d));
            second.forward(hidden, &mut context[split..]);
        }
    }

    fn attend(&self, layer: &Layer<'_>, kept: &mut AttentionTape, tape: &mut Tape) {
        let (d, Attention { q, k, v, o, norm_q, norm_k, .. }) = (self.shape.dim, &layer.own);
        let Tape { runs, links, moved, rotary, time, x, y, tiles, .. } = tape;
        let rows = x.len() / d;
        kept.normal.sized(rows * d);
        kept.scales.sized(rows);
        y.sized(rows * d);
        for Run { rows, time: label } in runs.iter() {
            let (now, [shift, factor, ..]) = (span(rows, d), time.rows(layer.at, *label, layer.modulation));
            let (normal, y) = (&mut kept.normal[now.clone()], &mut y[now.clone()]);
            rows::layer_norm(self.arch, &x[now], [factor, shift], normal, &mut kept.scales[rows.clone()], y);
        }
        let (raw, scales) = (&mut kept.raw, &mut kept.raw_scales);
        q.forward(y, raw[0].sized(rows * d));
        k.forward(y, raw[1].sized(rows * d));
        v.forward(y, kept.v.sized(rows * d));
        rows::rms_norm(self.arch, &raw[0], norm_q, scales[0].sized(rows), kept.q.sized(rows * d));
        rows::rms_norm(self.arch, &raw[1], norm_k, scales[1].sized(rows), kept.k.sized(rows * d));
        let mut first = 0;
        kept.moved.sized(moved.iter().map(|(rows, _)| rows * d).sum());
        for (rows, rotary) in moved.iter() {
            let part = &mut kept.moved[first..first + rows * d];
            part.copy_from_slice(&kept.k[..rows * d]);
            rotary.apply(self.arch, part, [0, d, d], 0);
            first += rows * d;
        }
        rotary.apply(self.arch, &mut kept.q, [0, d, d], 0);
        rotary.apply(self.arch, &mut kept.k, [0, d, d], 0);
        kept.logs.sized(rows * self.heads.heads);
        kept.mixed.sized(rows * d);
        for link in links.iter() {
            let keys = seen(link, &kept.k, &kept.v, &kept.moved, moved, d);
            let (now, logs) = (span(&link.queries, d), span(&link.queries, self.heads.heads));
            let out = &mut kept.mixed[now.clone()];
            self.heads.forward(&kept.q[now], &keys, tiles, out, &mut kept.logs[logs]);
        }
        o.forward(&kept.mixed, kept.out.sized(rows * d));
        for Run { rows, time: label } in runs.iter() {
            let (now, [.., gate, _, _, _]) = (span(rows, d), time.rows(layer.at, *label, layer.modulation));
            rows::gate(self.arch, &kept.out[now.clone()], gate, &mut x[now]);
        }
    }

    fn cross(&self, cross: &Cross<'_>, kept: &mut AttentionTape, tape: &mut Tape) {
        let (d, Attention { q, k, v, o, norm_q, norm_k, .. }) = (self.shape.dim, &cross.attention);
        let Tape { context, x, y, tiles, .. } = tape;
        let rows = x.len() / d;
        let (normal, scales) = (kept.normal.sized(rows * d), kept.scales.sized(rows));
        rows::layer_norm(self.arch, x, cross.norm, normal, scales, y);
        let (raw, scales) = (&mut kept.raw, &mut kept.raw_scales);
        q.forward(y, raw[0].sized(rows * d));
        k.forward(context, raw[1].sized(context.len()));
        v.forward(context, kept.v.sized(context.len()));
        rows::rms_norm(self.arch, &raw[0], norm_q, scales[0].sized(rows), kept.q.sized(rows * d));
        let (scales, keys) = (scales[1].sized(context.len() / d), kept.k.sized(context.len()));
        rows::rms_norm(self.arch, &raw[1], norm_k, scales, keys);
        let logs = kept.logs.sized(rows * self.heads.heads);
        let mixed = kept.mixed.sized(rows * d);
        self.heads.forward(&kept.q, &[(&kept.k, &kept.v)], tiles, mixed, logs);
        o.forward(mixed, y);
        x.iter_mut().zip(y.iter()).for_each(|(x, y)| *x += y);
    }

    fn feed_forward(&self, layer: &Layer<'_>, kept: &mut LayerTape, tape: &mut Tape) {
        let (d, [first, second]) = (self.shape.dim, &layer.ffn);
        let Tape { runs, time, x, y, hidden, .. } = tape;
        let rows = x.len() / d;
        kept.normal.sized(rows * d);
        kept.scales.sized(rows);
        for Run { rows, time: label } in runs.iter() {
            let (now, [_, _, _, shift, factor, _]) = (span(rows, d), time.rows(layer.at, *label, layer.modulation));
            let (normal, y) = (&mut kept.normal[now.clone()], &mut y[now.clone()]);
            rows::layer_norm(self.arch, &x[now], [factor, shift], normal, &mut kept.scales[rows.clone()], y);
        }
        first.forward(y, kept.hidden.sized(rows * self.shape.ffn));
        rows::gelu(self.arch, &kept.hidden, hidden.sized(rows * self.shape.ffn));
        second.forward(hidden, kept.out.sized(rows * d));
        for Run { rows, time: label } in runs.iter() {
            let (now, [.., gate]) = (span(rows, d), time.rows(layer.at, *label, layer.modulation));
            rows::gate(self.arch, &kept.out[now.clone()], gate, &mut x[now]);
        }
    }
}

/// Returns the keys and values that a link's queries see.
pub(super) fn seen<'a>(
    link: &Link,
    keys: &'a [f32],
    values: &'a [f32],
    copies: &'a [f32],
    moved: &[(usize, Rotary)],
    d: usize,
) -> Vec<(&'a [f32], &'a [f32])> {
    let mut pairs: Vec<_> = link.pieces.iter().map(|rows| (&keys[span(rows, d)], &values[span(rows, d)])).collect();
    if let Some(at) = link.moved {
        let first: usize = moved[..at].iter().map(|(rows, _)| rows * d).sum();
        pairs[0].0 = &copies[first..first + moved[at].0 * d];
    }
    pairs
}
