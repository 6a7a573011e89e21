//! Named weights as tensors of the framework, with or without gradients, and the layers that all networks share.
//!
//! Linear weights are stored as [outputs, inputs]; a 3×3 convolution is a linear layer over the nine shifted copies
//! of an image in channels-last order [N, H, W, C], zero-padded.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Mutex, PoisonError};

use burn::tensor::{DType, Device, FloatDType, Gradients, Tensor, TensorData, bf16, module};
use ds_nn::array::{Array, Declared, Initial, Weights};
use ds_space::Draws;

use crate::device::{self, Precision};

/// Draws after which drawn weights repeat.
const DRAWN: u64 = 65_537;

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
    /// Number format of large layers and of cached keys and values.
    pub(crate) precision: Precision,
    weights: BTreeMap<String, (Tensor<1>, Vec<usize>)>,
    constants: Mutex<BTreeMap<String, Tensor<2>>>,
}

impl Graph {
    pub(crate) fn new(weights: &Weights, mode: Mode) -> Self {
        Self::new_in(Precision::F32, weights, mode)
    }

    /// Puts weights on the device to learn some of them by name: no gradient reaches the others.
    pub(crate) fn learning(weights: &Weights, learned: impl Fn(&str) -> bool) -> Self {
        let mut graph = Self::new(weights, Mode::Train);
        for (_, (leaf, _)) in graph.weights.iter_mut().filter(|(name, _)| !learned(name)) {
            *leaf = leaf.clone().detach();
        }
        graph
    }

    /// Puts weights on the device as f32, whatever large layers are computed in: what is trained is not rounded.
    pub(crate) fn new_in(precision: Precision, weights: &Weights, mode: Mode) -> Self {
        let mut graph = Self::empty(mode, precision);
        for (name, array) in weights.iter() {
            graph.bind(name, array, Precision::F32);
        }
        graph
    }

    /// Makes a graph without weights on the device of this process.
    pub(crate) fn empty(mode: Mode, precision: Precision) -> Self {
        let device = match mode {
            Mode::Infer => device::current(),
            Mode::Train => device::current().autodiff(),
        };
        Self { device, mode, precision, weights: BTreeMap::new(), constants: Mutex::default() }
    }

    /// Puts a weight on the device.
    pub(crate) fn bind(&mut self, name: &str, array: &Array, precision: Precision) {
        let data = TensorData::new(array.values().to_vec(), [array.values().len()]);
        let leaf = match precision {
            Precision::F32 => Tensor::<1>::from_data(data, &self.device),
            Precision::Bf16 => Tensor::<1>::from_data(data, (&self.device, DType::BF16)),
        };
        let leaf = if self.mode == Mode::Train { leaf.require_grad() } else { leaf };
        self.weights.insert(name.to_owned(), (leaf, array.shape().to_vec()));
    }

    /// Puts drawn weights on the device, one at a time: for measurements of networks whose published weights are absent.
    /// Draws repeat after a prime number of values, so that billions of them take seconds.
    pub(crate) fn bind_drawn(&mut self, declared: &[Declared], lowered: impl Fn(&Declared) -> Precision) {
        let draws = Draws::from_seed(1, "drawn-weights");
        #[expect(clippy::cast_possible_truncation, reason = "weights are single precision")]
        let table: Vec<f32> = (0..DRAWN).map(|index| draws.normal(index) as f32).collect();
        for weight in declared {
            let count = weight.shape.iter().product();
            let values = match weight.initial {
                Initial::Normal(std) | Initial::Folded(std) | Initial::Grown { std, .. } => {
                    table.iter().map(|value| std * value).cycle().take(count).collect()
                }
                Initial::Constant(constant) => vec![constant; count],
                Initial::Gates => table.iter().map(|value| 0.02 * value).cycle().take(count).collect(),
            };
            self.bind(&weight.name, &Array::new(&weight.shape, values), lowered(weight));
        }
    }

    /// Drops the names, once all layers hold their weights: what a layer rearranged is then kept once.
    pub(crate) fn forget(&mut self) {
        self.weights.clear();
    }

    /// Brings a tensor to the number format of large layers.
    pub(crate) fn lower<const D: usize>(&self, x: Tensor<D>) -> Tensor<D> {
        match self.precision {
            Precision::F32 => x,
            Precision::Bf16 => x.cast(FloatDType::BF16),
        }
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
        let bias = bias.then(|| self.weight::<1>(&format!("{name}.bias"), [outputs]));
        Linear { weight, bias }
    }

    /// A layer whose product is computed in the number format of large layers, whatever its weight is kept in.
    pub(crate) fn large(&self, name: &str) -> Linear {
        let Linear { weight, bias } = self.linear(name);
        Linear { weight: self.lower(weight), bias }
    }

    pub(crate) fn tensor<const D: usize>(&self, array: &Array) -> Tensor<D> {
        let shape: [usize; D] = array.shape().try_into().expect("the caller fixes the rank");
        Tensor::from_data(TensorData::new(array.values().to_vec(), shape), &self.device)
    }

    /// Puts values on the device in the number format of large layers: for many values of which few bits count, such as colours.
    pub(crate) fn coarse<const D: usize>(&self, array: &Array) -> Tensor<D> {
        match self.precision {
            Precision::F32 => self.tensor(array),
            Precision::Bf16 => {
                let shape: [usize; D] = array.shape().try_into().expect("the caller fixes the rank");
                Tensor::from_data(TensorData::new(rounded(array.values()), shape), (&self.device, DType::BF16))
            }
        }
    }

    /// Returns a constant matrix, made once.
    pub(crate) fn constant(&self, name: &str, make: impl FnOnce() -> Array) -> Tensor<2> {
        let mut constants = self.constants.lock().unwrap_or_else(PoisonError::into_inner);
        constants.entry(name.to_owned()).or_insert_with(|| self.tensor(&make())).clone()
    }

    /// Collects the gradient of every weight, read back at once; weights without influence get zeros.
    pub(crate) fn gradients(&self, mut gradients: Gradients) -> Weights {
        let (mut found, mut parts) = (BTreeSet::new(), Vec::new());
        for (name, (leaf, _)) in &self.weights {
            if let Some(gradient) = leaf.grad_remove(&mut gradients) {
                found.insert(name);
                parts.push(gradient);
            }
        }
        let values = if parts.is_empty() { Vec::new() } else { array_of(Tensor::cat(parts, 0)).into_values() };
        let mut rest = values.as_slice();
        let mut collected = Weights::default();
        for (name, (_, shape)) in &self.weights {
            let count = shape.iter().product();
            let array = if found.contains(name) {
                let (values, others) = rest.split_at(count);
                rest = others;
                values.to_vec()
            } else {
                vec![0.0; count]
            };
            collected.insert(name, Array::new(shape, array));
        }
        collected
    }
}

/// Values of one thread's share in [`rounded`].
const SHARE: usize = 1 << 21;

/// Rounds values to the nearest bf16; many of them on several cores.
fn rounded(values: &[f32]) -> Vec<bf16> {
    let mut made = vec![bf16::ZERO; values.len()];
    std::thread::scope(|scope| {
        for (values, made) in values.chunks(SHARE).zip(made.chunks_mut(SHARE)) {
            scope.spawn(|| values.iter().zip(made).for_each(|(value, made)| *made = bf16::from_f32(*value)));
        }
    });
    made
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
        let x = x.reshape([rows, inputs]).cast(self.weight.dtype());
        let y = if self.weight.dtype() == DType::BF16 {
            // Devices multiply bf16 and convert it, not all add it.
            let y = x.matmul(self.weight.clone()).cast(FloatDType::F32);
            match &self.bias {
                Some(bias) => y + bias.clone().cast(FloatDType::F32).unsqueeze(),
                None => y,
            }
        } else {
            module::linear(x, self.weight.clone(), self.bias.clone())
        };
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

/// Returns some channels of images [N, H, W, C].
pub(crate) fn channels(x: &Tensor<4>, range: std::ops::Range<usize>) -> Tensor<4> {
    let [n, h, w, _] = x.dims();
    x.clone().slice([0..n, 0..h, 0..w, range])
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

/// A square matrix product on the device: the yardstick of what it attains.
pub struct Product {
    a: Tensor<2>,
    b: Tensor<2>,
}

impl Product {
    /// Puts two matrices of drawn values on the device in use.
    #[must_use]
    pub fn new(side: usize, precision: Precision) -> Self {
        let draws = Draws::from_seed(1, "yardstick");
        let graph = Graph::empty(Mode::Infer, precision);
        #[expect(clippy::cast_possible_truncation, reason = "values are single precision")]
        let row: Vec<f32> = (0..side as u64).map(|index| draws.normal(index) as f32).collect();
        let matrix = || graph.lower(graph.tensor::<2>(&Array::new(&[side, side], row.repeat(side))));
        Self { a: matrix(), b: matrix() }
    }

    /// Multiplies once; returns one value of the product, so that nothing is left undone.
    #[must_use]
    pub fn run(&self) -> f32 {
        self.a.clone().matmul(self.b.clone()).slice([0..1, 0..1]).cast(FloatDType::F32).into_scalar::<f32>()
    }

    /// Returns the operations of a product.
    #[must_use]
    pub fn operations(&self) -> f64 {
        2.0 * (self.a.dims()[0] as f64).powi(3)
    }
}
