//! A grid over bounding boxes: which of them may hold a point, or touch a box.

use super::Bounds;
use crate::DVec2;

const MOST_CELLS: f64 = 4096.0;
const SMALLEST_CELL_M: f64 = 4.0;

/// Ids of boxes by cell. Any fixed frame, metres.
#[derive(Debug, Clone)]
pub struct Grid {
    bounds: Bounds,
    cells_per_m: f64,
    columns: usize,
    rows: usize,
    starts: Vec<u32>,
    entries: Vec<u32>,
}

impl Grid {
    /// Sorts boxes into cells; ids are their indices.
    pub fn new(boxes: &[Bounds]) -> Self {
        let bounds = boxes.iter().filter(|one| !one.is_empty()).fold(Bounds::EMPTY, |all, one| all.union(one));
        if bounds.is_empty() {
            return Self { bounds, cells_per_m: 0.0, columns: 0, rows: 0, starts: vec![0], entries: Vec::new() };
        }
        let size = bounds.high - bounds.low;
        let cell_m = ((size.x + 1.0) * (size.y + 1.0) / MOST_CELLS).sqrt().max(SMALLEST_CELL_M);
        let mut grid =
            Self { bounds, cells_per_m: 1.0 / cell_m, columns: 1, rows: 1, starts: Vec::new(), entries: Vec::new() };
        (grid.columns, grid.rows) = (usize::MAX, usize::MAX);
        let last = grid.cell(bounds.high);
        (grid.columns, grid.rows) = (last.0 + 1, last.1 + 1);
        grid.fill(boxes);
        grid
    }

    fn fill(&mut self, boxes: &[Bounds]) {
        let cells = self.columns * self.rows;
        self.starts = vec![0; cells + 1];
        for one in boxes.iter().filter(|one| !one.is_empty()) {
            self.each_cell(one, |cell, grid| grid.starts[cell + 1] += 1);
        }
        for cell in 0..cells {
            self.starts[cell + 1] += self.starts[cell];
        }
        let mut next = self.starts.clone();
        self.entries = vec![0; self.starts[cells] as usize];
        for (id, one) in (0u32..).zip(boxes).filter(|(_, one)| !one.is_empty()) {
            self.each_cell(one, |cell, grid| {
                grid.entries[next[cell] as usize] = id;
                next[cell] += 1;
            });
        }
    }

    fn each_cell(&mut self, one: &Bounds, mut visit: impl FnMut(usize, &mut Self)) {
        let (first, last) = (self.cell(one.low), self.cell(one.high));
        for row in first.1..=last.1 {
            for column in first.0..=last.0 {
                visit(row * self.columns + column, self);
            }
        }
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the grid; casts saturate")]
    fn cell(&self, point: DVec2) -> (usize, usize) {
        let offset = (point - self.bounds.low) * self.cells_per_m;
        ((offset.x as usize).min(self.columns - 1), (offset.y as usize).min(self.rows - 1))
    }

    /// Returns the ids of all boxes that may hold a point, in rising order.
    pub fn near(&self, point: DVec2) -> &[u32] {
        if !self.bounds.holds(point) {
            return &[];
        }
        let (column, row) = self.cell(point);
        let cell = row * self.columns + column;
        &self.entries[self.starts[cell] as usize..self.starts[cell + 1] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn no_box_is_missed(
            corners in prop::collection::vec((-300.0..300.0f64, -300.0..300.0f64, 0.0..80.0f64, 0.0..80.0f64), 0..40),
            x in -400.0..400.0f64, y in -400.0..400.0f64,
        ) {
            let boxes: Vec<Bounds> = corners
                .iter()
                .map(|(x, y, w, h)| Bounds { low: DVec2::new(*x, *y), high: DVec2::new(x + w, y + h) })
                .collect();
            let grid = Grid::new(&boxes);
            let point = DVec2::new(x, y);
            let near = grid.near(point);
            for (id, one) in (0u32..).zip(&boxes) {
                prop_assert!(!one.holds(point) || near.contains(&id));
            }
            prop_assert!(near.windows(2).all(|pair| pair[0] < pair[1]));
        }
    }
}
