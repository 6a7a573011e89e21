//! Value noise over the plane: a pure function of a position and a seed, smooth, in [0, 1).

/// Returns 32 well-mixed bits of a lattice point.
pub(crate) fn hash(x: i32, y: i32, seed: u32) -> u32 {
    #[expect(clippy::cast_sign_loss, reason = "only the bits matter")]
    let mut h = (x as u32).wrapping_mul(0x9E37_79B1) ^ (y as u32).wrapping_mul(0x85EB_CA77) ^ seed;
    h ^= h >> 15;
    h = h.wrapping_mul(0x2C1B_3C6D);
    h ^= h >> 12;
    h = h.wrapping_mul(0x297A_2D39);
    h ^ (h >> 15)
}

/// Returns the hash of a lattice point as a number in [0, 1).
pub(crate) fn cell(x: i32, y: i32, seed: u32) -> f32 {
    (hash(x, y, seed) >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// Returns smooth noise whose lattice has unit spacing.
pub(crate) fn smooth(x: f32, y: f32, seed: u32) -> f32 {
    let (fx, fy) = (x.floor(), y.floor());
    #[expect(clippy::cast_possible_truncation, reason = "float casts saturate")]
    let (ix, iy) = (fx as i32, fy as i32);
    let ease = |t: f32| t * t * (3.0 - 2.0 * t);
    let (tx, ty) = (ease(x - fx), ease(y - fy));
    let (jx, jy) = (ix.wrapping_add(1), iy.wrapping_add(1));
    let low = cell(ix, iy, seed) * (1.0 - tx) + cell(jx, iy, seed) * tx;
    let high = cell(ix, jy, seed) * (1.0 - tx) + cell(jx, jy, seed) * tx;
    low * (1.0 - ty) + high * ty
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn noise_is_bounded_and_has_no_jumps(x in -1e4f32..1e4, y in -1e4f32..1e4, seed in any::<u32>()) {
            let here = smooth(x, y, seed);
            prop_assert!((0.0..1.0).contains(&here));
            prop_assert!((smooth(x + 0.01, y, seed) - here).abs() < 0.04);
        }
    }
}
