//! Cellular noise: distances to scattered points, one in each square of a lattice; the grain of this world's materials.

use ds_space::Vec2;

/// Mixes a lattice point and a seed into 32 bits (PCG-like permutation).
pub(crate) fn mixed(x: i32, y: i32, seed: u32) -> u32 {
    #[expect(clippy::cast_sign_loss, reason = "only the bits matter")]
    let state = (x as u32).wrapping_mul(747_796_405).wrapping_add((y as u32).wrapping_mul(2_891_336_453)) ^ seed;
    let state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}

/// Returns a number in [0, 1) of a lattice point.
pub(crate) fn unit(x: i32, y: i32, seed: u32) -> f32 {
    (mixed(x, y, seed) & 0xFF_FFFF) as f32 / 16_777_216.0
}

pub(crate) fn floor(at: f32) -> i32 {
    #[expect(clippy::cast_possible_truncation, reason = "float casts saturate")]
    let index = at.floor() as i32;
    index
}

/// The nearest scattered points around a place.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Cell {
    /// Distance to the nearest.
    pub(crate) nearest: f32,
    /// Distance to the next.
    pub(crate) next: f32,
    /// A number in [0, 1) of the nearest.
    pub(crate) tone: f32,
}

/// Looks around a place; the lattice has unit spacing.
pub(crate) fn around(p: Vec2, seed: u32) -> Cell {
    let (cx, cy) = (floor(p.x), floor(p.y));
    let mut cell = Cell { nearest: 9.0, next: 9.0, tone: 0.0 };
    for dy in -1..=1 {
        for dx in -1..=1 {
            let (x, y) = (cx.wrapping_add(dx), cy.wrapping_add(dy));
            let point = Vec2::new(x as f32 + unit(x, y, seed), y as f32 + unit(x, y, seed ^ 0x51));
            let away = point.distance(p);
            if away < cell.nearest {
                cell = Cell { nearest: away, next: cell.nearest, tone: unit(x, y, seed ^ 0xA7) };
            } else {
                cell.next = cell.next.min(away);
            }
        }
    }
    cell
}

/// Returns broad bumps in [0, 1] without lattice lines: two layers of cells.
pub(crate) fn bumps(p: Vec2, seed: u32) -> f32 {
    let (a, b) = (around(p, seed), around(p * 2.3 + Vec2::new(7.7, 3.1), seed ^ 0x1F));
    (0.65 * (1.0 - a.nearest) + 0.35 * (1.0 - b.nearest)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_ordered_and_bounded() {
        for i in 0..500 {
            let p = Vec2::new(0.37 * i as f32 - 90.0, 0.11 * i as f32);
            let cell = around(p, 5);
            assert!(cell.nearest <= cell.next && cell.nearest < 1.5, "{cell:?}");
            assert!((0.0..=1.0).contains(&bumps(p, 5)) && (0.0..1.0).contains(&cell.tone));
        }
    }
}
