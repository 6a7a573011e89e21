//! Norms, gates and activations over rows, forward and backward, each one pass in the processor's vectors.
//!
//! With x̂ = (x − mean)·s and y = x̂·f + b of a layer norm, g = dy·f: dx = s·(g − mean(g) − x̂·mean(g·x̂)). The root mean
//! square norm is the same without the means of x and g. Sums over rows (gradients of f, b, gates and biases) add to
//! what is there, row after row.

use pulp::{Simd, WithSimd};

use crate::arch::Arch;
use crate::lanes::{LANES, erf, exp2, exponentials, largest, sum};

const EPSILON: f32 = 1e-6;

/// Declares a function whose body is compiled for the processor's vectors.
macro_rules! vectorised {
    ($($(#[$doc:meta])* fn $name:ident<$life:lifetime>($($arg:ident: $type:ty),* $(,)?) $body:block)*) => { $(
        $(#[$doc])*
        pub(super) fn $name<$life>(arch: Arch, $($arg: $type),*) {
            struct Op<$life>($($type),*);
            impl<$life> WithSimd for Op<$life> {
                type Output = ();

                #[inline(always)]
                fn with_simd<S: Simd>(self, _: S) {
                    let Self($($arg),*) = self;
                    $body
                }
            }
            arch.dispatch(Op($($arg),*));
        }
    )* };
}

/// Σ a·b.
#[inline(always)]
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut lanes = [0.0; LANES];
    let ((chunks, rest), (others, other_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    for (chunk, other) in chunks.iter().zip(others) {
        for lane in 0..LANES {
            lanes[lane] += chunk[lane] * other[lane];
        }
    }
    for (lane, (a, b)) in lanes.iter_mut().zip(rest.iter().zip(other_rest)) {
        *lane += a * b;
    }
    sum(&lanes, |x| x)
}

vectorised! {
    /// Layer norm of rows of x: x̂, its scale per row, and y = x̂·factor + shift.
    fn layer_norm<'a>(
        x: &'a [f32],
        affine: [&'a [f32]; 2],
        normal: &'a mut [f32],
        scales: &'a mut [f32],
        y: &'a mut [f32],
    ) {
        let width = affine[0].len();
        let rows = x.chunks_exact(width).zip(normal.chunks_exact_mut(width)).zip(y.chunks_exact_mut(width));
        for (((x, normal), y), scale) in rows.zip(scales) {
            let mean = sum(x, |x| x) / width as f32;
            let variance = sum(x, |x| (x - mean) * (x - mean)) / width as f32;
            *scale = 1.0 / (variance + EPSILON).sqrt();
            for ((((y, n), x), f), b) in y.iter_mut().zip(normal).zip(x).zip(affine[0]).zip(affine[1]) {
                *n = (x - mean) * *scale;
                *y = *n * f + b;
            }
        }
    }

    /// y = x̂·factor + shift.
    fn affine<'a>(normal: &'a [f32], affine: [&'a [f32]; 2], y: &'a mut [f32]) {
        let width = affine[0].len();
        for (normal, y) in normal.chunks_exact(width).zip(y.chunks_exact_mut(width)) {
            for (((y, n), f), b) in y.iter_mut().zip(normal).zip(affine[0]).zip(affine[1]) {
                *y = n * f + b;
            }
        }
    }

    /// Adds the gradient of a layer norm to dx, that of factor and shift to `sums`.
    fn layer_norm_back<'a>(
        dy: &'a [f32],
        factor: &'a [f32],
        saved: [&'a [f32]; 2],
        dx: &'a mut [f32],
        sums: [&'a mut [f32]; 2],
    ) {
        let (width, [normal, scales], [factors, shifts]) = (factor.len(), saved, sums);
        let rows = dy.chunks_exact(width).zip(normal.chunks_exact(width)).zip(dx.chunks_exact_mut(width));
        for (((dy, normal), dx), scale) in rows.zip(scales) {
            let (mut means, mut products) = ([0.0; LANES], [0.0; LANES]);
            let lines = dy.chunks(LANES).zip(normal.chunks(LANES)).zip(factor.chunks(LANES));
            for ((dy, normal), factor) in lines {
                for (lane, ((dy, normal), factor)) in dy.iter().zip(normal).zip(factor).enumerate() {
                    means[lane] += dy * factor;
                    products[lane] += dy * factor * normal;
                }
            }
            let (mean, product) = (sum(&means, |x| x) / width as f32, sum(&products, |x| x) / width as f32);
            for ((((dx, dy), n), f), (df, db)) in
                dx.iter_mut().zip(dy).zip(normal).zip(factor).zip(factors.iter_mut().zip(&mut *shifts))
            {
                *dx += scale * (dy * f - mean - n * product);
                *df += dy * n;
                *db += dy;
            }
        }
    }

    /// Root mean square norm: y = x·s·weight.
    fn rms_norm<'a>(x: &'a [f32], weight: &'a [f32], scales: &'a mut [f32], y: &'a mut [f32]) {
        let width = weight.len();
        for ((x, y), scale) in x.chunks_exact(width).zip(y.chunks_exact_mut(width)).zip(scales) {
            *scale = 1.0 / (sum(x, |x| x * x) / width as f32 + EPSILON).sqrt();
            for ((y, x), w) in y.iter_mut().zip(x).zip(weight) {
                *y = x * *scale * w;
            }
        }
    }

    /// Turns dy into dx of a root mean square norm; adds the gradient of the weight to `sums`.
    fn rms_norm_back<'a>(
        dy: &'a mut [f32],
        weight: &'a [f32],
        saved: [&'a [f32]; 2],
        sums: &'a mut [f32],
    ) {
        let (width, [x, scales]) = (weight.len(), saved);
        for ((dy, x), scale) in dy.chunks_exact_mut(width).zip(x.chunks_exact(width)).zip(scales) {
            for (((sum, dy), x), w) in sums.iter_mut().zip(&mut *dy).zip(x).zip(weight) {
                *sum += *dy * x * scale;
                *dy *= w;
            }
            let product = dot(dy, x) * scale / width as f32;
            for (dy, x) in dy.iter_mut().zip(x) {
                *dy = scale * (*dy - x * scale * product);
            }
        }
    }

    /// x += gate·y.
    fn gate<'a>(y: &'a [f32], gate: &'a [f32], x: &'a mut [f32]) {
        for (y, x) in y.chunks_exact(gate.len()).zip(x.chunks_exact_mut(gate.len())) {
            for ((x, y), g) in x.iter_mut().zip(y).zip(gate) {
                *x += g * y;
            }
        }
    }

    /// dy = gate·dx; adds the gradient of the gate to `sums`.
    fn gate_back<'a>(dx: &'a [f32], gate: &'a [f32], y: &'a [f32], dy: &'a mut [f32], sums: &'a mut [f32]) {
        let width = gate.len();
        for ((dx, y), dy) in dx.chunks_exact(width).zip(y.chunks_exact(width)).zip(dy.chunks_exact_mut(width)) {
            for ((((dy, dx), y), g), sum) in dy.iter_mut().zip(dx).zip(y).zip(gate).zip(sums.iter_mut()) {
                *dy = g * dx;
                *sum += dx * y;
            }
        }
    }

    /// Adds all rows to `sums`.
    fn column_sums<'a>(x: &'a [f32], sums: &'a mut [f32]) {
        for x in x.chunks_exact(sums.len()) {
            for (sum, x) in sums.iter_mut().zip(x) {
                *sum += x;
            }
        }
    }

    /// y = gelu(x).
    fn gelu<'a>(x: &'a [f32], y: &'a mut [f32]) {
        for (y, x) in y.iter_mut().zip(x) {
            *y = crate::lanes::gelu(*x);
        }
    }

    /// y = gelu(x) again, and d turns from its gradient into that of x.
    fn gelu_back<'a>(x: &'a [f32], y: &'a mut [f32], d: &'a mut [f32]) {
        for ((y, x), d) in y.iter_mut().zip(x).zip(d) {
            let share = 0.5 * (1.0 + erf(*x * std::f32::consts::FRAC_1_SQRT_2));
            // The density of the normal distribution, 2^(−x²·log2(e)/2) / √(2π).
            let density = 0.398_942_3 * exp2(-0.5 * std::f32::consts::LOG2_E * *x * *x);
            *y = *x * share;
            *d *= share + *x * density;
        }
    }

    /// y = silu(x).
    fn silu<'a>(x: &'a [f32], y: &'a mut [f32]) {
        for (y, x) in y.iter_mut().zip(x) {
            *y = crate::lanes::silu(*x);
        }
    }

    /// Turns d from the gradient of silu(x) into that of x.
    fn silu_back<'a>(x: &'a [f32], d: &'a mut [f32]) {
        for (x, d) in x.iter().zip(d) {
            let s = 1.0 / (1.0 + exp2(-*x * std::f32::consts::LOG2_E));
            *d *= s * (1.0 + *x * (1.0 - s));
        }
    }

    /// Turns rows of scores (in powers of two) into unnormalised weights; tells the log of each row's sum, base 2.
    fn softmax<'a>(scores: &'a mut [f32], width: usize, totals: &'a mut [f32], logs: &'a mut [f32]) {
        for ((row, total), log) in scores.chunks_exact_mut(width).zip(totals).zip(logs) {
            let top = largest(row);
            *total = exponentials(row, top);
            *log = top + total.log2();
        }
    }

    /// Turns rows of scores into weights, given the logs of their sums.
    fn softmax_again<'a>(scores: &'a mut [f32], width: usize, logs: &'a [f32]) {
        for (row, log) in scores.chunks_exact_mut(width).zip(logs) {
            for score in row {
                *score = exp2(*score - log);
            }
        }
    }

    /// Turns gradients of weights into those of scores: ln 2 · p·(dp − Σ p·dp), the sums given.
    fn softmax_back<'a>(weights: &'a [f32], width: usize, sums: &'a [f32], d: &'a mut [f32]) {
        for ((p, d), sum) in weights.chunks_exact(width).zip(d.chunks_exact_mut(width)).zip(sums) {
            for (d, p) in d.iter_mut().zip(p) {
                *d = std::f32::consts::LN_2 * p * (*d - sum);
            }
        }
    }

    /// Σ a·b of the first `width` values of rows that lie `stride` apart.
    fn dots<'a>(a: &'a [f32], b: &'a [f32], sizes: [usize; 2], dots: &'a mut [f32]) {
        let [width, stride] = sizes;
        for ((a, b), out) in a.chunks(stride).zip(b.chunks(stride)).zip(dots) {
            *out = dot(&a[..width], &b[..width]);
        }
    }
}
