//! `ltf`: convolutions over the frame, fused at two scales with a learned grid of the ground; one plan, no scorer.
//!
//! The grid stands in the place of a lidar's: 16×16, then 8×8 cells over x 0 to 64 m, y −32 to 32 m. At 1/8 and 1/16 of
//! the frame a transformer block runs over both. The 64 cells are the context; with a token of the state they are the
//! keys of one query of the plan and of twelve spare ones.

use burn::tensor::Tensor;
use burn::tensor::activation::relu;
use ds_nn::array::Declared;

use super::layers::{
    block, declare_block, declare_norm, declare_pair, declare_stage, declare_tokens, norm, pair, stage, tokens,
};
use super::{Heads, PLAN, STATE};
use crate::graph::{Graph, fold, unfold};

/// Rows and columns of the context.
pub(super) const LATENT: [usize; 2] = [8, 8];
const CELLS: usize = LATENT[0] * LATENT[1];
const PLACES: usize = 60;
const FINE: usize = 64;
const WIDTH: usize = 128;
const QUERIES: usize = 13;
const HEADS: usize = 4;
const LAYERS: usize = 2;

pub(super) fn declared() -> Vec<Declared> {
    let mut list = Vec::new();
    declare_stage(&mut list, "stage0", 48, 32);
    declare_stage(&mut list, "stage1", 4 * 32, FINE);
    declare_stage(&mut list, "stage2", 4 * FINE, WIDTH);
    declare_tokens(&mut list, "grid", [4 * CELLS, FINE]);
    declare_stage(&mut list, "grid.stage", 4 * FINE, WIDTH);
    for (name, width) in [("fine", FINE), ("coarse", WIDTH)] {
        declare_tokens(&mut list, &format!("{name}.places"), [PLACES + CELLS, width]);
        declare_block(&mut list, name, width, 2, false);
    }
    declare_norm(&mut list, "context.norm", WIDTH);
    declare_tokens(&mut list, "cells", [CELLS, WIDTH]);
    declare_pair(&mut list, "state", [STATE, WIDTH, WIDTH], 1.0);
    declare_tokens(&mut list, "queries", [QUERIES, WIDTH]);
    for index in 0..LAYERS {
        declare_block(&mut list, &format!("decoder{index}"), WIDTH, 2, true);
    }
    declare_norm(&mut list, "read.norm", WIDTH);
    declare_pair(&mut list, "read", [WIDTH, WIDTH, PLAN], 0.5);
    list
}

/// The cells of the ground, [N, 64, 128], row by row.
pub(super) fn context(graph: &Graph, images: Tensor<4>) -> Tensor<3> {
    let batch = images.dims()[0];
    let image = stage(graph, "stage1", 2, stage(graph, "stage0", 4, images));
    let grid = tokens(graph, "grid", [batch, 4 * CELLS, FINE]).reshape([batch, 16, 16, FINE]);
    let (image, grid) = fused_fine(graph, image, grid);
    let image = stage(graph, "stage2", 2, image).reshape([batch, PLACES, WIDTH]);
    let grid = stage(graph, "grid.stage", 2, grid).reshape([batch, CELLS, WIDTH]);
    let x = fuse(graph, "coarse", image, grid);
    norm(graph, "context.norm", x.slice([0..batch, PLACES..PLACES + CELLS, 0..WIDTH]))
}

/// Lets both know of each other through means of 2×2 places.
fn fused_fine(graph: &Graph, image: Tensor<4>, grid: Tensor<4>) -> (Tensor<4>, Tensor<4>) {
    let batch = image.dims()[0];
    let (coarse_image, coarse_grid) = (halved(image.clone()), halved(grid.clone()));
    let before = Tensor::cat(vec![coarse_image.clone(), coarse_grid.clone()], 1);
    let change = fuse(graph, "fine", coarse_image, coarse_grid) - before;
    let spread = |x: Tensor<3>, rows: usize, columns: usize| {
        let x = x.reshape([batch, rows, columns, FINE]);
        unfold(x.repeat_dim(3, 4), 2)
    };
    let image = image + spread(change.clone().slice([0..batch, 0..PLACES, 0..FINE]), 6, 10);
    let grid = grid + spread(change.slice([0..batch, PLACES..PLACES + CELLS, 0..FINE]), LATENT[0], LATENT[1]);
    (image, grid)
}

/// Means of 2×2 places of [N, H, W, C], as tokens.
fn halved(x: Tensor<4>) -> Tensor<3> {
    let [batch, rows, columns, channels] = x.dims();
    let x = fold(x, 2).reshape([batch, rows * columns / 4, 4, channels]);
    x.mean_dim(2).reshape([batch, rows * columns / 4, channels])
}

fn fuse(graph: &Graph, name: &str, image: Tensor<3>, grid: Tensor<3>) -> Tensor<3> {
    let x = Tensor::cat(vec![image, grid], 1);
    let places = tokens(graph, &format!("{name}.places"), x.dims());
    block(graph, name, HEADS, x + places, None)
}

pub(super) fn plan(graph: &Graph, context: &Tensor<3>, state: &Tensor<2>) -> Heads {
    let batch = state.dims()[0];
    let told = relu(pair(graph, "state", state.clone())).unsqueeze_dim::<3>(1);
    let keys = context.clone() + tokens(graph, "cells", [batch, CELLS, WIDTH]);
    let keys = Tensor::cat(vec![keys, told], 1);
    let mut x = tokens(graph, "queries", [batch, QUERIES, WIDTH]);
    for index in 0..LAYERS {
        x = block(graph, &format!("decoder{index}"), HEADS, x, Some(&keys));
    }
    let query = x.slice([0..batch, 0..1, 0..WIDTH]);
    Heads { plans: vec![pair(graph, "read", norm(graph, "read.norm", query))], scores: None }
}
