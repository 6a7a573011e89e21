//! Reads maps at points, bilinearly, and a map of the ground at those of plans; what lies beyond a map reads as zero.
//!
//! Cells of the ground are squares of 4 m with the value in their middle: row 0 lies 60 to 64 m ahead, column 0 28 to 32 m to the left.
//! Points come as plain numbers, so no gradient reaches them; it reaches the map and the weight of each point.

use burn::tensor::Tensor;
use burn::tensor::activation::relu;
use ds_nn::array::Array;

use super::diffusion::POINTS;
use super::units;
use crate::graph::Graph;

/// Rows and columns of the map.
pub(super) const MAP: [usize; 2] = [16, 16];
/// Poses of a plan.
pub(super) const POSES: usize = POINTS / 2;

const CELL_M: f32 = 4.0;
const AHEAD_M: f32 = 64.0;
const LEFT_M: f32 = 32.0;

/// How much of each row and of each column of a map some points read.
pub(super) struct Shares {
    rows: Tensor<4>,
    columns: Tensor<4>,
}

impl Shares {
    /// Places samples × queries × points, given as row and column, on a map of so many rows and columns.
    pub(super) fn of(
        graph: &Graph,
        points: impl Iterator<Item = [f32; 2]>,
        [batch, queries, each]: [usize; 3],
        sides: [usize; 2],
    ) -> Self {
        let mut shares = [Vec::new(), Vec::new()];
        for point in points {
            for (shares, (at, side)) in shares.iter_mut().zip(point.into_iter().zip(sides)) {
                shares.extend((0..side).map(|cell| (1.0 - (at - cell as f32).abs()).max(0.0)));
            }
        }
        let tensor = |shares: Vec<f32>, side| graph.tensor(&Array::new(&[batch, queries, each, side], shares));
        let [rows, columns] = shares;
        Self { rows: tensor(rows, sides[0]), columns: tensor(columns, sides[1]) }
    }

    /// Places points [N, M, P, 2], given as row and column; a gradient reaches them.
    pub(super) fn moved(graph: &Graph, points: Tensor<4>, sides: [usize; 2]) -> Self {
        let [batch, queries, each, _] = points.dims();
        let [rows, columns] = [0, 1].map(|which: usize| {
            let cells = Array::new(&[1, 1, 1, sides[which]], (0..sides[which]).map(|cell| cell as f32).collect());
            let at = points.clone().slice([0..batch, 0..queries, 0..each, which..which + 1]);
            relu((at.repeat_dim(3, sides[which]) - graph.tensor::<4>(&cells)).abs() * -1.0 + 1.0)
        });
        Self { rows, columns }
    }

    /// Returns the sum of a map [N, cells, C] at the points of each query, weighted [N, M, points]: [N, M, C].
    pub(super) fn read(&self, map: Tensor<3>, weights: Tensor<3>) -> Tensor<3> {
        let [batch, queries, _] = weights.dims();
        let rows = self.rows.clone() * weights.unsqueeze_dim::<4>(3);
        let cells = rows.swap_dims(2, 3).matmul(self.columns.clone());
        let [.., high, wide] = cells.dims();
        cells.reshape([batch, queries, high * wide]).matmul(map)
    }
}

/// Where the points of plans lie on the map of the ground.
pub(super) struct Places {
    shares: Shares,
    /// Where the points lie from the middle of the map, in halves of it: [N, M, 16].
    pub(super) from_middle: Array,
}

impl Places {
    /// Places points [N, M, 16], in the units of plans of cars at some speeds in m/s.
    pub(super) fn of(graph: &Graph, points: &Array, speeds_mps: &[f32]) -> Self {
        let &[batch, plans, _] = points.shape() else { unreachable!("points have three sides") };
        let mut cells = Vec::with_capacity(points.values().len() / 2);
        for (points, speed_mps) in points.values().chunks_exact(plans * POINTS).zip(speeds_mps) {
            let pairs = points.chunks_exact(2).enumerate();
            cells.extend(pairs.map(|(index, point)| cell(index % POSES, *speed_mps, [point[0], point[1]])));
        }
        let middle = |(at, side): (&f32, usize)| 2.0 * (at + 0.5) / side as f32 - 1.0;
        let from_middle = cells.as_flattened().iter().zip(MAP.into_iter().cycle()).map(middle).collect();
        let shares = Shares::of(graph, cells.into_iter(), [batch, plans, POSES], MAP);
        Self { shares, from_middle: Array::new(points.shape(), from_middle) }
    }

    /// Returns the sum of a map [N, 256, C] at the points of each plan, weighted [N, M, 8]: [N, M, C].
    pub(super) fn read(&self, map: Tensor<3>, weights: Tensor<3>) -> Tensor<3> {
        self.shares.read(map, weights)
    }
}

/// Returns the row and the column of a point of a pose.
#[expect(clippy::cast_possible_truncation, reason = "cells need no double precision")]
fn cell(pose: usize, speed_mps: f32, [x, y]: [f32; 2]) -> [f32; 2] {
    let [along, across, _] = units(pose).map(|unit| unit as f32);
    let ahead_m = super::straight_on_m(f64::from(speed_mps), pose) as f32 + x * along;
    [(AHEAD_M - ahead_m) / CELL_M - 0.5, (LEFT_M - y * across) / CELL_M - 0.5]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::{Mode, array_of};
    use ds_nn::Weights;

    /// Bilinear reading by its definition, in the frame of the map.
    fn read(map: &[f32], [row, column]: [f32; 2]) -> f32 {
        let at = |r: f32, c: f32| {
            let inside = (0.0..16.0).contains(&r) && (0.0..16.0).contains(&c);
            if inside { map[r as usize * 16 + c as usize] } else { 0.0 }
        };
        let (r, c, u, v) = (row.floor(), column.floor(), row - row.floor(), column - column.floor());
        (1.0 - u) * ((1.0 - v) * at(r, c) + v * at(r, c + 1.0))
            + u * ((1.0 - v) * at(r + 1.0, c) + v * at(r + 1.0, c + 1.0))
    }

    #[test]
    fn maps_are_read_between_cells_and_their_gradient_is_what_was_read_of_each() {
        let map: Vec<f32> = (0..256).map(|k| (0.37 * k as f32).sin()).collect();
        let points: Vec<f32> = (0..32).map(|k| (1.7 * k as f32).cos() * if k == 9 { 40.0 } else { 3.0 }).collect();
        let weights: Vec<f32> = (0..16).map(|k| 0.1 + 0.05 * k as f32).collect();
        let graph = Graph::new(&Weights::default(), Mode::Train);
        let places = Places::of(&graph, &Array::new(&[1, 2, POINTS], points.clone()), &[9.0]);
        let leaf =
            |shape: &[usize], values: &[f32]| graph.tensor::<3>(&Array::new(shape, values.to_vec())).require_grad();
        let (tensor, weighed) = (leaf(&[1, 256, 1], &map), leaf(&[1, 2, POSES], &weights));
        let found = places.read(tensor.clone(), weighed.clone());
        let value = |plan: usize, pose: usize| {
            let at = 16 * plan + 2 * pose;
            read(&map, cell(pose, 9.0, [points[at], points[at + 1]]))
        };
        for (plan, found) in array_of(found.clone()).values().iter().enumerate() {
            let expected: f32 = (0..POSES).map(|pose| weights[8 * plan + pose] * value(plan, pose)).sum();
            assert!((found - expected).abs() < 1e-5, "plan {plan}: {found}, {expected} by hand");
        }
        let gradients = found.sum().backward();
        let by_weight = array_of(weighed.grad(&gradients).expect("it has one"));
        for (index, slope) in by_weight.values().iter().enumerate() {
            assert!((slope - value(index / 8, index % 8)).abs() < 1e-5, "weight {index}");
        }
        // All that a point inside reads sums to its weight.
        let by_map = array_of(tensor.grad(&gradients).expect("it has one"));
        let ones = vec![1.0; 256];
        let inside: f32 =
            (0..16).map(|k| weights[k] * read(&ones, cell(k % 8, 9.0, [points[2 * k], points[2 * k + 1]]))).sum();
        assert!((by_map.values().iter().sum::<f32>() - inside).abs() < 1e-4);
    }

    #[test]
    fn moved_points_read_the_same_and_their_gradient_is_the_slope_of_the_map() {
        let graph = Graph::new(&Weights::default(), Mode::Train);
        let map: Vec<f32> = (0..256).map(|k| (0.37 * k as f32).sin()).collect();
        let at = [3.3, 7.6, 11.2, 0.4];
        let tensor = graph.tensor::<3>(&Array::new(&[1, 256, 1], map.clone()));
        let weights = graph.tensor::<3>(&Array::new(&[1, 1, 2], vec![0.5, 2.0]));
        let points = graph.tensor::<4>(&Array::new(&[1, 1, 2, 2], at.to_vec())).require_grad();
        let found = Shares::moved(&graph, points.clone(), MAP).read(tensor.clone(), weights.clone());
        let placed = Shares::of(&graph, at.chunks_exact(2).map(|point| [point[0], point[1]]), [1, 1, 2], MAP);
        let difference = array_of(found.clone() - placed.read(tensor, weights)).values()[0];
        assert!(difference.abs() < 1e-6, "{difference}");
        let slopes = array_of(points.grad(&found.sum().backward()).expect("it has one"));
        for (index, slope) in slopes.values().iter().enumerate() {
            let by = |offset: f32| {
                let mut moved = at;
                moved[index] += offset;
                0.5 * read(&map, [moved[0], moved[1]]) + 2.0 * read(&map, [moved[2], moved[3]])
            };
            let numeric = (by(0.05) - by(-0.05)) / 0.1;
            assert!((slope - numeric).abs() < 1e-3, "{index}: {slope}, {numeric} by difference");
        }
    }

    #[test]
    fn cells_lie_where_the_frame_is() {
        // A standing car's plan that stays: the nearest row, between the middle columns.
        assert_eq!(cell(0, 0.0, [0.0, 0.0]), [15.5, 7.5]);
        // Straight on at 10 m/s for 4 s, and 3.4 m to the left.
        let [row, column] = cell(7, 10.0, [0.0, 1.0]);
        assert!((row - 5.5).abs() < 1e-6 && (column - (7.5 - 3.4 / 4.0)).abs() < 1e-6, "{row} {column}");
    }
}
