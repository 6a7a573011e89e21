//! `ltf`: convolutions over the frame, fused at two scales with a learned grid of the ground; one plan, no scorer.
//!
//! The 64 coarse cells of the trunk are the context; the first of its queries is read out as the plan, the others are spare.

use burn::tensor::Tensor;
use ds_nn::array::Declared;

use super::layers::{declare_norm, declare_pair, norm, pair};
use super::trunk::{self, WIDTH};
use super::{Heads, PLAN};
use crate::graph::Graph;

pub(super) fn declared() -> Vec<Declared> {
    let mut list = Vec::new();
    trunk::declare(&mut list);
    trunk::declare_queries(&mut list);
    declare_norm(&mut list, "read.norm", WIDTH);
    declare_pair(&mut list, "read", [WIDTH, WIDTH, PLAN], 0.5);
    list
}

/// The cells of the ground, [N, 64, 128], row by row.
pub(super) fn context(graph: &Graph, images: Tensor<4>) -> Tensor<3> {
    trunk::ground(graph, images).coarse
}

pub(super) fn plan(graph: &Graph, context: Tensor<3>, state: Tensor<2>) -> Heads {
    let batch = state.dims()[0];
    let query = trunk::queries(graph, context, state).slice([0..batch, 0..1, 0..WIDTH]);
    Heads { plans: vec![pair(graph, "read", norm(graph, "read.norm", query))], scores: Vec::new() }
}
