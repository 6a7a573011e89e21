//! `rap`: plans that are refined where they lie in the frame, learned from frames and from rasters alike.
//!
//! Frame → 240 patches of 8×8 pixels → 4 transformer blocks → a neck: the context. 32 plans of four tokens, two poses each,
//! with the state added, are read out, then refined twice by the same two layers: tokens attend to each other and read the
//! context where their two poses lie in the known camera, at four heights and with offsets of their own. A plan's largest
//! token values give the total and sub-scores. Beside it a classifier says from the mean of the context whether it is of a raster; its
//! gradient reaches the context reversed. Poses go from refinement to refinement as plain numbers.

use burn::tensor::Tensor;
use burn::tensor::activation::softmax;
use ds_nn::array::{Array, Declared};
use ds_space::DVec3;

use super::layers::{
    attended, block, declare_attention, declare_block, declare_hidden, declare_norm, declare_pair, declare_tokens,
    hidden, norm, pair, tokens,
};
use super::sampling::Shares;
use super::view::{MAPS, share};
use super::{Heads, Inputs, PLAN, STATE, TERMS, straight_on_m, units};
use crate::graph::{Graph, array_of, fold};
use crate::planner::known_camera;

const PATCH_PX: usize = 8;
/// Rows and columns of the patches.
pub(super) const GRID: [usize; 2] = MAPS[0];
const PATCHES: usize = GRID[0] * GRID[1];
const WIDTH: usize = 64;
const BLOCKS: usize = 4;
const HEADS: usize = 4;
const NECK: usize = 96;
const PLANS: usize = 32;
const TOKENS: usize = 4;
const POSES: usize = 2;
const REFINEMENTS: usize = 2;
const LAYERS: usize = 2;
/// Heights above the ground at which the context is read, in metres.
const HEIGHTS_M: [f64; 4] = [0.0, 0.5, 1.0, 2.0];
const POINTS: usize = POSES * HEIGHTS_M.len();
/// The largest offset of a point, in patches.
const REACH: f32 = 2.0;

pub(super) fn declared() -> Vec<Declared> {
    let mut list = Vec::new();
    Declared::linear(&mut list, "patches", 3 * PATCH_PX * PATCH_PX, WIDTH, 1.0);
    declare_tokens(&mut list, "places", [PATCHES, WIDTH]);
    for index in 0..BLOCKS {
        declare_block(&mut list, &format!("encoder{index}"), WIDTH, 4, false);
    }
    declare_norm(&mut list, "encoder.norm", WIDTH);
    Declared::linear(&mut list, "neck", WIDTH, NECK, 1.0);
    declare_pair(&mut list, "domain", [NECK, NECK, 1], 0.2);
    declare_tokens(&mut list, "queries", [PLANS * TOKENS, NECK]);
    declare_pair(&mut list, "state", [STATE, NECK, NECK], 1.0);
    for layer in 0..LAYERS {
        let name = format!("refiner{layer}");
        declare_attention(&mut list, &format!("{name}.self"), NECK);
        declare_norm(&mut list, &format!("{name}.map.norm"), NECK);
        Declared::linear(&mut list, &format!("{name}.map.offsets"), NECK, 2 * POINTS, 0.3);
        Declared::linear(&mut list, &format!("{name}.map.weights"), NECK, POINTS, 0.3);
        Declared::linear(&mut list, &format!("{name}.map.values"), NECK, NECK, 1.0);
        Declared::linear(&mut list, &format!("{name}.map.out"), NECK, NECK, 1.0);
        declare_hidden(&mut list, &format!("{name}.mlp"), NECK, 2);
    }
    declare_norm(&mut list, "read.norm", NECK);
    declare_pair(&mut list, "read", [NECK, NECK, PLAN / TOKENS], 0.5);
    declare_norm(&mut list, "scores.norm", NECK);
    declare_pair(&mut list, "scores", [NECK, NECK, TERMS], 0.2);
    list
}

/// The patches after the neck, [N, 240, 96], row by row.
pub(super) fn context(graph: &Graph, images: Tensor<4>) -> Tensor<3> {
    let [batch, ..] = images.dims();
    let patches = graph.linear("patches").apply(fold(images, PATCH_PX)).reshape([batch, PATCHES, WIDTH]);
    let mut x = patches + tokens(graph, "places", [batch, PATCHES, WIDTH]);
    for index in 0..BLOCKS {
        x = block(graph, &format!("encoder{index}"), HEADS, x, None);
    }
    graph.linear("neck").apply(norm(graph, "encoder.norm", x))
}

pub(super) fn plan(graph: &Graph, context: &Tensor<3>, state: Tensor<2>, inputs: &Inputs<'_>) -> Heads {
    let [batch, ..] = context.dims();
    let mut x =
        tokens(graph, "queries", [batch, PLANS * TOKENS, NECK]) + pair(graph, "state", state).unsqueeze_dim::<3>(1);
    let read = |x: &Tensor<3>| pair(graph, "read", norm(graph, "read.norm", x.clone())).reshape([batch, PLANS, PLAN]);
    let mut plans = vec![read(&x)];
    for _ in 0..REFINEMENTS {
        let before = array_of(plans.last().expect("there is the first").clone());
        let points = points_of(&before, &inputs.speeds_mps());
        for layer in 0..LAYERS {
            x = refined(graph, &format!("refiner{layer}"), x, context, &points);
        }
        plans.push(read(&x) + graph.tensor::<3>(&before));
    }
    let largest = x.reshape([batch, PLANS, TOKENS, NECK]).max_dim(2).reshape([batch, PLANS, NECK]);
    let scores = pair(graph, "scores", norm(graph, "scores.norm", largest));
    let domain = pair(graph, "domain", reversed(context.clone().mean_dim(1), inputs.reversal));
    Heads { plans, scores: vec![domain, scores] }
}

/// Compares the tokens, reads the context where their poses lie, and goes through two layers.
fn refined(graph: &Graph, name: &str, x: Tensor<3>, context: &Tensor<3>, points: &Array) -> Tensor<3> {
    let [batch, count, _] = x.dims();
    let linear = |part: &str| graph.linear(&format!("{name}.map.{part}"));
    let x = attended(graph, &format!("{name}.self"), HEADS, x, None);
    let asked = norm(graph, &format!("{name}.map.norm"), x.clone());
    let offsets = linear("offsets").apply(asked.clone()).tanh() * REACH;
    let places = graph.tensor::<4>(points) + offsets.reshape([batch, count, POINTS, 2]);
    let weights = softmax(linear("weights").apply(asked), 2);
    let read = Shares::moved(graph, places, GRID).read(linear("values").apply(context.clone()), weights);
    hidden(graph, &format!("{name}.mlp"), x + linear("out").apply(read))
}

/// Where each token's poses lie among the patches, [N, 128, 8, 2]: row and column, from the middle of the first patch.
fn points_of(plans: &Array, speeds_mps: &[f32]) -> Array {
    let camera = known_camera();
    let each = plans.values().len() / speeds_mps.len();
    let mut places = Vec::with_capacity(plans.values().len() / 3 * 2 * HEIGHTS_M.len());
    for (plans, speed_mps) in plans.values().chunks_exact(each).zip(speeds_mps) {
        for (index, numbers) in plans.chunks_exact(3).enumerate() {
            let pose = index % (PLAN / 3);
            let [along, across, _] = units(pose);
            let x_m = straight_on_m(f64::from(*speed_mps), pose) + along * f64::from(numbers[0]);
            let y_m = across * f64::from(numbers[1]);
            for height_m in HEIGHTS_M {
                let seen = share(&camera, DVec3::new(x_m, y_m, height_m));
                places.extend([0, 1].map(|side: usize| seen[side] * GRID[side] as f32 - 0.5));
            }
        }
    }
    Array::new(&[speeds_mps.len(), PLANS * TOKENS, POINTS, 2], places)
}

/// Features as they are, whose gradient comes back reversed and scaled.
fn reversed(x: Tensor<3>, by: f32) -> Tensor<3> {
    x.clone().detach() * (1.0 + by) - x * by
}
