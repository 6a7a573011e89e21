//! Where points on the ground lie in the maps of a frame of the known camera: what is read there, bilinearly.
//!
//! Maps have cells of 8 and of 16 pixels, their value in the middle. Each point is read on the ground and half a metre
//! above it; what the camera does not see reads as zero.

use burn::tensor::Tensor;
use ds_space::{CameraModel, DVec3};

use super::sampling::Shares;
use crate::graph::Graph;
use crate::planner::{HEIGHT_PX, WIDTH_PX, known_camera};

/// Rows and columns of both maps.
pub(super) const MAPS: [[usize; 2]; 2] = [[HEIGHT_PX / 8, WIDTH_PX / 8], [HEIGHT_PX / 16, WIDTH_PX / 16]];
/// Heights above the ground, in metres.
const HEIGHTS_M: [f64; 2] = [0.0, 0.5];
/// A row and a column from which nothing is read.
const UNSEEN: [f32; 2] = [-9.0; 2];

/// Points in both maps.
pub(super) struct Views {
    maps: [Shares; 2],
    /// Points of a query, at all heights.
    points: usize,
}

impl Views {
    /// Places so many samples × queries × points, given as x and y in the rig, in metres.
    pub(super) fn of(
        graph: &Graph,
        points: impl Iterator<Item = [f32; 2]>,
        [batch, queries, each]: [usize; 3],
    ) -> Self {
        let camera = known_camera();
        let at = |[x, y]: [f32; 2], height_m| share(&camera, DVec3::new(f64::from(x), f64::from(y), height_m));
        let seen: Vec<[f32; 2]> = points.flat_map(|point| HEIGHTS_M.map(|height_m| at(point, height_m))).collect();
        let count = each * HEIGHTS_M.len();
        let maps = MAPS.map(|[rows, columns]| {
            let cell = |[row, column]: &[f32; 2]| [row * rows as f32 - 0.5, column * columns as f32 - 0.5];
            Shares::of(graph, seen.iter().map(cell), [batch, queries, count], [rows, columns])
        });
        Self { maps, points: count }
    }

    /// Returns the sum of both maps [N, cells, C] at the points of each query, weighted [N, M, maps × points].
    pub(super) fn read(&self, values: [Tensor<3>; 2], weights: &Tensor<3>) -> Tensor<3> {
        let [batch, queries, _] = weights.dims();
        let [fine, coarse] = values;
        let part = |from: usize| weights.clone().slice([0..batch, 0..queries, from..from + self.points]);
        self.maps[0].read(fine, part(0)) + self.maps[1].read(coarse, part(self.points))
    }
}

/// Returns where in the frame a point in the rig lies, as shares of its height and width.
#[expect(clippy::cast_possible_truncation, reason = "cells need no double precision")]
pub(super) fn share(camera: &CameraModel, point_m: DVec3) -> [f32; 2] {
    let seen = camera.intrinsics.project(camera.rig_from_camera.inverse() * point_m);
    seen.map_or(UNSEEN, |pixel| [pixel.y as f32 / HEIGHT_PX as f32, pixel.x as f32 / WIDTH_PX as f32])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::{Mode, array_of};
    use ds_nn::{Array, Weights};

    #[test]
    fn points_are_read_where_the_known_camera_sees_them() {
        let camera = known_camera();
        // On the ground straight ahead: below the horizon by the camera's height over the way, less its pitch.
        let at = |x_m: f64, y_m: f64, height_m: f64| share(&camera, DVec3::new(x_m, y_m, height_m));
        let [row, column] = at(21.5, 0.0, 0.0);
        let below = (1.6_f64 / 20.0).atan() - 0.05;
        let expected = 48.0 + camera.intrinsics.fy_px * below.tan();
        assert!((f64::from(row) * 96.0 - expected).abs() < 0.01 && (column - 0.5).abs() < 1e-6, "{row} {column}");
        assert!(at(21.5, 0.0, 0.5)[0] < row && at(21.5, 3.0, 0.0)[1] < 0.5);
        assert_eq!(at(-5.0, 0.0, 0.0), UNSEEN);
    }

    #[test]
    fn both_maps_are_read_with_the_weights_of_each_height() {
        let graph = Graph::new(&Weights::default(), Mode::Infer);
        let views = Views::of(&graph, [[21.5, 2.0], [-5.0, 0.0]].into_iter(), [1, 1, 2]);
        let ramps = MAPS.map(|[rows, columns]| {
            let column = (0..rows * columns).map(|cell| ((cell % columns) as f32 + 0.5) / columns as f32);
            graph.tensor::<3>(&Array::new(&[1, rows * columns, 1], column.collect()))
        });
        // Fine at the ground, coarse half a metre above; the second point lies behind the camera.
        let weights = Array::new(&[1, 1, 8], vec![1.0, 0.0, 5.0, 5.0, 0.0, 10.0, 5.0, 5.0]);
        let found = array_of(views.read(ramps, &graph.tensor::<3>(&weights))).values()[0];
        let camera = known_camera();
        let [on_ground, above] = HEIGHTS_M.map(|height_m| share(&camera, DVec3::new(21.5, 2.0, height_m))[1]);
        assert!((found - (on_ground + 10.0 * above)).abs() < 1e-4, "{found}");
    }
}
