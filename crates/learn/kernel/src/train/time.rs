//! The time embedding, and the modulation rows that it gives each layer for each distinct time.

use ds_nn::array::Weights;
use ds_nn::dit::DitShape;

use super::linear::{Linear, sums, values};
use super::rows;
use crate::Buffer;
use crate::arch::Arch;

/// The layers of the time embedding, and the modulation of all blocks.
pub(super) struct Time<'a> {
    layers: [Linear<'a>; 3],
    modulations: Vec<&'a [f32]>,
    head: &'a [f32],
    half: usize,
}

/// What the pass through the embedding keeps, and the modulation rows.
#[derive(Default)]
pub(super) struct TimeTape {
    waves: Buffer,
    raw: Buffer,
    hidden: Buffer,
    e: Buffer,
    silu: Buffer,
    e0: Buffer,
    /// Per block and time six rows: shift, factor and gate, twice.
    table: Buffer,
    /// Per time two rows: shift and factor.
    head: Buffer,
    /// Gradients of the rows of one block, of all blocks together, of the head, and of the embedding's layers.
    pub(super) d_rows: Buffer,
    d_all: Buffer,
    pub(super) d_head: Buffer,
    d: [Buffer; 2],
    times: usize,
}

impl TimeTape {
    /// Returns the six rows of a block at a time.
    pub(super) fn rows(&self, block: usize, time: usize, modulation: &[f32]) -> [&[f32]; 6] {
        let size = modulation.len();
        let rows = &self.table[(block * self.times + time) * size..][..size];
        std::array::from_fn(|row| &rows[row * size / 6..(row + 1) * size / 6])
    }

    /// Returns the two rows of the head at a time.
    pub(super) fn head_rows(&self, time: usize, d: usize) -> [&[f32]; 2] {
        let rows = &self.head[time * 2 * d..(time + 1) * 2 * d];
        [&rows[..d], &rows[d..]]
    }
}

impl<'a> Time<'a> {
    pub(super) fn new(shape: &DitShape, weights: &'a Weights) -> Self {
        let modulation = |layer: usize| values(weights, &format!("blocks.{layer}.modulation"));
        Self {
            layers: ["time_embedding.0", "time_embedding.2", "time_projection.1"]
                .map(|name| Linear::new(weights, name)),
            modulations: (0..shape.layers).map(modulation).collect(),
            head: values(weights, "head.modulation"),
            half: shape.freq_dim / 2,
        }
    }

    /// Fills the tables of rows for some times: cosines first, angles in f64.
    pub(super) fn forward(&self, arch: Arch, times: &[f32], tape: &mut TimeTape) {
        let (half, [first, second, project]) = (self.half, &self.layers);
        let d = first.outputs();
        tape.times = times.len();
        let waves = tape.waves.sized(times.len() * 2 * half);
        for (time, row) in times.iter().zip(waves.chunks_exact_mut(2 * half)) {
            let angle = |i: usize| f64::from(*time) * 10_000f64.powf(-(i as f64) / half as f64);
            #[expect(clippy::cast_possible_truncation, reason = "the embedding is single precision")]
            for i in 0..half {
                (row[i], row[half + i]) = (angle(i).cos() as f32, angle(i).sin() as f32);
            }
        }
        let values = times.len() * d;
        first.forward(waves, tape.raw.sized(values));
        rows::silu(arch, &tape.raw, tape.hidden.sized(values));
        second.forward(&tape.hidden, tape.e.sized(values));
        rows::silu(arch, &tape.e, tape.silu.sized(values));
        project.forward(&tape.silu, tape.e0.sized(6 * values));
        let table = tape.table.sized(self.modulations.len() * 6 * values);
        for (rows, own) in table.chunks_exact_mut(6 * values).zip(&self.modulations) {
            for (at, (to, e0)) in rows.iter_mut().zip(tape.e0.iter()).enumerate() {
                // Scales are kept as factors.
                let one = if at / d % 3 == 1 { 1.0 } else { 0.0 };
                *to = e0 + own[at % (6 * d)] + one;
            }
        }
        for (at, to) in tape.head.sized(2 * values).iter_mut().enumerate() {
            let (time, row, column) = (at / (2 * d), at / d % 2, at % d);
            *to = tape.e[time * d + column] + self.head[row * d + column] + if row == 1 { 1.0 } else { 0.0 };
        }
        tape.d_rows.sized(6 * values).fill(0.0);
        tape.d_all.sized(6 * values).fill(0.0);
        tape.d_head.sized(2 * values).fill(0.0);
    }

    /// Takes the gradients of a block's rows over, and clears them.
    pub(super) fn collect(&self, modulation: &mut [f32], tape: &mut TimeTape) {
        let size = modulation.len();
        for (d, all) in tape.d_rows.chunks_exact_mut(size).zip(tape.d_all.chunks_exact_mut(size)) {
            for ((d, all), own) in d.iter_mut().zip(all).zip(modulation.iter_mut()) {
                *all += *d;
                *own += *d;
                *d = 0.0;
            }
        }
    }

    /// Goes back through the embedding.
    pub(super) fn backward(&self, arch: Arch, tape: &mut TimeTape, gradient: &mut Weights) {
        let [first, second, project] = &self.layers;
        let d = first.outputs();
        let TimeTape { waves, raw, hidden, e, silu, d_all, d_head, d: [de, dh], times, .. } = tape;
        project.learn(arch, d_all, silu, gradient);
        project.back(d_all, de.sized(*times * d), false);
        rows::silu_back(arch, e, de);
        let own = sums(gradient, "head.modulation");
        for (rows, de) in d_head.chunks_exact(2 * d).zip(de.chunks_exact_mut(d)) {
            own.iter_mut().zip(rows).for_each(|(own, d)| *own += d);
            de.iter_mut().zip(&rows[..d]).zip(&rows[d..]).for_each(|((de, a), b)| *de += a + b);
        }
        second.learn(arch, de, hidden, gradient);
        second.back(de, dh.sized(*times * d), false);
        rows::silu_back(arch, raw, dh);
        first.learn(arch, dh, waves, gradient);
    }
}
