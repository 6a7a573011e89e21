//! Many polygons together: whether one holds a point, the rims around them. Metres, any fixed frame.

use std::collections::BTreeMap;

use super::polygon::holds;
use crate::DVec2;

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
#[derive(Debug)]
pub struct Areas<'a> {
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
    #[must_use]
    pub fn new(areas: &'a [Vec<DVec2>]) -> Option<Self> {
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
    pub fn hold(&self, point: DVec2, looks: &mut usize) -> bool {
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
    #[must_use]
    pub fn rims(&self) -> Option<Vec<Vec<DVec2>>> {
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
    pub fn inside(&self, line: &[DVec2], looks: &mut usize) -> f64 {
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
