//! The backward pass over the tape: from the gradient of the output to that of every weight.
//!
//! Rows before the first live one get no gradient and are left out. `dx` is the gradient of the residual stream, which
//! every branch adds to.

use std::ops::Range;

use ds_nn::array::Weights;

use super::linear::sums;
use super::network::{Attention, AttentionTape, Cross, Layer, LayerTape, Network, Tape, seen, span};
use super::rows;
use super::sequence::{Run, Sequence, carve};
use super::time::TimeTape;
use crate::Buffer;
use crate::rotary::Rotary;

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

impl Network<'_> {
    /// Adds the gradients of all weights, given that of the output of the live rows, [live rows, 4, z].
    pub(super) fn backward(
        &self,
        sequence: &Sequence<'_>,
        d_output: &[f32],
        (tape, back): (&mut Tape, &mut Back),
        gradient: &mut Weights,
    ) {
        let d = self.shape.dim;
        let live = sequence.live * self.shape.tokens()..tape.x.len() / d;
        back.context.sized(tape.context.len()).fill(0.0);
        self.leave(&live, d_output, (tape, back), gradient);
        let mut layers = std::mem::take(&mut tape.layers);
        for (at, (layer, kept)) in self.layers.iter().zip(&mut layers).enumerate().rev() {
            self.feed_forward_back((at, layer, kept), &live, (tape, back), gradient);
            if let Some(cross) = &layer.cross {
                self.cross_back((cross, &kept.cross), &live, (tape, back), gradient);
            }
            self.attend_back((at, layer, &mut kept.own), &live, (tape, back), gradient);
            self.time.collect(sums(gradient, &format!("{}.modulation", layer.name)), &mut tape.time);
        }
        tape.layers = layers;
        self.enter_back(sequence, &live, (tape, back), gradient);
        self.context_back(sequence, (tape, back), gradient);
        self.time.backward(self.arch, &mut tape.time, gradient);
    }

    fn leave(
        &self,
        live: &Range<usize>,
        d_output: &[f32],
        (tape, back): (&mut Tape, &mut Back),
        gradient: &mut Weights,
    ) {
        let d = self.shape.dim;
        let Tape { runs, time, normal, scales, y, .. } = tape;
        let dy = back.y.sized(live.len() * d);
        self.head.learn(self.arch, d_output, &y[span(live, d)], gradient);
        self.head.back(d_output, dy, false);
        let dx = back.x.sized(live.len() * d);
        dx.fill(0.0);
        for (rows, now, label) in parts(runs, live, d) {
            let factor = time.head_rows(label, d)[1].to_vec();
            let (shifts, factors) = time.d_head[label * 2 * d..(label + 1) * 2 * d].split_at_mut(d);
            let saved = [&normal[span(&rows, d)], &scales[rows.clone()]];
            rows::layer_norm_back(self.arch, &dy[now.clone()], &factor, saved, &mut dx[now], [factors, shifts]);
        }
    }

    fn feed_forward_back(
        &self,
        (at, layer, kept): (usize, &Layer<'_>, &LayerTape),
        live: &Range<usize>,
        (tape, back): (&mut Tape, &mut Back),
        gradient: &mut Weights,
    ) {
        let (d, ffn, [first, second]) = (self.shape.dim, self.shape.ffn, &layer.ffn);
        let Tape { runs, time, y, hidden, .. } = tape;
        let (dx, dy) = (&mut back.x, &mut back.y);
        for (rows, now, label) in parts(runs, live, d) {
            let (gate, sums) = gate_of(time, (at, layer), label, 5);
            let out = &kept.out[span(&rows, d)];
            rows::gate_back(self.arch, &dx[now.clone()], &gate, out, &mut dy[now], sums);
        }
        let dh = back.hidden.sized(live.len() * ffn);
        second.back(dy, dh, false);
        let hidden = hidden.sized(live.len() * ffn);
        rows::gelu_back(self.arch, &kept.hidden[span(live, ffn)], hidden, dh);
        second.learn(self.arch, dy, hidden, gradient);
        first.back(dh, dy, false);
        let y = y.sized(live.len() * d);
        for (rows, now, label) in parts(runs, live, d) {
            let [_, _, _, shift, factor, _] = time.rows(at, label, layer.modulation);
            rows::affine(self.arch, &kept.normal[span(&rows, d)], [factor, shift], &mut y[now]);
        }
        first.learn(self.arch, dh, y, gradient);
        let saved = [&*kept.normal, &*kept.scales];
        self.modulation_back((at, layer, 3), saved, live, (runs, time), (dx, dy));
    }

    /// Goes back through a modulated layer norm whose shift is a given row and whose factor is the next.
    fn modulation_back(
        &self,
        (at, layer, row): (usize, &Layer<'_>, usize),
        [normal, scales]: [&[f32]; 2],
        live: &Range<usize>,
        (runs, time): (&[Run], &mut TimeTape),
        (dx, dy): (&mut [f32], &[f32]),
    ) {
        let d = self.shape.dim;
        for (rows, now, label) in parts(runs, live, d) {
            let factor = time.rows(at, label, layer.modulation)[row + 1].to_vec();
            let mut sums = rows_of(&mut time.d_rows, label, 6 * d).into_iter().skip(row);
            let (shifts, factors) = (sums.next().expect("six rows"), sums.next().expect("six rows"));
            let saved = [&normal[span(&rows, d)], &scales[rows.clone()]];
            rows::layer_norm_back(self.arch, &dy[now.clone()], &factor, saved, &mut dx[now], [factors, shifts]);
        }
    }

    fn cross_back(
        &self,
        (cross, kept): (&Cross<'_>, &AttentionTape),
        live: &Range<usize>,
        (tape, back): (&mut Tape, &mut Back),
        gradient: &mut Weights,
    ) {
        let (d, heads) = (self.shape.dim, self.heads.heads);
        let Attention { name, q, k, v, o, norm_q, norm_k } = &cross.attention;
        let Tape { context, y, tiles, .. } = tape;
        let Back { x: dx, y: dy, q: dq, context_k: dk, context_v: dv, context: d_context, weight, .. } = back;
        let now = span(live, d);
        o.learn(self.arch, dx, &kept.mixed[now.clone()], gradient);
        o.back(dx, dy, false);
        let (dq, dk, dv) = (dq.sized(now.len()), dk.sized(context.len()), dv.sized(context.len()));
        dk.fill(0.0);
        dv.fill(0.0);
        let logs = per_head(&kept.logs, kept.logs.len() / heads, live, heads);
        self.heads.backward(
            [&kept.q[now.clone()], &kept.mixed[now.clone()], dy],
            (&[(&kept.k, &kept.v)], &mut [Some((dk, dv))]),
            &logs,
            tiles,
            dq,
        );
        self.query_norm_back(
            name,
            norm_q,
            [&kept.raw[0][now.clone()], &kept.raw_scales[0][live.clone()]],
            (dq, weight),
            gradient,
        );
        let norm = sums(gradient, &format!("{name}.norm_k.weight"));
        rows::rms_norm_back(self.arch, dk, norm_k, [&kept.raw[1], &kept.raw_scales[1]], norm);
        k.learn(self.arch, dk, context, gradient);
        v.learn(self.arch, dv, context, gradient);
        k.back(dk, d_context, true);
        v.back(dv, d_context, true);
        let y = y.sized(now.len());
        rows::affine(self.arch, &kept.normal[now.clone()], cross.norm, y);
        q.learn(self.arch, dq, y, gradient);
        q.back(dq, dy, false);
        let base = name.strip_suffix("cross_attn").expect("so are they named");
        let sums = weight.sized(2 * d);
        sums.fill(0.0);
        let (factors, shifts) = sums.split_at_mut(d);
        let saved = [&kept.normal[now], &kept.scales[live.clone()]];
        rows::layer_norm_back(self.arch, dy, cross.norm[0], saved, dx, [factors, shifts]);
        for (part, from) in [("weight", factors), ("bias", shifts)] {
            let to = self::sums(gradient, &format!("{base}norm3.{part}"));
            to.iter_mut().zip(from.iter()).for_each(|(to, from)| *to += *from);
        }
    }

    /// Goes back through the norm of queries, whose weight was scaled.
    fn query_norm_back(
        &self,
        name: &str,
        norm: &[f32],
        saved: [&[f32]; 2],
        (dq, weight): (&mut [f32], &mut Buffer),
        gradient: &mut Weights,
    ) {
        let own = weight.sized(norm.len());
        own.fill(0.0);
        rows::rms_norm_back(self.arch, dq, norm, saved, own);
        let to = sums(gradient, &format!("{name}.norm_q.weight"));
        to.iter_mut().zip(own.iter()).for_each(|(to, from)| *to += self.query_scale * from);
    }

    fn attend_back(
        &self,
        (at, layer, kept): (usize, &Layer<'_>, &mut AttentionTape),
        live: &Range<usize>,
        (tape, back): (&mut Tape, &mut Back),
        gradient: &mut Weights,
    ) {
        let (d, now) = (self.shape.dim, span(live, self.shape.dim));
        let Attention { name, q, k, v, o, norm_q, norm_k } = &layer.own;
        let Tape { runs, time, y, rotary, .. } = tape;
        for (rows, now, label) in parts(runs, live, d) {
            let (gate, sums) = gate_of(time, (at, layer), label, 2);
            let out = &kept.out[span(&rows, d)];
            rows::gate_back(self.arch, &back.x[now.clone()], &gate, out, &mut back.y[now], sums);
        }
        // What was the gated output becomes the gradient of what attention mixed.
        let d_mixed = &mut kept.out[now.clone()];
        o.back(&back.y, d_mixed, false);
        o.learn(self.arch, &back.y, &kept.mixed[now.clone()], gradient);
        let y = y.sized(now.len());
        for (rows, now, label) in parts(runs, live, d) {
            let [shift, factor, ..] = time.rows(at, label, layer.modulation);
            rows::affine(self.arch, &kept.normal[span(&rows, d)], [factor, shift], &mut y[now]);
        }
        self.links_back(kept, live, (&tape.links, &tape.moved, &mut tape.tiles), back);
        let Back { x: dx, y: dy, q: dq, k: dk, v: dv, moved: d_moved, weight, .. } = back;
        rotary.undo(self.arch, dq, [0, d, d], live.start);
        rotary.undo(self.arch, &mut dk[now.clone()], [0, d, d], live.start);
        let mut first = 0;
        for (rows, rotary) in &tape.moved {
            let part = &mut d_moved[first..first + rows * d];
            rotary.undo(self.arch, part, [0, d, d], 0);
            dk[..rows * d].iter_mut().zip(part.iter()).for_each(|(to, from)| *to += from);
            first += rows * d;
        }
        let (dk, dv) = (&mut dk[now.clone()], &dv[now.clone()]);
        self.query_norm_back(
            name,
            norm_q,
            [&kept.raw[0][now.clone()], &kept.raw_scales[0][live.clone()]],
            (dq, weight),
            gradient,
        );
        let norm = sums(gradient, &format!("{name}.norm_k.weight"));
        rows::rms_norm_back(self.arch, dk, norm_k, [&kept.raw[1][now], &kept.raw_scales[1][live.clone()]], norm);
        for (at, (linear, d)) in [(q, &**dq), (k, dk), (v, dv)].into_iter().enumerate() {
            linear.learn(self.arch, d, &tape.y, gradient);
            linear.back(d, dy, at > 0);
        }
        let saved = [&*kept.normal, &*kept.scales];
        self.modulation_back((at, layer, 0), saved, live, (&tape.runs, &mut tape.time), (dx, dy));
    }

    /// Goes back through the attention of all live groups. Gradients of keys and values are [rows, d].
    fn links_back(
        &self,
        kept: &AttentionTape,
        live: &Range<usize>,
        (links, moved, tiles): (&[super::sequence::Link], &[(usize, Rotary)], &mut super::attention::Tiles),
        back: &mut Back,
    ) {
        let (d, heads) = (self.shape.dim, self.heads.heads);
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
            self.heads.backward(
                [&kept.q[rows.clone()], &kept.mixed[rows.clone()], &kept.out[rows.clone()]],
                (&keys, &mut grown),
                &kept.logs[span(&link.queries, heads)],
                tiles,
                &mut dq[rows.start - live.start * d..rows.end - live.start * d],
            );
        }
    }

    /// Goes back through the patch embedding and the control latents.
    fn enter_back(
        &self,
        sequence: &Sequence<'_>,
        live: &Range<usize>,
        (tape, back): (&Tape, &mut Back),
        gradient: &mut Weights,
    ) {
        let (z, c, inputs) = (self.shape.latent_channels, self.shape.control_channels, self.shape.in_dim());
        let (tokens, patch) = (self.shape.tokens(), self.patch());
        let own = back.weight.sized(self.patch.len());
        own.fill(0.0);
        patch.learn_weight(&back.x, &tape.input[span(live, 4 * inputs)], own);
        let to = sums(gradient, "patch_embedding.weight").chunks_exact_mut(4 * inputs);
        for (to, from) in to.zip(own.chunks_exact(4 * inputs)) {
            from.iter().enumerate().for_each(|(at, from)| to[at % inputs * 4 + at / inputs] += from);
        }
        rows::column_sums(self.arch, &back.x, sums(gradient, "patch_embedding.bias"));
        if sequence.layout_on == 0.0 {
            return;
        }
        let positions = &sequence.positions[sequence.live..];
        let (first, last) = (positions.iter().min(), positions.iter().max());
        let (Some(first), Some(last)) = (first, last) else { return };
        let frame = tokens * 4 * c;
        let control = back.control.sized((last + 1 - first) * frame);
        control.fill(0.0);
        for (position, dx) in positions.iter().zip(back.x.chunks_exact(tokens * self.shape.dim)) {
            let to = &mut control[(position - first) * frame..][..frame];
            for pixel in 0..4 {
                patch.back_part(dx, (pixel * inputs + z, c), &mut to[pixel * c..], 4 * c);
            }
        }
        control.iter_mut().for_each(|d| *d *= sequence.layout_on);
        let layouts = tokens * 4 * self.shape.control_inputs;
        self.control.learn(self.arch, control, &sequence.layouts[first * layouts..(last + 1) * layouts], gradient);
    }

    /// Goes back through the prompt and the first frame.
    fn context_back(&self, sequence: &Sequence<'_>, (tape, back): (&Tape, &mut Back), gradient: &mut Weights) {
        let split = if self.image.is_some() { self.shape.tokens() * self.shape.dim } else { 0 };
        if let Some(image) = &self.image {
            image.learn(self.arch, &back.context[..split], &sequence.start, gradient);
        }
        if let Some([first, second]) = &self.text {
            let ([raw, _], d) = (&tape.prompt, &back.context[split..]);
            let d_prompt = back.prompt.sized(raw.len());
            second.back(d, d_prompt, false);
            let hidden = back.hidden.sized(raw.len());
            rows::gelu_back(self.arch, raw, hidden, d_prompt);
            second.learn(self.arch, d, hidden, gradient);
            first.learn(self.arch, d_prompt, &sequence.text, gradient);
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
fn gate_of<'a>(
    time: &'a mut TimeTape,
    (at, layer): (usize, &Layer<'_>),
    label: usize,
    row: usize,
) -> (Vec<f32>, &'a mut [f32]) {
    let gate = time.rows(at, label, layer.modulation)[row].to_vec();
    let size = layer.modulation.len();
    (gate, rows_of(&mut time.d_rows, label, size).into_iter().nth(row).expect("a block has six rows"))
}

/// Returns the logs [heads, live rows] out of [heads, rows].
fn per_head(logs: &[f32], rows: usize, live: &Range<usize>, heads: usize) -> Vec<f32> {
    (0..heads).flat_map(|head| logs[head * rows..][live.clone()].iter().copied()).collect()
}
