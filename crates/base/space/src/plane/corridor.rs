//! The strip of a given width around a line.

use crate::DVec2;

/// Returns the outline of the strip around a line of distinct points: its right side forwards, its left side backwards.
///
/// Corners are mitred up to twice the half width. Fewer than two distinct points make no outline.
#[must_use]
pub fn corridor(line: &[DVec2], width_m: f64) -> Vec<DVec2> {
    let mut points: Vec<DVec2> = Vec::with_capacity(line.len());
    for point in line {
        if points.last() != Some(point) {
            points.push(*point);
        }
    }
    if points.len() < 2 {
        return Vec::new();
    }
    let direction = |from: usize| (points[from + 1] - points[from]).normalize_or_zero();
    let last = points.len() - 1;
    let offset = |i: usize| {
        let (before, after) = (direction(i.saturating_sub(1).min(last - 1)), direction(i.min(last - 1)));
        let normal = (before + after).normalize_or(after).perp();
        normal * (0.5 * width_m / normal.dot(after.perp()).max(0.5))
    };
    let right = (0..=last).map(|i| points[i] - offset(i));
    let left = (0..=last).rev().map(|i| points[i] + offset(i));
    right.chain(left).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_line_makes_a_rectangle() {
        let line = [DVec2::ZERO, DVec2::ZERO, DVec2::new(4.0, 0.0), DVec2::new(10.0, 0.0)];
        let expected = [(0.0, -1.75), (4.0, -1.75), (10.0, -1.75), (10.0, 1.75), (4.0, 1.75), (0.0, 1.75)];
        assert_eq!(corridor(&line, 3.5), expected.map(|(x, y)| DVec2::new(x, y)));
        assert!(corridor(&line[..2], 3.5).is_empty());
    }

    #[test]
    fn a_corner_keeps_the_width() {
        let line = [DVec2::ZERO, DVec2::new(10.0, 0.0), DVec2::new(10.0, 10.0)];
        assert!((corridor(&line, 2.0)[1] - DVec2::new(11.0, -1.0)).length() < 1e-12);
    }
}
