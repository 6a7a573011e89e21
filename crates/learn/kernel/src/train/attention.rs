//! Softmax attention with its backward pass, head by head and some queries at a time.
//!
//! Queries carry the factor log2(e) / √width, so that weights are powers of two. Forward keeps the log of each row's
//! sum alone; backward computes the weights p again and turns their gradients into those of scores,
//! ds = ln 2 · p·(dp − Σ p·dp), where Σ p·dp is the output times its gradient.

use super::matrix::{View, multiply};
use super::rows;
use crate::Buffer;
use crate::arch::Arch;

/// Queries worked on together.
const TILE: usize = 128;

/// Keys or values [rows, heads·width] seen by some queries, one slice of rows after the other.
pub(super) type Seen<'a> = [(&'a [f32], &'a [f32])];

/// Gradients of keys and values, added to what is there; none where they stop.
pub(super) type Grown<'a> = [Option<(&'a mut [f32], &'a mut [f32])>];

/// Keys and values that queries saw, and their gradients.
pub(super) struct Attended<'a, 'g> {
    pub(super) seen: &'a Seen<'a>,
    pub(super) grown: &'a mut Grown<'g>,
}

/// Tiles of attention.
#[derive(Default)]
pub(super) struct Tiles {
    weights: Buffer,
    d: Buffer,
    totals: Buffer,
}

/// Sizes of attention.
#[derive(Clone, Copy)]
pub(super) struct Heads {
    pub(super) arch: Arch,
    pub(super) heads: usize,
    pub(super) width: usize,
}

impl Heads {
    fn dim(self) -> usize {
        self.heads * self.width
    }

    fn part(self, rows: &[f32], head: usize) -> View<'_> {
        View::new(&rows[head * self.width..], rows.len() / self.dim(), self.width, self.dim())
    }

    /// Scores of some queries against all keys, side by side.
    fn scores(self, head: usize, queries: &[f32], seen: &Seen<'_>, tile: &mut [f32]) {
        let (rows, mut at) = (queries.len() / self.dim(), 0);
        let width = tile.len() / rows;
        for (keys, _) in seen {
            multiply(&mut tile[at..], width, false, self.part(queries, head), self.part(keys, head).turned());
            at += keys.len() / self.dim();
        }
    }

    /// Attends from queries [rows, heads·width]; `logs` is [heads, rows].
    pub(super) fn forward(self, q: &[f32], seen: &Seen<'_>, tiles: &mut Tiles, out: &mut [f32], logs: &mut [f32]) {
        let dim = self.dim();
        let width: usize = seen.iter().map(|(keys, _)| keys.len() / dim).sum();
        for (head, logs) in logs.chunks_exact_mut(q.len() / dim).enumerate() {
            let parts = q.chunks(TILE * dim).zip(out.chunks_mut(TILE * dim)).zip(logs.chunks_mut(TILE));
            for ((q, out), logs) in parts {
                let rows = q.len() / dim;
                tiles.weights.resize(rows * width);
                tiles.totals.resize(rows);
                self.scores(head, q, seen, &mut tiles.weights);
                rows::softmax(self.arch, &mut tiles.weights, width, &mut tiles.totals, logs);
                let mut at = 0;
                for (_, values) in seen {
                    let count = values.len() / dim;
                    let weights = View::new(&tiles.weights[at..], rows, count, width);
                    multiply(&mut out[head * self.width..], dim, at > 0, weights, self.part(values, head));
                    at += count;
                }
                for (row, total) in out.chunks_exact_mut(dim).zip(tiles.totals.iter()) {
                    let factor = 1.0 / total;
                    row[head * self.width..(head + 1) * self.width].iter_mut().for_each(|x| *x *= factor);
                }
            }
        }
    }

    /// Goes back through [`Self::forward`]: sets the gradient of the queries and adds those of keys and values.
    pub(super) fn backward(
        self,
        [q, out, d_out]: [&[f32]; 3],
        mut attended: Attended<'_, '_>,
        logs: &[f32],
        tiles: &mut Tiles,
        dq: &mut [f32],
    ) {
        let dim = self.dim();
        let width: usize = attended.seen.iter().map(|(keys, _)| keys.len() / dim).sum();
        for (head, logs) in logs.chunks_exact(q.len() / dim).enumerate() {
            for first in (0..q.len() / dim).step_by(TILE) {
                let rows = TILE.min(q.len() / dim - first);
                let now = first * dim..(first + rows) * dim;
                let (q, out, d_out) = (&q[now.clone()], &out[now.clone()], &d_out[now.clone()]);
                tiles.weights.resize(rows * width);
                tiles.d.resize(rows * width);
                tiles.totals.resize(rows);
                self.scores(head, q, attended.seen, &mut tiles.weights);
                rows::softmax_again(self.arch, &mut tiles.weights, width, &logs[first..first + rows]);
                let at = head * self.width;
                rows::dots(self.arch, &out[at..], &d_out[at..], [self.width, dim], &mut tiles.totals);
                self.values(head, d_out, &mut attended, tiles);
                rows::softmax_back(self.arch, &tiles.weights, width, &tiles.totals, &mut tiles.d);
                self.keys(head, q, &mut attended, tiles, &mut dq[now]);
            }
        }
    }

    /// Gradients of weights and values.
    fn values(self, head: usize, d_out: &[f32], attended: &mut Attended<'_, '_>, tiles: &mut Tiles) {
        let (dim, rows) = (self.dim(), d_out.len() / self.dim());
        let (width, d_out, mut at) = (tiles.d.len() / rows, self.part(d_out, head), 0);
        for ((_, values), grown) in attended.seen.iter().zip(attended.grown.iter_mut()) {
            let count = values.len() / dim;
            multiply(&mut tiles.d[at..], width, false, d_out, self.part(values, head).turned());
            if let Some((_, dv)) = grown {
                let weights = View::new(&tiles.weights[at..], rows, count, width);
                multiply(&mut dv[head * self.width..], dim, true, weights.turned(), d_out);
            }
            at += count;
        }
    }

    /// Gradients of queries and keys.
    fn keys(self, head: usize, q: &[f32], attended: &mut Attended<'_, '_>, tiles: &Tiles, dq: &mut [f32]) {
        let (dim, rows) = (self.dim(), q.len() / self.dim());
        let (width, mut at) = (tiles.d.len() / rows, 0);
        for ((keys, _), grown) in attended.seen.iter().zip(attended.grown.iter_mut()) {
            let count = keys.len() / dim;
            let d = View::new(&tiles.d[at..], rows, count, width);
            multiply(&mut dq[head * self.width..], dim, at > 0, d, self.part(keys, head));
            if let Some((dk, _)) = grown {
                multiply(&mut dk[head * self.width..], dim, true, d.turned(), self.part(q, head));
            }
            at += count;
        }
    }
}
