//! Linear layers over rows and their backward pass: dx = dy·W, dW += dyᵀ·x, db += Σ dy.

use std::ops::Range;

use ds_nn::array::Weights;

use super::matrix::{View, multiply};
use super::rows;
use crate::arch::Arch;

/// A linear layer: its name, weight [outputs, inputs] and bias.
#[derive(Clone)]
pub(super) struct Linear<'a> {
    pub(super) name: String,
    pub(super) weight: &'a [f32],
    pub(super) bias: &'a [f32],
}

/// Returns the values of a weight that was checked against the declarations.
pub(super) fn values<'a>(weights: &'a Weights, name: &str) -> &'a [f32] {
    weights.get(name).expect("the weights were checked against the declarations").values()
}

/// Returns the gradient of a weight for adding to it.
pub(super) fn sums<'a>(gradient: &'a mut Weights, name: &str) -> &'a mut [f32] {
    gradient.get_mut(name).expect("gradients have the names of the weights").values_mut()
}

impl<'a> Linear<'a> {
    pub(super) fn new(weights: &'a Weights, name: impl Into<String>) -> Self {
        let name = name.into();
        let (weight, bias) = (values(weights, &format!("{name}.weight")), values(weights, &format!("{name}.bias")));
        Self { name, weight, bias }
    }

    pub(super) fn inputs(&self) -> usize {
        self.weight.len() / self.bias.len()
    }

    pub(super) fn outputs(&self) -> usize {
        self.bias.len()
    }

    /// y = x·Wᵀ + b.
    pub(super) fn forward(&self, x: &[f32], y: &mut [f32]) {
        y.chunks_exact_mut(self.outputs()).for_each(|row| row.copy_from_slice(self.bias));
        let weight = View::all(self.weight, self.inputs());
        multiply(y, self.outputs(), true, View::all(x, self.inputs()), weight.turned());
    }

    /// dx = dy·W, or dx += dy·W.
    pub(super) fn back(&self, dy: &[f32], dx: &mut [f32], keep: bool) {
        multiply(dx, self.inputs(), keep, View::all(dy, self.outputs()), View::all(self.weight, self.inputs()));
    }

    /// dx += dy·W for some inputs alone; rows of dx lie `stride` apart.
    pub(super) fn back_part(&self, dy: &[f32], inputs: Range<usize>, dx: &mut [f32], stride: usize) {
        let weight = View::new(&self.weight[inputs.start..], self.outputs(), inputs.len(), self.inputs());
        multiply(dx, stride, true, View::all(dy, self.outputs()), weight);
    }

    /// Adds the gradients of weight and bias.
    pub(super) fn learn(&self, arch: Arch, dy: &[f32], x: &[f32], gradient: &mut Weights) {
        let weight = sums(gradient, &format!("{}.weight", self.name));
        self.learn_weight(dy, x, weight);
        rows::column_sums(arch, dy, sums(gradient, &format!("{}.bias", self.name)));
    }

    /// Adds the gradient of the weight.
    pub(super) fn learn_weight(&self, dy: &[f32], x: &[f32], sums: &mut [f32]) {
        let dy = View::all(dy, self.outputs());
        multiply(sums, self.inputs(), true, dy.turned(), View::all(x, self.inputs()));
    }
}
