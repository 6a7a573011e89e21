//! The trunk of `ltf` and `diffusiondrive`: convolutions over the frame, fused at two scales with a learned grid of the
//! ground, and queries that read its cells together with the state.
//!
//! The grid stands in the place of a lidar's: 16×16, then 8×8 cells over x 0 to 64 m, y −32 to 32 m. At 1/8 and 1/16 of
//! the frame a transformer block runs over both.

use burn::tensor::Tensor;
use burn::tensor::activation::relu;
use ds_nn::array::Declared;

use super::STATE;
use super::layers::{block, declare_block, declare_norm, declare_pair, declare_stage, declare_tokens, norm, pair};
use super::layers::{stage, tokens};
use crate::graph::{Graph, fold, unfold};

/// Rows and columns of the coarse grid.
pub(super) const LATENT: [usize; 2] = [8, 8];
/// Cells of the coarse grid; the fine one has four in the place of each.
pub(super) const CELLS: usize = LATENT[0] * LATENT[1];
/// Channels of the fine grid.
pub(super) const FINE: usize = 64;
/// Channels of the coarse grid and of the queries.
pub(super) const WIDTH: usize = 128;
/// Heads of every attention.
pub(super) const HEADS: usize = 4;
/// Queries.
pub(super) const QUERIES: usize = 13;
const PLACES: usize = 60;
const LAYERS: usize = 2;

pub(super) fn declare(list: &mut Vec<Declared>) {
    declare_stage(list, "stage0", 48, 32);
    declare_stage(list, "stage1", 4 * 32, FINE);
    declare_stage(list, "stage2", 4 * FINE, WIDTH);
    declare_tokens(list, "grid", [4 * CELLS, FINE]);
    declare_stage(list, "grid.stage", 4 * FINE, WIDTH);
    for (name, width) in [("fine", FINE), ("coarse", WIDTH)] {
        declare_tokens(list, &format!("{name}.places"), [PLACES + CELLS, width]);
        declare_block(list, name, width, 2, false);
    }
    declare_norm(list, "context.norm", WIDTH);
}

pub(super) fn declare_queries(list: &mut Vec<Declared>) {
    declare_tokens(list, "cells", [CELLS, WIDTH]);
    declare_pair(list, "state", [STATE, WIDTH, WIDTH], 1.0);
    declare_tokens(list, "queries", [QUERIES, WIDTH]);
    for index in 0..LAYERS {
        declare_block(list, &format!("decoder{index}"), WIDTH, 2, true);
    }
}

/// The ground as the frame shows it.
pub(super) struct Ground {
    /// Fine cells, [N, 16, 16, 64].
    pub(super) fine: Tensor<4>,
    /// Coarse cells, [N, 64, 128], row by row.
    pub(super) coarse: Tensor<3>,
}

pub(super) fn ground(graph: &Graph, images: Tensor<4>) -> Ground {
    let batch = images.dims()[0];
    let image = stage(graph, "stage1", 2, stage(graph, "stage0", 4, images));
    let grid = tokens(graph, "grid", [batch, 4 * CELLS, FINE]).reshape([batch, 16, 16, FINE]);
    let (image, fine) = fused_fine(graph, image, grid);
    let image = stage(graph, "stage2", 2, image).reshape([batch, PLACES, WIDTH]);
    let grid = stage(graph, "grid.stage", 2, fine.clone()).reshape([batch, CELLS, WIDTH]);
    let x = fuse(graph, "coarse", image, grid);
    let coarse = norm(graph, "context.norm", x.slice([0..batch, PLACES..PLACES + CELLS, 0..WIDTH]));
    Ground { fine, coarse }
}

/// Lets both know of each other through means of 2×2 places.
fn fused_fine(graph: &Graph, image: Tensor<4>, grid: Tensor<4>) -> (Tensor<4>, Tensor<4>) {
    let batch = image.dims()[0];
    let (coarse_image, coarse_grid) = (halved(image.clone()), halved(grid.clone()));
    let before = Tensor::cat(vec![coarse_image.clone(), coarse_grid.clone()], 1);
    let change = fuse(graph, "fine", coarse_image, coarse_grid) - before;
    let image = image + doubled(change.clone().slice([0..batch, 0..PLACES, 0..FINE]), [6, 10]);
    let grid = grid + doubled(change.slice([0..batch, PLACES..PLACES + CELLS, 0..FINE]), LATENT);
    (image, grid)
}

/// Means of 2×2 places of [N, H, W, C], as tokens.
pub(super) fn halved(x: Tensor<4>) -> Tensor<3> {
    let [batch, rows, columns, channels] = x.dims();
    let x = fold(x, 2).reshape([batch, rows * columns / 4, 4, channels]);
    x.mean_dim(2).reshape([batch, rows * columns / 4, channels])
}

/// Tokens of rows and columns at 2×2 places each.
pub(super) fn doubled(x: Tensor<3>, [rows, columns]: [usize; 2]) -> Tensor<4> {
    let [batch, _, channels] = x.dims();
    unfold(x.reshape([batch, rows, columns, channels]).repeat_dim(3, 4), 2)
}

fn fuse(graph: &Graph, name: &str, image: Tensor<3>, grid: Tensor<3>) -> Tensor<3> {
    let x = Tensor::cat(vec![image, grid], 1);
    let places = tokens(graph, &format!("{name}.places"), x.dims());
    block(graph, name, HEADS, x + places, None)
}

/// Queries [N, 13, 128] after two layers over 64 cells and a token of the state.
pub(super) fn queries(graph: &Graph, cells: Tensor<3>, state: Tensor<2>) -> Tensor<3> {
    let batch = state.dims()[0];
    let told = relu(pair(graph, "state", state)).unsqueeze_dim::<3>(1);
    let keys = cells + tokens(graph, "cells", [batch, CELLS, WIDTH]);
    let keys = Tensor::cat(vec![keys, told], 1);
    let mut x = tokens(graph, "queries", [batch, QUERIES, WIDTH]);
    for index in 0..LAYERS {
        x = block(graph, &format!("decoder{index}"), HEADS, x, Some(&keys));
    }
    x
}
