//! Named weights as tensors of the framework, with or without gradients, and the layers that all networks share.
//!
//! Linear weights are stored as [outputs, inputs]; a 3×3 convolution is a linear layer over the nine shifted copies
//! of an image in channels-last order [N, H, W, C], zero-padded.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use burn::tensor::{Device, Gradients, Tensor, TensorData, module};

use crate::array::{Array, Weights};

/// Whether a graph keeps what the backward pass needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mode {
    /// Forward only.
    Infer,
    /// Forward and backward.
    Train,
}

/// Weights on the device.
pub(crate) struct Graph {
    pub(crate) device: Device,
    pub(crate) mode: Mode,
    weights: BTreeMap<String, (Tensor<1>, Vec<usize>)>,
    constants: Mutex<BTreeMap<String, Tensor<2>>>,
}

impl Graph {
    pub(crate) fn new(weights: &Weights, mode: Mode) -> Self {
        let device = match mode {
            Mode::Infer => Device::flex(),
            Mode::Train => Device::flex().autodiff(),
        };
        let bind = |array: &Array| {
            let data = TensorData::new(array.values().to_vec(), [array.values().len()]);
            let leaf = Tensor::<1>::from_data(data, &device);
            let leaf = if mode == Mode::Train { leaf.require_grad() } else { leaf };
            (leaf, array.shape().to_vec())
        };
        let weights = weights.iter().map(|(name, array)| (name.to_owned(), bind(array))).collect();
        Self { device, mode, weights, constants: Mutex::default() }
    }

    /// Returns a weight by name; names and shapes were checked against the declarations before.
    pub(crate) fn weight<const D: usize>(&self, name: &str, shape: [usize; D]) -> Tensor<D> {
        let (leaf, _) = self.weights.get(name).expect("the weights were checked against the declarations");
        leaf.clone().reshape(shape)
    }

    pub(crate) fn linear(&self, name: &str) -> Linear {
        let (_, shape) = &self.weights[&format!("{name}.weight")];
        let (outputs, inputs) = (shape[0], shape[1..].iter().product());
        let weight = self.weight::<2>(&format!("{name}.weight"), [outputs, inputs]).transpose();
        let bias = self.weights.contains_key(&format!("{name}.bias"));
        Linear { weight, bias: bias.then(|| self.weight(&format!("{name}.bias"), [outputs])) }
    }

    pub(crate) fn tensor<const D: usize>(&self, array: &Array) -> Tensor<D> {
        let shape: [usize; D] = array.shape().try_into().expect("the caller fixes the rank");
        Tensor::from_data(TensorData::new(array.values().to_vec(), shape), &self.device)
    }

    /// Returns a constant matrix, made once.
    pub(crate) fn constant(&self, name: &str, make: impl FnOnce() -> Array) -> Tensor<2> {
        let mut constants = self.constants.lock().unwrap_or_else(PoisonError::into_inner);
        constants.entry(name.to_owned()).or_insert_with(|| self.tensor(&make())).clone()
    }

    /// Collects the gradient of every weight; weights without influence get zeros.
    pub(crate) fn gradients(&self, mut gradients: Gradients) -> Weights {
        let mut collected = Weights::default();
        for (name, (leaf, shape)) in &self.weights {
            let array = match leaf.grad_remove(&mut gradients) {
                Some(gradient) => array_of(gradient.reshape([shape.iter().product::<usize>()])).into_values(),
                None => vec![0.0; shape.iter().product()],
            };
            collected.insert(name, Array::new(shape, array));
        }
        collected
    }
}

/// Reads a tensor back.
pub(crate) fn array_of<const D: usize>(tensor: Tensor<D>) -> Array {
    let shape = tensor.dims();
    let values = tensor.try_into_vec_as::<f32>().expect("all tensors here are f32");
    Array::new(&shape, values)
}

/// A linear layer.
#[derive(Clone)]
pub(crate) struct Linear {
    weight: Tensor<2>,
    bias: Option<Tensor<1>>,
}

impl Linear {
    /// Makes a layer of a weight [inputs, outputs].
    pub(crate) fn of(weight: Tensor<2>, bias: Tensor<1>) -> Self {
        Self { weight, bias: Some(bias) }
    }

    pub(crate) fn apply<const D: usize>(&self, x: Tensor<D>) -> Tensor<D> {
        let mut shape = x.dims();
        let inputs = shape[D - 1];
        let rows = shape.iter().product::<usize>() / inputs;
        let y = module::linear(x.reshape([rows, inputs]), self.weight.clone(), self.bias.clone());
        shape[D - 1] = y.dims()[1];
        y.reshape(shape)
    }

    /// Applies the layer to the nine shifted copies of each image: a zero-padded 3×3 convolution.
    pub(crate) fn convolve(&self, x: Tensor<4>) -> Tensor<4> {
        let [n, h, w, c] = x.dims();
        let padded = Tensor::zeros([n, h + 2, w + 2, c], &x.device());
        let padded = padded.slice_assign([0..n, 1..h + 1, 1..w + 1, 0..c], x);
        let shifted = |tap: usize| {
            let (dy, dx) = (tap / 3, tap % 3);
            padded.clone().slice([0..n, dy..dy + h, dx..dx + w, 0..c])
        };
        self.apply(Tensor::cat((0..9).map(shifted).collect(), 3))
    }
}

/// Folds squares of `side` pixels of [N, H, W, C] into one pixel each, values ordered (row, column, channel).
pub(crate) fn fold(x: Tensor<4>, side: usize) -> Tensor<4> {
    let [n, h, w, c] = x.dims();
    let x = x.reshape([n, h / side, side, w / side, side, c]).permute([0, 1, 3, 2, 4, 5]);
    x.reshape([n, h / side, w / side, side * side * c])
}

/// Undoes [`fold`].
pub(crate) fn unfold(x: Tensor<4>, side: usize) -> Tensor<4> {
    let [n, h, w, c] = x.dims();
    let c = c / (side * side);
    let x = x.reshape([n, h, w, side, side, c]).permute([0, 1, 3, 2, 4, 5]);
    x.reshape([n, h * side, w * side, c])
}
