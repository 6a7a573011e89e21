//! Marks which corners of a box lie in which lane; the memory is reused from step to step.

/// Which corners lie in which lane, for one step.
#[derive(Debug, Clone, Default)]
pub(crate) struct LaneMarks {
    corners: Vec<u8>,
    touched: Vec<usize>,
}

impl LaneMarks {
    pub(crate) fn clear(&mut self, polygons: usize) {
        for id in self.touched.drain(..) {
            self.corners[id] = 0;
        }
        self.corners.resize(polygons, 0);
    }

    pub(crate) fn mark(&mut self, id: usize, corner: usize) {
        if self.corners[id] == 0 {
            self.touched.push(id);
        }
        self.corners[id] |= 1 << corner;
    }

    pub(crate) fn in_multiple(&self) -> bool {
        self.touched.len() > 1 && self.touched.iter().all(|id| self.corners[*id] != 0b1111)
    }
}
