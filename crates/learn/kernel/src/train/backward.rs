//! The backward pass over the tape: from the gradient of the output to that of every weight.
//!
//! Rows before the first live one get no gradient and are left out. `dx` is the gradient of the residual stream, which
//! every branch adds to.

use std::ops::Range;

use ds_nn::array::Weights;

use super::attention::Attended;
use super::linear::sums;
use super::network::{Attention, AttentionTape, Cross, Layer, LayerTape, Network, Tape, seen, span};
use super::rows;
use super::sequence::{Run, Sequence, carve};
use super::time::TimeTape;
use crate::Buffer;

/// Gradients on their way back.
#[derive(Default)]
pub(super) struct Back {
    x: Buffer,
    y: Buffer,
    q: Buffer,
    k: Buffer,
    v: Buffer,
    moved: Buffer,
    /// Keys and values of the context.
    context_k: Buffer,
    context_v: Buffer,
    context: Buffer,
    prompt: Buffer,
    hidden: Buffer,
    control: Buffer,
    weight: Buffer,
}

/// Splits the six gradient rows of a time.
fn rows_of(d_rows: &mut [f32], time: usize, size: usize) -> [&mut [f32]; 6] {
    let mut parts = d_rows[time * size..(time + 1) * size].chunks_exact_mut(size / 6);
    std::array::from_fn(|_| parts.next().expect("a block has six rows"))
}

/// A backward pass: what went forward, what that kept, and where gradients lie and go.
pub(super) struct Backward<'a> {
    pub(super) network: &'a Network<'a>,
    pub(super) sequence: &'a Sequence<'a>,
    pub(super) tape: &'a mut Tape,
    pub(super) back: &'a mut Back,
    /// The gradients of all weights, which are added to.
    pub(super) gradient: &'a mut Weights,
}

impl Backward<'_> {
    /// Goes back, given the gradient of the output of the live rows, [live rows, 4, z].
    pub(super) fn run(mut self, d_output: &[f32]) {
        let network = self.network;
        self.back.context.sized(self.tape.context.len()).fill(0.0);
        self.leave(d_output);
        let mut layers = std::mem::take(&mut self.tape.layers);
        for (layer, kept) in network.layers.iter().zip(&mut layers).rev() {
            self.feed_forward(layer, kept);
            if let Some(cross) = &layer.cross {
                self.cross(cross, &kept.cross);
            }
            self.attend(layer, &mut kept.own);
            network.time.collect(sums(self.gradient, &format!("{}.modulation", layer.name)), &mut self.tape.time);
        }
        self.tape.layers = layers;
        self.enter();
        self.context();
        network.time.backward(network.arch, &mut self.tape.time, self.gradient);
    }

    /// Returns the rows that get gradients.
    fn live(&self) -> Range<usize> {
        let shape = self.network.shape;
        self.sequence.live * shape.tokens()..self.tape.x.len() / shape.dim
    }

    fn leave(&mut self, d_output: &[f32]) {
        let (live, Network { shape, arch, head, .. }) = (&self.live(), self.network);
        let d = shape.dim;
        let Tape { runs, time, normal, scales, y, .. } = &mut *self.tape;
        let dy = self.back.y.sized(live.len() * d);
        head.learn(*arch, d_output, &y[span(live, d)], self.gradient);
        head.back(d_output, dy, false);
        let dx = self.back.x.sized(live.len() * d);
        dx.fill(0.0);
        for (rows, now, label) in parts(runs, live, d) {
            let factor = time.head_rows(label, d)[1].to_vec();
            let (shifts, factors) = time.d_head[label * 2 * d..(label + 1) * 2 * d].split_at_mut(d);
            let saved = [&normal[span(&rows, d)], &scales[rows.clone()]];
            rows::layer_norm_back(*arch, &dy[now.clone()], &factor, saved, &mut dx[now], [factors, shifts]);
        }
    }

    fn feed_forward(&mut self, layer: &Layer<'_>, kept: &LayerTape) {
        let (live, arch, [first, second]) = (&self.live(), self.network.arch, &layer.ffn);
        let (d, ffn) = (self.network.shape.dim, self.network.shape.ffn);
        let Tape { runs, time, y, hidden, .. } = &mut *self.tape;
        let (dx, dy) = (&mut self.back.x, &mut self.back.y);
        for (rows, now, label) in parts(runs, live, d) {
            let (gate, sums) = gate_of(time, layer, label, 5);
            let out = &kept.out[span(&rows, d)];
            rows::gate_back(arch, &dx[now.clone()], &gate, out, &mut dy[now], sums);
        }
        let dh = self.back.hidden.sized(live.len() * ffn);
        second.back(dy, dh, false);
        let hidden = hidden.sized(live.len() * ffn);
        rows::gelu_back(arch, &kept.hidden[span(live, ffn)], hidden, dh);
        second.learn(arch, dy, hidden, self.gradient);
        first.back(dh, dy, false);
        let y = y.sized(live.len() * d);
        for (rows, now, label) in parts(runs, live, d) {
            let [_, _, _, shift, factor, _] = time.rows(layer.at, label, layer.modulation);
            rows::affine(arch, &kept.normal[span(&rows, d)], [factor, shift], &mut y[now]);
        }
        first.learn(arch, dh, y, self.gradient);
        self.modulation(layer, 3, [&kept.normal, &kept.scales]);
    }

    /// Goes back through a modulated layer norm whose shift is a given row and whose factor is the next.
    fn modulation(&mut self, layer: &Layer<'_>, row: usize, [normal, scales]: [&[f32]; 2]) {
        let (live, d) = (&self.live(), self.network.shape.dim);
        let (Tape { runs, time, .. }, Back { x: dx, y: dy, .. }) = (&mut *self.tape, &mut *self.back);
        for (rows, now, label) in parts(runs, live, d) {
            let factor = time.rows(layer.at, label, layer.modulation)[row + 1].to_vec();
            let mut sums = rows_of(&mut time.d_rows, label, 6 * d).into_iter().skip(row);
            let (shifts, factors) = (sums.next().expect("six rows"), sums.next().expect("six rows"));
            let saved = [&normal[span(&rows, d)], &scales[rows.clone()]];
            let (dy, dx) = (&dy[now.clone()], &mut dx[now]);
            rows::layer_norm_back(self.network.arch, dy, &factor, saved, dx, [factors, shifts]);
        }
    }

    fn cross(&mut self, cross: &Cross<'_>, kept: &AttentionTape) {
        let (live, Network { shape, arch, heads, .. }) = (&self.live(), self.network);
        let (d, now) = (shape.dim, span(live, shape.dim));
        let Attention { name, q, k, v, o, norm_k, .. } = &cross.attention;
        let Tape { context, tiles, .. } = &mut *self.tape;
        let Back { x: dx, y: dy, q: dq, context_k: dk, context_v: dv, .. } = &mut *self.back;
        o.learn(*arch, dx, &kept.mixed[now.clone()], self.gradient);
        o.back(dx, dy, false);
        let (dq, dk, dv) = (dq.sized(now.len()), dk.sized(context.len()), dv.sized(context.len()));
        dk.fill(0.0);
        dv.fill(0.0);
        let logs = per_head(&kept.logs, kept.logs.len() / heads.heads, live, heads.heads);
        let attended = Attended { seen: &[(&kept.k, &kept.v)], grown: &mut [Some((dk, dv))] };
        heads.backward([&kept.q[now.clone()], &kept.mixed[now.clone()], dy], attended, &logs, tiles, dq);
        self.query_norm(&cross.attention, kept);
        let Back { x: dx, y: dy, q: dq, context_k: dk, context_v: dv, context: d_context, weight, .. } =
            &mut *self.back;
        let Tape { context, y, .. } = &mut *self.tape;
        let norm = sums(self.gradient, &format!("{name}.norm_k.weight"));
        rows::rms_norm_back(*arch, dk, norm_k, [&kept.raw[1], &kept.raw_scales[1]], norm);
        k.learn(*arch, dk, context, self.gradient);
        v.learn(*arch, dv, context, self.gradient);
        k.back(dk, d_context, true);
        v.back(dv, d_context, true);
        let y = y.sized(now.len());
        rows::affine(*arch, &kept.normal[now.clone()], cross.norm, y);
        q.learn(*arch, dq, y, self.gradient);
        q.back(dq, dy, false);
        let base = name.strip_suffix("cross_attn").expect("so are they named");
        let both = weight.sized(2 * d);
        both.fill(0.0);
        let (factors, shifts) = both.split_at_mut(d);
        let saved = [&kept.normal[now], &kept.scales[live.clone()]];
        rows::layer_norm_back(*arch, dy, cross.norm[0], saved, dx, [factors, shifts]);
        for (part, from) in [("weight", factors), ("bias", shifts)] {
            let to = sums(self.gradient, &format!("{base}norm3.{part}"));
            to.iter_mut().zip(from.iter()).for_each(|(to, from)| *to += *from);
        }
    }

    /// Goes back through the norm of queries, whose weight was scaled.
    fn query_norm(&mut self, attention: &Attention<'_>, kept: &AttentionTape) {
        let live = self.live();
        let saved = [&kept.raw[0][span(&live, self.network.shape.dim)], &kept.raw_scales[0][live]];
        let own = self.back.weight.sized(attention.norm_q.len());
        own.fill(0.0);
        rows::rms_norm_back(self.network.arch, &mut self.back.q, &attention.norm_q, saved, own);
        let to = sums(self.gradient, &format!("{}.norm_q.weight", attention.name));
        to.iter_mut().zip(own.iter()).for_each(|(to, from)| *to += self.network.query_scale * from);
    }

    fn attend(&mut self, layer: &Layer<'_>, kept: &mut AttentionTape) {
        let (live, arch, d) = (&self.live(), self.network.arch, self.network.shape.dim);
        let now = span(live, d);
        let Attention { name, q, k, v, o, norm_k, .. } = &layer.own;
        let (Tape { runs, time, y, .. }, back) = (&mut *self.tape, &mut *self.back);
        for (rows, now, label) in parts(runs, live, d) {
            let (gate, sums) = gate_of(time, layer, label, 2);
            let out = &kept.out[span(&rows, d)];
            rows::gate_back(arch, &back.x[now.clone()], &gate, out, &mut back.y[now], sums);
        }
        // What was the gated output becomes the gradient of what attention mixed.
        let d_mixed = &mut kept.out[now.clone()];
        o.back(&back.y, d_mixed, false);
        o.learn(arch, &back.y, &kept.mixed[now.clone()], self.gradient);
        let y = y.sized(now.len());
        for (rows, now, label) in parts(runs, live, d) {
            let [shift, factor, ..] = time.rows(layer.at, label, layer.modulation);
            rows::affine(arch, &kept.normal[span(&rows, d)], [factor, shift], &mut y[now]);
        }
        self.links(kept);
        let Back { q: dq, k: dk, moved: d_moved, .. } = &mut *self.back;
        self.tape.rotary.undo(arch, dq, [0, d, d], live.start);
        self.tape.rotary.undo(arch, &mut dk[now.clone()], [0, d, d], live.start);
        let mut first = 0;
        for (rows, rotary) in &self.tape.moved {
            let part = &mut d_moved[first..first + rows * d];
            rotary.undo(arch, part, [0, d, d], 0);
            dk[..rows * d].iter_mut().zip(part.iter()).for_each(|(to, from)| *to += from);
            first += rows * d;
        }
        self.query_norm(&layer.own, kept);
        let Back { y: dy, q: dq, k: dk, v: dv, .. } = &mut *self.back;
        let (dk, dv) = (&mut dk[now.clone()], &dv[now.clone()]);
        let norm = sums(self.gradient, &format!("{name}.norm_k.weight"));
        rows::rms_norm_back(arch, dk, norm_k, [&kept.raw[1][now], &kept.raw_scales[1][live.clone()]], norm);
        for (at, (linear, d)) in [(q, &**dq), (k, dk), (v, dv)].into_iter().enumerate() {
            linear.learn(arch, d, &self.tape.y, self.gradient);
            linear.back(d, dy, at > 0);
        }
        self.modulation(layer, 0, [&kept.normal, &kept.scales]);
    }

    /// Goes back through the attention of all live groups. Gradients of keys and values are [rows, d].
    fn links(&mut self, kept: &AttentionTape) {
        let (live, Network { shape, heads, .. }) = (self.live(), self.network);
        let d = shape.dim;
        let (Tape { links, moved, tiles, .. }, back) = (&mut *self.tape, &mut *self.back);
        let (dk, dv) = (back.k.sized(kept.k.len()), back.v.sized(kept.v.len()));
        let (dq, d_moved) = (back.q.sized(live.len() * d), back.moved.sized(kept.moved.len()));
        [&mut *dk, &mut *dv, &mut *d_moved].into_iter().for_each(|d| d.fill(0.0));
        for link in links.iter().filter(|link| link.queries.start >= live.start) {
            let rows = span(&link.queries, d);
            let keys = seen(link, &kept.k, &kept.v, &kept.moved, moved, d);
            let mut to_keys = carve(dk, d, &link.pieces);
            if let Some(at) = link.moved {
                let first: usize = moved[..at].iter().map(|(rows, _)| rows * d).sum();
                to_keys[0] = &mut d_moved[first..first + moved[at].0 * d];
            }
            let pairs = to_keys.into_iter().zip(carve(dv, d, &link.pieces)).zip(&link.reached);
            let mut grown: Vec<_> = pairs.map(|(pair, reached)| reached.then_some(pair)).collect();
            heads.backward(
                [&kept.q[rows.clone()], &kept.mixed[rows.clone()], &kept.out[rows.clone()]],
                Attended { seen: &keys, grown: &mut grown },
                &kept.logs[span(&link.queries, heads.heads)],
                tiles,
                &mut dq[rows.start - live.start * d..rows.end - live.start * d],
            );
        }
    }

    /// Goes back through the patch embedding and the control latents.
    fn enter(&mut self) {
        let (live, sequence, Network { shape, arch, .. }) = (&self.live(), self.sequence, self.network);
        let (z, c, inputs) = (shape.latent_channels, shape.control_channels, shape.in_dim());
        let (tokens, patch, back) = (shape.tokens(), self.network.patch(), &mut *self.back);
        let own = back.weight.sized(self.network.patch.len());
        own.fill(0.0);
        patch.learn_weight(&back.x, &self.tape.input[span(live, 4 * inputs)], own);
        let to = sums(self.gradient, "patch_embedding.weight").chunks_exact_mut(4 * inputs);
        for (to, from) in to.zip(own.chunks_exact(4 * inputs)) {
            from.iter().enumerate().for_each(|(at, from)| to[at % inputs * 4 + at / inputs] += from);
        }
        rows::column_sums(*arch, &back.x, sums(self.gradient, "patch_embedding.bias"));
        if sequence.layout_on == 0.0 {
            return;
        }
        let positions = &sequence.positions[sequence.live..];
        let (first, last) = (positions.iter().min(), positions.iter().max());
        let (Some(first), Some(last)) = (first, last) else { return };
        let frame = tokens * 4 * c;
        let control = back.control.sized((last + 1 - first) * frame);
        control.fill(0.0);
        for (position, dx) in positions.iter().zip(back.x.chunks_exact(tokens * shape.dim)) {
            let to = &mut control[(position - first) * frame..][..frame];
            for pixel in 0..4 {
                let inputs = pixel * inputs + z..pixel * inputs + z + c;
                patch.back_part(dx, inputs, &mut to[pixel * c..], 4 * c);
            }
        }
        control.iter_mut().for_each(|d| *d *= sequence.layout_on);
        let layouts = tokens * 4 * shape.control_inputs;
        let layouts = &sequence.layouts[first * layouts..(last + 1) * layouts];
        self.network.control.learn(*arch, control, layouts, self.gradient);
    }

    /// Goes back through the prompt and the first frame.
    fn context(&mut self) {
        let (Network { shape, arch, image, text, .. }, back) = (self.network, &mut *self.back);
        let split = if image.is_some() { shape.tokens() * shape.dim } else { 0 };
        if let Some(image) = image {
            image.learn(*arch, &back.context[..split], &self.sequence.start, self.gradient);
        }
        if let Some([first, second]) = text {
            let ([raw, _], d) = (&self.tape.prompt, &back.context[split..]);
            let d_prompt = back.prompt.sized(raw.len());
            second.back(d, d_prompt, false);
            let hidden = back.hidden.sized(raw.len());
            rows::gelu_back(*arch, raw, hidden, d_prompt);
            second.learn(*arch, d, hidden, self.gradient);
            first.learn(*arch, d_prompt, &self.sequence.text, self.gradient);
        }
    }
}

/// Lists the live rows by run: rows of the tape, their values among the live ones, and the run's time.
fn parts<'a>(
    runs: &'a [Run],
    live: &'a Range<usize>,
    d: usize,
) -> impl Iterator<Item = (Range<usize>, Range<usize>, usize)> + 'a {
    runs.iter().filter_map(move |run| {
        let rows = run.rows.start.max(live.start)..run.rows.end;
        let now = || (rows.start - live.start) * d..(rows.end - live.start) * d;
        (!rows.is_empty()).then(|| (rows.clone(), now(), run.time))
    })
}

/// Returns a gate and where its gradient goes.
fn gate_of<'a>(time: &'a mut TimeTape, layer: &Layer<'_>, label: usize, row: usize) -> (Vec<f32>, &'a mut [f32]) {
    let gate = time.rows(layer.at, label, layer.modulation)[row].to_vec();
    let size = layer.modulation.len();
    (gate, rows_of(&mut time.d_rows, label, size).into_iter().nth(row).expect("a block has six rows"))
}

/// Returns the logs [heads, live rows] out of [heads, rows].
fn per_head(logs: &[f32], rows: usize, live: &Range<usize>, heads: usize) -> Vec<f32> {
    (0..heads).flat_map(|head| logs[head * rows..][live.clone()].iter().copied()).collect()
}
