//! Sets of place and speed along one axis as convex polygons, and intervals: what a reachable set is made of.
//!
//! Whatever is done to a polygon gives one that holds all that may come of its points; and little more.

use ds_space::DVec2;

/// How far one goes on at a time.
pub(crate) const STEP_SECS: f64 = 0.2;
/// Polygons are grown so far each step against what a polyline of a route lacks of a curve, in metres.
const SLACK_M: f64 = 0.02;
/// Polygons of more corners are given away for simpler ones around them.
const MOST_CORNERS: usize = 10;

/// The least and the greatest of something.
pub(crate) type Interval = [f64; 2];

/// Returns the sums of two intervals' numbers.
pub(crate) fn plus(a: Interval, b: Interval) -> Interval {
    [a[0] + b[0], a[1] + b[1]]
}

/// Returns the products of two intervals' numbers.
pub(crate) fn times(a: Interval, b: Interval) -> Interval {
    let all = [a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1]];
    [all.iter().copied().fold(f64::INFINITY, f64::min), all.iter().copied().fold(f64::NEG_INFINITY, f64::max)]
}

/// Returns an interval's numbers over those of one that is positive.
pub(crate) fn over(a: Interval, by: Interval) -> Interval {
    times(a, [by[1].recip(), by[0].recip()])
}

/// A convex polygon of places (x, in metres) and speeds (y, in metres per second), anticlockwise.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Shape(Vec<DVec2>);

impl Shape {
    /// Returns all around a place and speed.
    pub(crate) fn around(middle: DVec2, reach: DVec2) -> Self {
        let corner = |x: f64, y: f64| middle + reach * DVec2::new(x, y);
        Self(vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)])
    }

    fn extent(&self, axis: fn(&DVec2) -> f64) -> Interval {
        let low = self.0.iter().map(axis).fold(f64::INFINITY, f64::min);
        [low, self.0.iter().map(axis).fold(f64::NEG_INFINITY, f64::max)]
    }

    /// Returns the least and the greatest place, in metres.
    pub(crate) fn places(&self) -> Interval {
        self.extent(|point| point.x)
    }

    /// Returns the least and the greatest speed, in metres per second.
    pub(crate) fn speeds(&self) -> Interval {
        self.extent(|point| point.y)
    }

    /// Returns where one gets to in a step with accelerations within an interval, however they change in it: of those within ±A the
    /// change of speed is at most A·t, and the way differs from that of a constant one by at most A·t²/4.
    pub(crate) fn after(&self, [low, high]: Interval) -> Self {
        let (middle, half, t) = (0.5 * (low + high), 0.5 * (high - low), STEP_SECS);
        let along = DVec2::new(0.5 * half * t * t, half * t);
        // The way that is left or right of the even one is a parabola over the change of speed; its tangents hold it.
        let [slack, aside] = [SLACK_M, SLACK_M + 0.25 * half * t * t].map(|m| DVec2::new(m, 0.0));
        let around = [(1.0, slack), (0.5, aside), (-0.5, aside), (-1.0, slack)];
        let moved = |point: &DVec2| {
            let on = *point + DVec2::new(point.y * t + 0.5 * middle * t * t, middle * t);
            around.map(|(share, aside)| [on + along * share + aside, on + along * share - aside])
        };
        Self(hull(self.0.iter().flat_map(moved).flatten().collect())).simple()
    }

    /// Returns a polygon of few corners that holds this one: of the edges the one goes whose neighbours meet nearest without it.
    fn simple(mut self) -> Self {
        while self.0.len() > MOST_CORNERS {
            let n = self.0.len();
            let without = |i: usize| {
                let [before, from, to, after] = [i + n - 1, i, i + 1, i + 2].map(|k| self.0[k % n]);
                let (along, back) = (from - before, to - after);
                let turn = along.perp_dot(back);
                // Edges that part, or hardly meet, do not hold what lies between them.
                let ahead = (to - from).perp_dot(back) / turn;
                let meet = from + along * ahead;
                (turn < -1e-9 && ahead > 0.0).then(|| ((to - from).perp_dot(meet - from).abs(), i, meet))
            };
            let least = (0..n).filter_map(without).min_by(|a, b| a.0.total_cmp(&b.0));
            let Some((_, i, meet)) = least else { return self };
            self.0[i] = meet;
            self.0.remove((i + 1) % n);
        }
        self
    }

    /// Returns the part that a half-plane holds, by how far a point lies within it; nothing where there is none.
    fn cut(&self, within: impl Fn(&DVec2) -> f64) -> Option<Self> {
        let mut kept = Vec::with_capacity(self.0.len() + 2);
        for (i, point) in self.0.iter().enumerate() {
            let next = &self.0[(i + 1) % self.0.len()];
            let (here, there) = (within(point), within(next));
            if here >= 0.0 {
                kept.push(*point);
            }
            if (here > 0.0 && there < 0.0) || (here < 0.0 && there > 0.0) {
                kept.push(point.lerp(*next, here / (here - there)));
            }
        }
        (!kept.is_empty()).then_some(Self(kept))
    }

    /// Returns the part that does not go backwards.
    pub(crate) fn forwards(&self) -> Option<Self> {
        self.cut(|point| point.y)
    }

    /// Returns the part whose speed is at most so great either way, in metres per second.
    pub(crate) fn slower_than(&self, most_mps: f64) -> Option<Self> {
        let [slowest, fastest] = self.speeds();
        if slowest.abs().max(fastest.abs()) <= most_mps {
            return Some(self.clone());
        }
        self.cut(|point| most_mps - point.y)?.cut(|point| most_mps + point.y)
    }

    /// Returns the parts in cells of a length, with the cells' numbers.
    pub(crate) fn cells(&self, length_m: f64) -> Vec<(i32, Self)> {
        let [first, last] = self.places().map(|place_m| (place_m / length_m).floor() as i32);
        let part = |i: i32| {
            let [low, high] = [i, i + 1].map(|at| f64::from(at) * length_m);
            Some((i, self.cut(|point| point.x - low)?.cut(|point| high - point.x)?))
        };
        (first..=last).filter_map(part).collect()
    }

    /// Returns the least polygon that holds this one and another.
    pub(crate) fn joined(&self, other: &Self) -> Self {
        Self(hull(self.0.iter().chain(&other.0).copied().collect())).simple()
    }

    /// Says whether it holds a place and speed.
    #[cfg(test)]
    pub(crate) fn holds(&self, point: DVec2) -> bool {
        let side = |i: usize| (self.0[(i + 1) % self.0.len()] - self.0[i]).perp_dot(point - self.0[i]);
        (0..self.0.len()).all(|i| side(i) >= -1e-9)
    }
}

/// Returns the convex hull of points, anticlockwise (Andrew's monotone chain).
fn hull(mut points: Vec<DVec2>) -> Vec<DVec2> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points.dedup();
    if points.len() < 3 {
        return points;
    }
    let half = |points: &mut dyn Iterator<Item = DVec2>| {
        let mut chain: Vec<DVec2> = Vec::new();
        for point in points {
            while let [.., a, b] = chain[..]
                && (b - a).perp_dot(point - b) <= 0.0
            {
                chain.pop();
            }
            chain.push(point);
        }
        chain.pop();
        chain
    };
    let mut low = half(&mut points.iter().copied());
    low.extend(half(&mut points.iter().rev().copied()));
    low
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_hold_all_sums_products_and_quotients() {
        assert_eq!(plus([-1.0, 2.0], [3.0, 4.0]), [2.0, 6.0]);
        assert_eq!(times([-1.0, 2.0], [-3.0, 4.0]), [-6.0, 8.0]);
        assert_eq!(over([-1.0, 2.0], [0.5, 4.0]), [-2.0, 4.0]);
    }

    #[test]
    fn what_starts_at_rest_gets_as_far_as_held_accelerations_and_no_farther() {
        let mut shape = Shape::around(DVec2::ZERO, DVec2::splat(1e-6));
        for _ in 0..5 {
            shape = shape.after([-2.0, 4.0]);
        }
        let [[back, ahead], [slower, faster]] = [shape.places(), shape.speeds()];
        // ½·a·t² and a·t after 1 s; beyond, the slack of five steps and what simpler polygons add.
        assert!((2.0..2.6).contains(&ahead) && (-1.6..=-1.0).contains(&back), "{back} {ahead}");
        assert!((4.0..4.3).contains(&faster) && (-2.3..=-2.0).contains(&slower), "{slower} {faster}");
        assert!(shape.holds(DVec2::new(0.5, 1.0)) && !shape.holds(DVec2::new(2.0, 0.0)), "who went far is fast");
        let held = shape.forwards().expect("some go ahead");
        assert!(held.speeds()[0] >= -1e-9 && held.holds(DVec2::new(0.5, 1.0)));
        let cells = shape.cells(0.5);
        assert_eq!(cells.first().map(|cell| cell.0), Some((back / 0.5).floor() as i32));
        assert!(cells.iter().all(|(_, part)| part.places()[1] - part.places()[0] <= 0.5 + 1e-9));
        let whole = cells.iter().skip(1).fold(cells[0].1.clone(), |whole, (_, part)| whole.joined(part));
        assert!((whole.places()[1] - ahead).abs() < 1e-9 && whole.holds(DVec2::new(0.5, 1.0)));
    }
}
