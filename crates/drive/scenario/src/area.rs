//! Plane areas: polygons that hold points, boxes that overlap, the rims of many polygons together. Metres.

use std::collections::BTreeMap;

use ds_space::DVec2;

/// Says whether a point lies in a simple polygon (crossing rule; the border may count either way).
pub(crate) fn holds(polygon: &[DVec2], point: DVec2) -> bool {
    let mut inside = false;
    let Some(mut before) = polygon.last() else { return false };
    for vertex in polygon {
        if (vertex.y > point.y) != (before.y > point.y) {
            let share = (point.y - vertex.y) / (before.y - vertex.y);
            if point.x < vertex.x + share * (before.x - vertex.x) {
                inside = !inside;
            }
        }
        before = vertex;
    }
    inside
}

/// Says whether two boxes given by their corners overlap (separating axes).
pub(crate) fn overlap(a: &[DVec2; 4], b: &[DVec2; 4]) -> bool {
    let apart = |axis: DVec2| {
        let span = |corners: &[DVec2; 4]| {
            corners
                .iter()
                .map(|corner| corner.dot(axis))
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), at| (low.min(at), high.max(at)))
        };
        let ((a_low, a_high), (b_low, b_high)) = (span(a), span(b));
        a_high < b_low || b_high < a_low
    };
    ![a[0] - a[1], a[1] - a[2], b[0] - b[1], b[1] - b[2]].into_iter().any(apart)
}

/// Returns the ends of the middle line along a polygon's longest side; none below half a metre.
pub(crate) fn long_axis(polygon: &[DVec2]) -> Option<[DVec2; 2]> {
    let sides = (0..polygon.len()).map(|i| polygon[(i + 1) % polygon.len()] - polygon[i]);
    let along = sides.max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()))?.try_normalize()?;
    let middle = polygon.iter().sum::<DVec2>() / polygon.len() as f64;
    let reach = || polygon.iter().map(|point| (*point - middle).dot(along));
    let (low, high) = (reach().fold(0.0, f64::min), reach().fold(0.0, f64::max));
    (high - low > 0.5).then_some([middle + along * low, middle + along * high])
}

/// How far to both sides of an edge the ground is looked at, in metres, and in pieces of what length.
const ASIDE_M: f64 = 0.3;
const PIECE_M: f64 = 3.0;
/// Areas are looked up by squares of this side, in metres.
const CELL_M: f64 = 25.0;
/// An area over more squares than this is looked at for every point.
const WIDE_CELLS: f64 = 10_000.0;
const MOST_CELLS: usize = 4_000_000;
/// The most looks at corners of areas.
const MOST_LOOKS: usize = 2_000_000_000;

/// Many polygons, found by place.
pub(crate) struct Areas<'a> {
    areas: &'a [Vec<DVec2>],
    bounds: Vec<(DVec2, DVec2)>,
    cells: BTreeMap<(i64, i64), Vec<usize>>,
    wide: Vec<usize>,
}

fn cell(point: DVec2) -> (i64, i64) {
    let at = (point / CELL_M).floor();
    (at.x as i64, at.y as i64)
}

impl<'a> Areas<'a> {
    /// Sorts polygons by place; `None` if they cover too much.
    pub(crate) fn new(areas: &'a [Vec<DVec2>]) -> Option<Self> {
        let corner =
            |area: &[DVec2], pick: fn(DVec2, DVec2) -> DVec2| area.iter().copied().reduce(pick).unwrap_or_default();
        let bounds: Vec<(DVec2, DVec2)> =
            areas.iter().map(|area| (corner(area, DVec2::min), corner(area, DVec2::max))).collect();
        let mut sorted = Self { areas, bounds, cells: BTreeMap::new(), wide: Vec::new() };
        let mut filled = 0;
        for (i, (low, high)) in sorted.bounds.iter().enumerate() {
            let span = (*high - *low) / CELL_M + 1.0;
            if span.x * span.y > WIDE_CELLS {
                sorted.wide.push(i);
                continue;
            }
            let ((west, south), (east, north)) = (cell(*low), cell(*high));
            for x in west..=east {
                for y in south..=north {
                    sorted.cells.entry((x, y)).or_default().push(i);
                    filled += 1;
                }
            }
            if filled > MOST_CELLS {
                return None;
            }
        }
        Some(sorted)
    }

    /// Says whether a point lies in one of the polygons; `looks` counts the corners looked at.
    pub(crate) fn hold(&self, point: DVec2, looks: &mut usize) -> bool {
        let near = self.cells.get(&cell(point)).into_iter().flatten().chain(&self.wide);
        near.into_iter().any(|i| {
            let (low, high) = self.bounds[*i];
            *looks += 1;
            point.cmpge(low).all() && point.cmple(high).all() && {
                *looks += self.areas[*i].len();
                holds(&self.areas[*i], point)
            }
        })
    }

    /// Returns the edges of polygons beyond which there is no other; `None` if that takes too many looks.
    pub(crate) fn rims(&self) -> Option<Vec<Vec<DVec2>>> {
        let (mut rims, mut looks) = (Vec::new(), 0);
        for area in self.areas {
            let mut run: Vec<DVec2> = Vec::new();
            for (from, to) in area.iter().copied().zip(area.iter().copied().cycle().skip(1)) {
                let Some(ahead) = (to - from).try_normalize() else { continue };
                let count = (from.distance(to) / PIECE_M).ceil().max(1.0);
                for i in 0..count as usize {
                    let (a, b) = (from.lerp(to, i as f64 / count), from.lerp(to, (i + 1) as f64 / count));
                    let (middle, aside) = (a.midpoint(b), ahead.perp() * ASIDE_M);
                    if self.hold(middle + aside, &mut looks) && self.hold(middle - aside, &mut looks) {
                        rims.push(std::mem::take(&mut run));
                    } else {
                        run.extend(run.is_empty().then_some(a));
                        run.push(b);
                    }
                    looks += 1;
                    if looks > MOST_LOOKS {
                        return None;
                    }
                }
            }
            rims.push(run);
        }
        rims.retain(|run| run.len() > 1);
        Some(rims)
    }

    /// Returns the share of a line that has one of the polygons on both sides.
    pub(crate) fn inside(&self, line: &[DVec2], looks: &mut usize) -> f64 {
        let (mut inside_m, mut length_m) = (0.0, 0.0);
        for pair in line.windows(2) {
            let Some(ahead) = (pair[1] - pair[0]).try_normalize() else { continue };
            let (middle, aside) = (pair[0].midpoint(pair[1]), ahead.perp() * ASIDE_M);
            let part_m = pair[0].distance(pair[1]);
            length_m += part_m;
            if self.hold(middle + aside, looks) && self.hold(middle - aside, looks) {
                inside_m += part_m;
            }
        }
        if length_m > 0.0 { inside_m / length_m } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ds_space::PoseSe2;
    use ds_world::agent::corners;

    #[test]
    fn boxes_overlap_only_where_they_meet() {
        let check = |x, y, heading, expected| {
            let a = corners(&PoseSe2::default(), 4.0, 2.0);
            let b = corners(&PoseSe2::new(x, y, heading), 4.0, 2.0);
            assert_eq!(overlap(&a, &b), expected, "{x} {y} {heading}");
            assert_eq!(overlap(&b, &a), expected, "{x} {y} {heading}");
        };
        check(3.9, 0.0, 0.0, true);
        check(4.1, 0.0, 0.0, false);
        check(0.0, 2.9, std::f64::consts::FRAC_PI_2, true);
        check(0.0, 3.1, std::f64::consts::FRAC_PI_2, false);
        check(3.0, 2.0, std::f64::consts::FRAC_PI_4, true);
        check(3.4, 2.6, std::f64::consts::FRAC_PI_4, false);
    }

    #[test]
    fn a_polygon_holds_its_inside() {
        let bent =
            [(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (2.0, 4.0), (2.0, 2.0), (0.0, 2.0)].map(|(x, y)| DVec2::new(x, y));
        for (x, y, expected) in [(1.0, 1.0, true), (1.0, 3.0, false), (3.0, 3.0, true), (5.0, 1.0, false)] {
            assert_eq!(holds(&bent, DVec2::new(x, y)), expected);
        }
    }

    #[test]
    fn polygons_side_by_side_have_one_rim_around_them() {
        let square = |x: f64| vec![(x, 0.0), (x + 10.0, 0.0), (x + 10.0, 10.0), (x, 10.0)];
        let square = |x: f64| square(x).into_iter().map(|(x, y)| DVec2::new(x, y)).collect::<Vec<_>>();
        let squares = [square(0.0), square(10.0)];
        let areas = Areas::new(&squares).expect("they are small");
        let rims = areas.rims().expect("they are few");
        let length_m: f64 = rims.iter().flat_map(|rim| rim.windows(2)).map(|pair| pair[0].distance(pair[1])).sum();
        assert!((length_m - 60.0).abs() < 1e-9, "{length_m} m of rim around 20 m by 10 m");
        let shared = [DVec2::new(10.0, 0.0), DVec2::new(10.0, 10.0)];
        let outer = [DVec2::new(0.0, 0.0), DVec2::new(10.0, 0.0)];
        assert_eq!((areas.inside(&shared, &mut 0), areas.inside(&outer, &mut 0)), (1.0, 0.0));
        // As far as the checks of the format allow, and found all the same.
        let wide = [square(0.0).into_iter().map(|point| point * 1e5).collect::<Vec<_>>()];
        assert!(Areas::new(&wide).expect("it is one").hold(DVec2::new(5e5, 5e5), &mut 0));
    }
}
