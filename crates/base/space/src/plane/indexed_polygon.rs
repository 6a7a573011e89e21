//! A polygon with holes, its edges sorted into bins along its longer axis, so that a look-up reads few of them.
//!
//! Even-odd rule over all rings; a point on a ring is outside, a hole's rim included.

use super::{Bounds, OrientedBox};
use crate::DVec2;

const MOST_BINS: usize = 256;

/// A polygon ready for look-ups. Any fixed frame, metres.
#[derive(Debug, Clone)]
pub struct IndexedPolygon {
    bounds: Bounds,
    /// Ends of each edge; x and y are swapped if `swapped`, so that bins lie along y.
    edges: Vec<[DVec2; 2]>,
    swapped: bool,
    /// A convex ring of three or four edges, all with the inside on their left.
    convex: bool,
    bins_per_m: f64,
    /// Edges of bin `i` are `entries[starts[i]..starts[i + 1]]`.
    starts: Vec<u32>,
    entries: Vec<u32>,
}

impl IndexedPolygon {
    /// Prepares an outline with holes; `None` if a ring has fewer than three points or a number is not finite.
    #[must_use]
    pub fn new(outline: &[DVec2], holes: &[Vec<DVec2>]) -> Option<Self> {
        let sound = |ring: &[DVec2]| ring.len() >= 3 && ring.iter().all(|point| point.is_finite());
        if !sound(outline) || !holes.iter().all(|hole| sound(hole)) {
            return None;
        }
        let bounds = Bounds::of(outline);
        let size = bounds.high - bounds.low;
        let swapped = size.x > size.y;
        let turn = |point: DVec2| if swapped { DVec2::new(point.y, point.x) } else { point };
        let mut edges = Vec::with_capacity(outline.len());
        for ring in std::iter::once(outline).chain(holes.iter().map(Vec::as_slice)) {
            let mut from = turn(ring[ring.len() - 1]);
            for point in ring {
                let to = turn(*point);
                if to != from {
                    edges.push([from, to]);
                }
                from = to;
            }
        }
        let mut polygon =
            Self { bounds, edges, swapped, convex: false, bins_per_m: 0.0, starts: Vec::new(), entries: Vec::new() };
        polygon.note_convexity(holes.is_empty());
        polygon.sort_into_bins();
        Some(polygon)
    }

    /// Four edges that all turn one way cannot go round twice; five could.
    fn note_convexity(&mut self, whole: bool) {
        if !whole || !(3..=4).contains(&self.edges.len()) {
            return;
        }
        let count = self.edges.len();
        let turn = |i: usize| {
            let ([a, b], [_, c]) = (self.edges[i], self.edges[(i + 1) % count]);
            (b - a).perp_dot(c - b)
        };
        if (0..count).all(|i| turn(i) < 0.0) {
            self.edges.iter_mut().for_each(|edge| edge.swap(0, 1));
            self.convex = true;
        } else {
            self.convex = (0..count).all(|i| turn(i) > 0.0);
        }
    }

    fn sort_into_bins(&mut self) {
        let bins = if self.edges.len() <= 8 { 1 } else { self.edges.len().min(MOST_BINS) };
        let extent_m = (self.bounds.high - self.bounds.low).max_element();
        self.bins_per_m = if bins > 1 && extent_m > 0.0 { bins as f64 / extent_m } else { 0.0 };
        let spans: Vec<(usize, usize)> =
            self.edges.iter().map(|[a, b]| (self.bin(a.y.min(b.y), bins), self.bin(a.y.max(b.y), bins))).collect();
        self.starts = vec![0; bins + 1];
        for (first, last) in &spans {
            for bin in *first..=*last {
                self.starts[bin + 1] += 1;
            }
        }
        for bin in 0..bins {
            self.starts[bin + 1] += self.starts[bin];
        }
        let mut next = self.starts.clone();
        self.entries = vec![0; self.starts[bins] as usize];
        for (edge, (first, last)) in (0u32..).zip(spans) {
            for place in &mut next[first..=last] {
                self.entries[*place as usize] = edge;
                *place += 1;
            }
        }
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the bins; casts saturate")]
    fn bin(&self, y: f64, bins: usize) -> usize {
        let low = if self.swapped { self.bounds.low.x } else { self.bounds.low.y };
        (((y - low) * self.bins_per_m) as usize).min(bins - 1)
    }

    /// Returns the smallest axis-aligned box around it.
    #[must_use]
    pub fn bounds(&self) -> &Bounds {
        &self.bounds
    }

    /// Says whether a point lies strictly inside.
    #[must_use]
    pub fn holds(&self, point: DVec2) -> bool {
        if !self.bounds.holds(point) {
            return false;
        }
        let p = if self.swapped { DVec2::new(point.y, point.x) } else { point };
        if self.convex {
            return self.edges.iter().all(|[a, b]| (*b - *a).perp_dot(p - *a) > 0.0);
        }
        let bin = self.bin(p.y, self.starts.len() - 1);
        let mut inside = false;
        for entry in &self.entries[self.starts[bin] as usize..self.starts[bin + 1] as usize] {
            let [a, b] = self.edges[*entry as usize];
            if (a.y > p.y) == (b.y > p.y) {
                let on_end = a == p || b == p;
                let on_level = a.y == p.y && b.y == p.y && (a.x <= p.x) != (b.x < p.x);
                if on_end || on_level {
                    return false;
                }
                continue;
            }
            let side = (b - a).perp_dot(p - a);
            if side == 0.0 {
                return false;
            }
            inside ^= (side > 0.0) == (b.y > a.y);
        }
        inside
    }

    /// Says whether a closed oriented box shares a point with the closed polygon.
    #[must_use]
    pub fn touches(&self, footprint: &OrientedBox) -> bool {
        let around = footprint.bounds();
        if !self.bounds.overlaps(&around) {
            return false;
        }
        let bins = self.starts.len() - 1;
        let (low, high) = if self.swapped { (around.low.x, around.high.x) } else { (around.low.y, around.high.y) };
        let entries = self.starts[self.bin(low, bins)] as usize..self.starts[self.bin(high, bins) + 1] as usize;
        let unswap = |point: DVec2| if self.swapped { DVec2::new(point.y, point.x) } else { point };
        self.entries[entries].iter().any(|edge| footprint.touches_segment(self.edges[*edge as usize].map(unswap)))
            || self.holds(footprint.centre)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::PoseSe2;
    use proptest::prelude::*;

    fn ring(points: &[(f64, f64)]) -> Vec<DVec2> {
        points.iter().map(|(x, y)| DVec2::new(*x, *y)).collect()
    }

    #[test]
    fn points_of_a_notched_polygon_with_a_hole() {
        // A U of 10 x 10 with a notch 4 wide and 6 deep from above, and a hole of 1 x 1 in its left arm.
        let u = ring(&[(0., 0.), (10., 0.), (10., 10.), (7., 10.), (7., 4.), (3., 4.), (3., 10.), (0., 10.)]);
        let hole = ring(&[(1., 5.), (2., 5.), (2., 6.), (1., 6.)]);
        for outline in [u.clone(), u.iter().rev().copied().collect()] {
            let area = IndexedPolygon::new(&outline, std::slice::from_ref(&hole)).expect("sound rings");
            for (x, y, expected) in [
                (1.0, 9.0, true),
                (5.0, 9.0, false),
                (5.0, 4.0, false),
                (5.0, 3.999_999, true),
                (0.0, 5.0, false),
                (0.0, 0.0, false),
                (10.0, 10.0, false),
                (8.5, 10.0, false),
                (1.5, 5.5, false),
                (1.0, 5.5, false),
                (2.0, 6.0, false),
                (2.5, 5.5, true),
                (0.5, 4.0, true),
                (0.5, 5.0, true),
                (11.0, 5.0, false),
                (f64::NAN, 5.0, false),
            ] {
                assert_eq!(area.holds(DVec2::new(x, y)), expected, "({x}, {y})");
            }
        }
    }

    #[test]
    fn boxes_by_table() {
        let area = IndexedPolygon::new(&ring(&[(0., 0.), (30., 0.), (30., 6.), (0., 6.)]), &[]).expect("a ring");
        for (x, y, expected) in
            [(15.0, 3.0, true), (-2.0, 3.0, true), (-2.1, 3.0, false), (15.0, 7.0, true), (15.0, 7.001, false)]
        {
            let footprint = OrientedBox::new(&PoseSe2::new(x, y, 0.0), 4.0, 2.0);
            assert_eq!(area.touches(&footprint), expected, "({x}, {y})");
        }
        let holed = ring(&[(5., 1.), (25., 1.), (25., 5.), (5., 5.)]);
        let frame = IndexedPolygon::new(&ring(&[(0., 0.), (30., 0.), (30., 6.), (0., 6.)]), &[holed]).expect("rings");
        let inside_hole = OrientedBox::new(&PoseSe2::new(15.0, 3.0, 0.0), 4.0, 2.0);
        assert!(!frame.touches(&inside_hole));
        assert!(frame.touches(&inside_hole.moved(DVec2::new(0.0, 1.0))));
    }

    #[test]
    fn refuses_what_is_no_polygon() {
        assert!(IndexedPolygon::new(&ring(&[(0., 0.), (1., 0.)]), &[]).is_none());
        assert!(IndexedPolygon::new(&ring(&[(0., 0.), (1., 0.), (f64::NAN, 1.)]), &[]).is_none());
    }

    proptest! {
        #[test]
        fn bins_change_nothing(radii in prop::collection::vec(2.0..30.0f64, 12..80), x in -30.0..30.0f64, y in -30.0..30.0f64) {
            let step = std::f64::consts::TAU / radii.len() as f64;
            let star: Vec<DVec2> =
                radii.iter().enumerate().map(|(i, r)| DVec2::from_angle(i as f64 * step) * *r).collect();
            let point = DVec2::new(x, y);
            // By the angle: a star-shaped polygon holds what lies nearer than its rim.
            let sector = (y.atan2(x).rem_euclid(std::f64::consts::TAU) / step) as usize % star.len();
            let (a, b) = (star[sector], star[(sector + 1) % star.len()]);
            let expected = (b - a).perp_dot(point - a) > 0.0;
            let area = IndexedPolygon::new(&star, &[]).expect("a ring");
            prop_assert_eq!(area.holds(point), expected);
        }
    }
}
