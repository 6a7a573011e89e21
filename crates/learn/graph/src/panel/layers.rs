//! Layers that the networks of the panel share. A declaration and its use stand side by side.

use burn::tensor::activation::{gelu, relu};
use burn::tensor::{Tensor, module};
use ds_nn::array::{Declared, Initial};

use crate::attention::attend;
use crate::graph::{Graph, fold};

/// Epsilon of the norms.
const EPSILON: f64 = 1e-5;
/// Spread of learned tokens before training.
const TOKEN_STD: f32 = 0.5;
/// Gain before a rectifier.
const RELU_GAIN: f32 = std::f32::consts::SQRT_2;
/// Gain of the last layer of a residual branch, so that a fresh network stays near its input.
const BRANCH_GAIN: f32 = 0.3;

/// Declares the LayerNorm `name`.
pub(super) fn declare_norm(list: &mut Vec<Declared>, name: &str, width: usize) {
    list.push(Declared::new(format!("{name}.weight"), &[width], Initial::Constant(1.0)));
    list.push(Declared::new(format!("{name}.bias"), &[width], Initial::Constant(0.0)));
}

/// LayerNorm over the last axis.
pub(super) fn norm<const D: usize>(graph: &Graph, name: &str, x: Tensor<D>) -> Tensor<D> {
    let width = x.dims()[D - 1];
    let weight = |part: &str| graph.weight::<1>(&format!("{name}.{part}"), [width]);
    module::layer_norm(x, weight("weight"), Some(weight("bias")), EPSILON)
}

/// Declares learned tokens.
pub(super) fn declare_tokens(list: &mut Vec<Declared>, name: &str, [tokens, width]: [usize; 2]) {
    list.push(Declared::new(name.to_owned(), &[tokens, width], Initial::Normal(TOKEN_STD)));
}

/// Learned tokens for each of a batch: [N, T, C].
pub(super) fn tokens(graph: &Graph, name: &str, [batch, tokens, width]: [usize; 3]) -> Tensor<3> {
    graph.weight::<2>(name, [tokens, width]).unsqueeze_dim::<3>(0).repeat_dim(0, batch)
}

/// Declares a fold of squares of pixels into `width` channels, with a 3×3 convolution after it.
pub(super) fn declare_stage(list: &mut Vec<Declared>, name: &str, inputs: usize, width: usize) {
    Declared::linear(list, &format!("{name}.fold"), inputs, width, RELU_GAIN);
    Declared::linear(list, &format!("{name}.convolution"), 9 * width, width, RELU_GAIN);
}

/// Folds squares of `side` pixels, then adds a 3×3 convolution.
pub(super) fn stage(graph: &Graph, name: &str, side: usize, x: Tensor<4>) -> Tensor<4> {
    let x = fold_stage(graph, name, side, x);
    x.clone() + relu(graph.linear(&format!("{name}.convolution")).convolve(x))
}

/// Folds squares of `side` pixels of [N, H, W, C] into the channels of `name.fold`.
pub(super) fn fold_stage(graph: &Graph, name: &str, side: usize, x: Tensor<4>) -> Tensor<4> {
    relu(graph.linear(&format!("{name}.fold")).apply(fold(x, side)))
}

/// Declares two layers `name.0` and `name.1` with a rectifier between.
pub(super) fn declare_pair(list: &mut Vec<Declared>, name: &str, [inputs, hidden, outputs]: [usize; 3], gain: f32) {
    Declared::linear(list, &format!("{name}.0"), inputs, hidden, RELU_GAIN);
    Declared::linear(list, &format!("{name}.1"), hidden, outputs, gain);
}

/// Two layers with a rectifier between.
pub(super) fn pair<const D: usize>(graph: &Graph, name: &str, x: Tensor<D>) -> Tensor<D> {
    let x = relu(graph.linear(&format!("{name}.0")).apply(x));
    graph.linear(&format!("{name}.1")).apply(x)
}

/// Declares a pre-norm transformer block of a width; `cross` adds attention to a context of the same width.
pub(super) fn declare_block(list: &mut Vec<Declared>, name: &str, width: usize, ratio: usize, cross: bool) {
    declare_attention(list, &format!("{name}.self"), width);
    if cross {
        declare_attention(list, &format!("{name}.cross"), width);
    }
    declare_hidden(list, &format!("{name}.mlp"), width, ratio);
}

/// A pre-norm transformer block: attention among the tokens, attention to the context if there is one, two layers.
pub(super) fn block(graph: &Graph, name: &str, heads: usize, x: Tensor<3>, context: Option<&Tensor<3>>) -> Tensor<3> {
    let mut x = attended(graph, &format!("{name}.self"), heads, x, None);
    if context.is_some() {
        x = attended(graph, &format!("{name}.cross"), heads, x, context);
    }
    hidden(graph, &format!("{name}.mlp"), x)
}

/// Declares attention with a norm before it.
pub(super) fn declare_attention(list: &mut Vec<Declared>, name: &str, width: usize) {
    declare_norm(list, &format!("{name}.norm"), width);
    for part in ["q", "k", "v"] {
        Declared::linear(list, &format!("{name}.{part}"), width, width, 1.0);
    }
    Declared::linear(list, &format!("{name}.out"), width, width, BRANCH_GAIN);
}

/// Adds attention to a context, or among the tokens without one.
pub(super) fn attended(
    graph: &Graph,
    name: &str,
    heads: usize,
    x: Tensor<3>,
    context: Option<&Tensor<3>>,
) -> Tensor<3> {
    let layer = |part: &str| graph.linear(&format!("{name}.{part}"));
    let queries = norm(graph, &format!("{name}.norm"), x.clone());
    let keys = context.unwrap_or(&queries).clone();
    let (q, k, v) = (layer("q").apply(queries), layer("k").apply(keys.clone()), layer("v").apply(keys));
    x + layer("out").apply(attend(graph.mode, heads, [q, k, v]))
}

/// Declares two layers with a norm before them, the hidden one `ratio` times as wide.
pub(super) fn declare_hidden(list: &mut Vec<Declared>, name: &str, width: usize, ratio: usize) {
    declare_norm(list, &format!("{name}.norm"), width);
    declare_pair(list, name, [width, ratio * width, width], BRANCH_GAIN);
}

/// Adds two layers over each token.
pub(super) fn hidden(graph: &Graph, name: &str, x: Tensor<3>) -> Tensor<3> {
    let y = graph.linear(&format!("{name}.0")).apply(norm(graph, &format!("{name}.norm"), x.clone()));
    x + graph.linear(&format!("{name}.1")).apply(gelu(y))
}
