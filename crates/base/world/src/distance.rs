//! A grid of distances to the road and to every path that something drives or walks, for placing what must keep away.
//!
//! Two-pass chamfer transform (3-4 weights); world frame, metres. Bounded: cells grow until at most two million remain.

use std::ops::Range;

use ds_space::DVec2;

use crate::scene::Scene;

const MOST_CELLS: f64 = 2e6;

/// Distances in metres on a regular grid.
#[derive(Debug)]
pub(crate) struct DistanceGrid {
    low: DVec2,
    cell_m: f64,
    columns: usize,
    rows: usize,
    /// In thirds of a cell.
    thirds: Vec<u32>,
}

impl DistanceGrid {
    /// Measures around the drive of a scene, `reach_m` to all sides; `None` without a drive.
    pub(crate) fn new(scene: &Scene, reach_m: f64) -> Option<Self> {
        let path = || scene.ego_log.iter().map(|ego| ego.pose.position).filter(|p| p.is_finite());
        let low = path().reduce(DVec2::min)? - reach_m;
        let high = path().reduce(DVec2::max)? + reach_m;
        let extent = high - low;
        let cell_m = (extent.x * extent.y / MOST_CELLS).sqrt().max(1.0);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "positive and bounded by MOST_CELLS"
        )]
        let count = |length: f64| (length / cell_m).ceil() as usize + 1;
        let (columns, rows) = (count(extent.x), count(extent.y));
        let mut grid = Self { low, cell_m, columns, rows, thirds: vec![u32::MAX / 2; columns * rows] };
        let map = &scene.map;
        let lanes = map.lanes.iter().map(|lane| &lane.polygon);
        for polygon in map.drivable.iter().chain(lanes).chain(&map.junctions) {
            grid.mark(polygon);
        }
        let tracks = scene.tracks.iter().flat_map(|track| track.points.iter().flatten());
        let walked = tracks.map(|point| point.pose.position).chain(path()).chain(scene.route.iter().copied());
        for place in walked {
            if let Some(i) = grid.index(place) {
                grid.thirds[i] = 0;
            }
        }
        grid.spread();
        Some(grid)
    }

    pub(crate) fn bounds(&self) -> (DVec2, DVec2) {
        (self.low, self.low + DVec2::new(self.columns as f64, self.rows as f64) * self.cell_m)
    }

    /// Returns the distance at a place, 0 outside the grid.
    pub(crate) fn at(&self, place: DVec2) -> f64 {
        self.index(place).map_or(0.0, |i| f64::from(self.thirds[i]) / 3.0 * self.cell_m)
    }

    /// Returns the direction away from the road.
    pub(crate) fn gradient(&self, place: DVec2) -> Option<DVec2> {
        let step = 3.0 * self.cell_m;
        let slope = |axis: DVec2| self.at(place + axis * step) - self.at(place - axis * step);
        DVec2::new(slope(DVec2::X), slope(DVec2::Y)).try_normalize()
    }

    fn index(&self, place: DVec2) -> Option<usize> {
        let at = (place - self.low) / self.cell_m;
        let inside = at.x >= 0.0 && at.y >= 0.0 && at.x < self.columns as f64 && at.y < self.rows as f64;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked to lie in the grid")]
        inside.then(|| at.y as usize * self.columns + at.x as usize)
    }

    /// Marks all cells whose centres lie in a polygon, and those along its edges.
    fn mark(&mut self, polygon: &[DVec2]) {
        let edges = || (0..polygon.len()).map(|i| (polygon[i], polygon[(i + 1) % polygon.len()]));
        for (a, b) in edges() {
            // Not farther apart than half a cell, and never endlessly many.
            let steps = (2.0 * a.distance(b) / self.cell_m).ceil().clamp(1.0, 10_000.0);
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bounded above")]
            let steps = steps as u32;
            for i in 0..steps {
                if let Some(cell) = self.index(a.lerp(b, f64::from(i) / f64::from(steps))) {
                    self.thirds[cell] = 0;
                }
            }
        }
        for row in self.rows_of(polygon) {
            let y = self.low.y + (row as f64 + 0.5) * self.cell_m;
            let crossing = |(a, b): (DVec2, DVec2)| {
                ((a.y > y) != (b.y > y))
                    .then(|| (a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x) - self.low.x) / self.cell_m)
            };
            let mut crossings: Vec<f64> = edges().filter_map(crossing).filter(|x| x.is_finite()).collect();
            crossings.sort_by(f64::total_cmp);
            for pair in crossings.chunks_exact(2) {
                let bound = |x: f64| (x - 0.5).ceil().clamp(0.0, self.columns as f64);
                #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the grid")]
                let (from, to) = (bound(pair[0]) as usize, bound(pair[1]) as usize);
                self.thirds[row * self.columns + from..row * self.columns + to.max(from)].fill(0);
            }
        }
    }

    /// Returns the rows that a polygon may reach into.
    fn rows_of(&self, polygon: &[DVec2]) -> Range<usize> {
        let span = polygon
            .iter()
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], corner| [low.min(corner.y), high.max(corner.y)]);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the grid")]
        let row = |y: f64| ((y - self.low.y) / self.cell_m).clamp(0.0, self.rows as f64) as usize;
        let [from, to] = span.map(row);
        from..self.rows.min(to + 1)
    }

    fn spread(&mut self) {
        let (columns, rows) = (self.columns, self.rows);
        for row in 0..rows {
            for column in 0..columns {
                self.relax(column, row, [(-1, 0, 3), (-1, -1, 4), (0, -1, 3), (1, -1, 4)]);
            }
        }
        for row in (0..rows).rev() {
            for column in (0..columns).rev() {
                self.relax(column, row, [(1, 0, 3), (1, 1, 4), (0, 1, 3), (-1, 1, 4)]);
            }
        }
    }

    fn relax(&mut self, column: usize, row: usize, neighbours: [(isize, isize, u32); 4]) {
        let here = row * self.columns + column;
        for (dx, dy, cost) in neighbours {
            let (Some(x), Some(y)) = (column.checked_add_signed(dx), row.checked_add_signed(dy)) else { continue };
            if x < self.columns && y < self.rows {
                self.thirds[here] = self.thirds[here].min(self.thirds[y * self.columns + x] + cost);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ds_space::Draws;
    use ds_space::plane::IndexedPolygon;

    #[test]
    fn a_polygon_marks_what_lies_in_it_and_its_edges_wherever_it_lies() {
        let empty = || DistanceGrid {
            low: DVec2::new(-7.0, 3.0),
            cell_m: 1.5,
            columns: 30,
            rows: 20,
            thirds: vec![u32::MAX / 2; 600],
        };
        for seed in 0..200 {
            let draws = Draws::from_seed(seed, "polygon");
            let polygon: Vec<DVec2> =
                (0..3).map(|i| DVec2::new(draws.range(i, -20.0, 50.0), draws.range(8 + i, -10.0, 45.0))).collect();
            let mut grid = empty();
            grid.mark(&polygon);
            let Some(area) = IndexedPolygon::new(&polygon, &[]) else { continue };
            for (i, thirds) in grid.thirds.iter().enumerate() {
                let centre = grid.low + (DVec2::new((i % 30) as f64, (i / 30) as f64) + 0.5) * grid.cell_m;
                // An edge marks the cells that it passes, whose centres are no farther off than half a diagonal.
                let beside = (0..3).any(|k| {
                    let (a, along) = (polygon[k], polygon[(k + 1) % 3] - polygon[k]);
                    let at = (along.dot(centre - a) / along.length_squared()).clamp(0.0, 1.0);
                    centre.distance(a + along * at) < 0.71 * grid.cell_m
                });
                let (marked, inside) = (*thirds == 0, area.holds(centre));
                assert!(if marked { inside || beside } else { !inside }, "seed {seed}: {centre} is marked: {marked}");
            }
        }
        let mut grid = empty();
        grid.mark(&[]);
        grid.mark(&[DVec2::NAN, DVec2::NAN, DVec2::NAN]);
        assert!(grid.thirds.iter().all(|thirds| *thirds > 0));
    }
}
