//! Elementwise functions and sums that the compiler turns into vectors: plain arithmetic without branches.
//!
//! Everything here is `inline(always)`, so that it takes on the vector width of the caller. Sums run over sixteen
//! lanes in a fixed order on every processor. Errors: 2^x and eˣ below 3e-7 relative for x ≤ 0, erf below 1e-6 absolute,
//! gelu below 5e-7 of |x| or of 1.

use std::f32::consts::LOG2_E;

/// Lanes of a sum.
pub(crate) const LANES: usize = 16;

/// 2^x, with x held to −126…126.
#[inline(always)]
pub(crate) fn exp2(x: f32) -> f32 {
    // Adding 1.5·2²³ leaves the nearest integer in the low bits.
    const ROUND: f32 = 12_582_912.0;
    let x = if x < -126.0 { -126.0 } else { x };
    let x = if x > 126.0 { 126.0 } else { x };
    let shifted = x + ROUND;
    let f = x - (shifted - ROUND);
    let mut p = 1.535_336_2e-4;
    p = fma(p, f, 1.339_887_4e-3);
    p = fma(p, f, 9.618_437e-3);
    p = fma(p, f, 5.550_332_6e-2);
    p = fma(p, f, 2.402_264_8e-1);
    p = fma(p, f, 6.931_472e-1);
    p = fma(p, f, 1.0);
    f32::from_bits(p.to_bits().wrapping_add(shifted.to_bits() << 23))
}

/// a·b + c, rounded once on every processor.
#[inline(always)]
fn fma(a: f32, b: f32, c: f32) -> f32 {
    a.mul_add(b, c)
}

/// erf(x): a rational function of x², odd in x, held to |x| ≤ 4.
#[inline(always)]
pub(crate) fn erf(x: f32) -> f32 {
    let x = if x < -4.0 { -4.0 } else { x };
    let x = if x > 4.0 { 4.0 } else { x };
    let s = x * x;
    let mut p = -2.726_142_3e-10;
    p = fma(p, s, 2.770_681_4e-8);
    p = fma(p, s, -2.101_024e-6);
    p = fma(p, s, -5.692_506_4e-5);
    p = fma(p, s, -7.349_906e-4);
    p = fma(p, s, -2.954_6e-3);
    p = fma(p, s, -1.609_603_3e-2);
    let mut q = -1.456_607_2e-5;
    q = fma(q, s, -2.133_740_6e-4);
    q = fma(q, s, -1.682_827e-3);
    q = fma(q, s, -7.373_329e-3);
    q = fma(q, s, -1.426_473_9e-2);
    x * p / q
}

/// x·Φ(x), the exact GELU.
#[inline(always)]
pub(crate) fn gelu(x: f32) -> f32 {
    0.5 * x * (1.0 + erf(x * std::f32::consts::FRAC_1_SQRT_2))
}

/// x / (1 + e⁻ˣ).
#[inline(always)]
pub(crate) fn silu(x: f32) -> f32 {
    x / (1.0 + exp2(-x * LOG2_E))
}

/// max(x, 0); not a number stays what it is.
#[inline(always)]
pub(crate) fn relu(x: f32) -> f32 {
    if x < 0.0 { 0.0 } else { x }
}

/// Adds sixteen lanes in pairs.
#[inline(always)]
fn folded(mut lanes: [f32; LANES]) -> f32 {
    let mut half = LANES / 2;
    while half > 0 {
        for lane in 0..half {
            lanes[lane] += lanes[lane + half];
        }
        half /= 2;
    }
    lanes[0]
}

/// Sums f(x) over values.
#[inline(always)]
pub(crate) fn sum(values: &[f32], f: impl Fn(f32) -> f32) -> f32 {
    let mut lanes = [0.0; LANES];
    let (chunks, rest) = values.as_chunks::<LANES>();
    for chunk in chunks {
        for lane in 0..LANES {
            lanes[lane] += f(chunk[lane]);
        }
    }
    for (lane, value) in lanes.iter_mut().zip(rest) {
        *lane += f(*value);
    }
    folded(lanes)
}

/// Returns the largest value.
#[inline(always)]
pub(crate) fn largest(values: &[f32]) -> f32 {
    let mut lanes = [f32::NEG_INFINITY; LANES];
    let (chunks, rest) = values.as_chunks::<LANES>();
    for chunk in chunks {
        for lane in 0..LANES {
            lanes[lane] = if chunk[lane] > lanes[lane] { chunk[lane] } else { lanes[lane] };
        }
    }
    lanes.iter().chain(rest).fold(f32::NEG_INFINITY, |a, b| if *b > a { *b } else { a })
}

/// Replaces every value x by 2^(x − top) and returns their sum.
#[inline(always)]
pub(crate) fn exponentials(values: &mut [f32], top: f32) -> f32 {
    let mut lanes = [0.0; LANES];
    let (chunks, rest) = values.as_chunks_mut::<LANES>();
    for chunk in chunks {
        for lane in 0..LANES {
            chunk[lane] = exp2(chunk[lane] - top);
            lanes[lane] += chunk[lane];
        }
    }
    for (lane, value) in lanes.iter_mut().zip(rest) {
        *value = exp2(*value - top);
        *lane += *value;
    }
    folded(lanes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// erf by its power series, or its continued fraction far out, in f64.
    fn erf_f64(x: f64) -> f64 {
        if x.abs() > 3.0 {
            let mut fraction = 0.0;
            for k in (1..200).rev() {
                fraction = f64::from(k) / 2.0 / (x.abs() + fraction);
            }
            let tail = (-x * x).exp() / ((x.abs() + fraction) * std::f64::consts::PI.sqrt());
            return (1.0 - tail).copysign(x);
        }
        let (mut term, mut sum) = (x, x);
        for n in 1..200 {
            term *= -x * x / f64::from(n);
            sum += term / f64::from(2 * n + 1);
        }
        sum * 2.0 / std::f64::consts::PI.sqrt()
    }

    #[test]
    fn errors_are_as_stated() {
        for step in -6_000..=6_000 {
            let x = step as f32 * 1e-3;
            let error = f64::from(erf(x)) - erf_f64(f64::from(x));
            assert!(error.abs() < 1e-6, "erf({x}): {error}");
            let exact = f64::from(x) * 0.5 * (1.0 + erf_f64(f64::from(x) * std::f64::consts::FRAC_1_SQRT_2));
            assert!((f64::from(gelu(x)) - exact).abs() < 5e-7 * f64::from(x.abs()).max(1.0), "gelu({x})");
            let exact = f64::from(x) / (1.0 + (-f64::from(x)).exp());
            assert!((f64::from(silu(x)) - exact).abs() < 1e-6 * exact.abs().max(1.0), "silu({x})");
        }
        for step in 0..126_000 {
            let x = -step as f32 * 1e-3;
            let error = f64::from(exp2(x)) / f64::from(x).exp2() - 1.0;
            assert!(error.abs() < 3e-7, "exp2({x}): {error}");
        }
        assert!(exp2(f32::NAN).is_nan() && gelu(f32::NAN).is_nan() && relu(f32::NAN).is_nan());
    }

    #[test]
    fn sums_take_every_value() {
        let values: Vec<f32> = (1..=37).map(|i| i as f32).collect();
        assert_eq!((sum(&values, |x| x), largest(&values)), (703.0, 37.0));
        let mut weights = values.clone();
        let total = exponentials(&mut weights, 37.0);
        assert!((total - 2.0).abs() < 1e-6 && (weights[35] - 0.5).abs() < 1e-7);
    }
}
