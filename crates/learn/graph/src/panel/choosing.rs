//! Keeps some of a network's tokens: those of the largest numbers, picked so that the gradient reaches them.

use burn::tensor::Tensor;
use ds_nn::array::Array;

use crate::graph::Graph;

/// Returns the places of the `count` largest numbers [N, M, 1] of each sample, in order.
pub(super) fn best(numbers: &Array, count: usize) -> Vec<Vec<usize>> {
    let words = numbers.shape()[1];
    let best_of = |row: &[f32]| {
        let mut order: Vec<usize> = (0..words).collect();
        order.sort_by(|a, b| row[*b].total_cmp(&row[*a]).then(a.cmp(b)));
        order.truncate(count);
        order.sort_unstable();
        order
    };
    numbers.values().chunks_exact(words).map(best_of).collect()
}

/// One where a row stands at a place, [N, rows, words].
pub(super) fn ones(graph: &Graph, places: &[Vec<usize>], words: usize) -> Tensor<3> {
    let rows = places[0].len();
    let mut values = vec![0.0; places.len() * rows * words];
    for (row, place) in places.iter().flatten().enumerate() {
        values[row * words + place] = 1.0;
    }
    graph.tensor(&Array::new(&[places.len(), rows, words], values))
}

/// The tokens at some places.
pub(super) fn picked(graph: &Graph, x: &Tensor<3>, places: &[Vec<usize>]) -> Tensor<3> {
    ones(graph, places, x.dims()[1]).matmul(x.clone())
}
