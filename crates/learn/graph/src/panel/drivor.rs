//! `drivor`: a transformer over patches whose registers are all that the planner sees; 64 plans, scored apart.
//!
//! Frame → 60 patches with place + 16 registers without → 4 blocks → the registers, through a neck: the context. 64
//! learned queries with the state added → 2 blocks over the context, plans read out after each. The plans, cut off from
//! the gradient, are embedded again and scored by 2 blocks of their own over the same context.

use burn::tensor::Tensor;
use burn::tensor::activation::relu;
use ds_nn::array::Declared;

use super::layers::{
    block, declare_block, declare_norm, declare_pair, declare_stage, declare_tokens, fold_stage, norm, pair, stage,
    tokens,
};
use super::{Heads, PLAN, STATE, TERMS};
use crate::graph::Graph;

const WIDTH: usize = 96;
const PATCHES: usize = 60;
const REGISTERS: usize = 16;
const BLOCKS: usize = 4;
const QUERIES: usize = 64;
const ENCODER_HEADS: usize = 4;
const DECODER_HEADS: usize = 8;
const DECODER_BLOCKS: usize = 2;

pub(super) fn declared() -> Vec<Declared> {
    let mut list = Vec::new();
    declare_stage(&mut list, "stage0", 48, 32);
    declare_stage(&mut list, "stage1", 4 * 32, 64);
    Declared::linear(&mut list, "stage2.fold", 4 * 64, WIDTH, 1.0);
    declare_tokens(&mut list, "places", [PATCHES, WIDTH]);
    declare_tokens(&mut list, "registers", [REGISTERS, WIDTH]);
    for index in 0..BLOCKS {
        declare_block(&mut list, &format!("encoder{index}"), WIDTH, 4, false);
    }
    declare_norm(&mut list, "encoder.norm", WIDTH);
    Declared::linear(&mut list, "neck", WIDTH, WIDTH, 1.0);
    declare_tokens(&mut list, "queries", [QUERIES, WIDTH]);
    declare_pair(&mut list, "state", [STATE, WIDTH, WIDTH], 1.0);
    declare_pair(&mut list, "embed", [PLAN, WIDTH, WIDTH], 1.0);
    declare_pair(&mut list, "scorer.state", [STATE, WIDTH, WIDTH], 1.0);
    for index in 0..DECODER_BLOCKS {
        declare_block(&mut list, &format!("planner{index}"), WIDTH, 2, true);
        declare_norm(&mut list, &format!("read{index}.norm"), WIDTH);
        declare_pair(&mut list, &format!("read{index}"), [WIDTH, WIDTH, PLAN], 0.5);
        declare_block(&mut list, &format!("scorer{index}"), WIDTH, 2, true);
    }
    declare_norm(&mut list, "scores.norm", WIDTH);
    declare_pair(&mut list, "scores", [WIDTH, WIDTH, TERMS], 0.2);
    list
}

/// The registers after the neck, [N, 16, 96].
pub(super) fn context(graph: &Graph, images: Tensor<4>) -> Tensor<3> {
    let x = stage(graph, "stage1", 2, stage(graph, "stage0", 4, images));
    let [batch, ..] = x.dims();
    let patches = fold_stage(graph, "stage2", 2, x).reshape([batch, PATCHES, WIDTH]);
    let patches = patches + tokens(graph, "places", [batch, PATCHES, WIDTH]);
    let mut x = Tensor::cat(vec![tokens(graph, "registers", [batch, REGISTERS, WIDTH]), patches], 1);
    for index in 0..BLOCKS {
        x = block(graph, &format!("encoder{index}"), ENCODER_HEADS, x, None);
    }
    let registers = x.slice([0..batch, 0..REGISTERS, 0..WIDTH]);
    graph.linear("neck").apply(norm(graph, "encoder.norm", registers))
}

pub(super) fn plan(graph: &Graph, context: &Tensor<3>, state: &Tensor<2>) -> Heads {
    let batch = state.dims()[0];
    let told = |name: &str| pair(graph, name, state.clone()).unsqueeze_dim::<3>(1);
    let mut x = tokens(graph, "queries", [batch, QUERIES, WIDTH]) + told("state");
    let mut plans = Vec::with_capacity(DECODER_BLOCKS);
    for index in 0..DECODER_BLOCKS {
        x = block(graph, &format!("planner{index}"), DECODER_HEADS, x, Some(context));
        plans.push(pair(graph, &format!("read{index}"), norm(graph, &format!("read{index}.norm"), x.clone())));
    }
    let last = plans.last().expect("there are read-outs").clone().detach();
    let mut y = relu(pair(graph, "embed", last)) + told("scorer.state");
    for index in 0..DECODER_BLOCKS {
        y = block(graph, &format!("scorer{index}"), DECODER_HEADS, y, Some(context));
    }
    let scores = pair(graph, "scores", norm(graph, "scores.norm", y));
    Heads { plans, scores: vec![scores] }
}
