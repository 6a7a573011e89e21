//! The 3×3 convolution and its backward pass over images with a border of zeros.
//!
//! The gradient of an input is a convolution with the kernel turned around. The gradient of the weight is, for each row
//! of the kernel, one product over all pixels of a frame at once: the zeros of the border keep rows apart.

use ds_nn::array::Weights;

use super::linear::{sums, values};
use super::matrix::{View, multiply};
use super::rows;
use crate::arch::Arch;
use crate::convolution::{Convolution, IMAGES};
use crate::image::Image;
use crate::product::Finish;

/// A convolution over images that stand for concatenated channels.
pub(super) struct Layer {
    name: String,
    inputs: Vec<usize>,
    forward: Convolution,
    /// From the gradient of the output to that of each of the first inputs.
    back: Vec<Convolution>,
}

impl Layer {
    /// Packs the weight [outputs, 3, 3, inputs]; the first `learned` inputs take gradients.
    pub(super) fn new(weights: &Weights, name: impl Into<String>, inputs: &[usize], learned: usize) -> Self {
        let name = name.into();
        let (weight, bias) = (values(weights, &format!("{name}.weight")), values(weights, &format!("{name}.bias")));
        let (total, outputs) = (inputs.iter().sum::<usize>(), bias.len());
        let turned = |input: usize| {
            let (before, count) = (inputs[..input].iter().sum::<usize>(), inputs[input]);
            let mut turned = Vec::with_capacity(count * 9 * outputs);
            for channel in before..before + count {
                for tap in (0..9).rev() {
                    turned.extend((0..outputs).map(|output| weight[(output * 9 + tap) * total + channel]));
                }
            }
            Convolution::new(&turned, &vec![0.0; count], &[outputs])
        };
        Self {
            forward: Convolution::new(weight, bias, inputs),
            back: (0..learned).map(turned).collect(),
            inputs: inputs.to_vec(),
            name,
        }
    }

    /// Returns the output channels.
    pub(super) fn outputs(&self) -> usize {
        self.forward.outputs()
    }

    /// Computes all frames; `inputs` tells the images of a frame.
    pub(super) fn forward<'a>(
        &self,
        arch: Arch,
        inputs: impl Fn(usize) -> [&'a [f32]; IMAGES] + Sync,
        out: &mut Image,
        finish: impl Fn(usize, usize) -> Finish<'a> + Sync,
    ) {
        self.forward.apply(arch, inputs, out, finish);
    }

    /// Writes or adds the gradient of an input; `of` tells which frame's output a frame has influenced through it.
    pub(super) fn back<'a>(
        &self,
        arch: Arch,
        input: usize,
        of: impl Fn(usize) -> &'a [f32] + Sync,
        dx: &mut Image,
        keep: bool,
    ) {
        let finish = if keep { Finish::Add } else { Finish::Plain };
        self.back[input].apply(arch, |frame| [of(frame), &[]], dx, |_, _| finish);
    }

    /// Adds the gradients of weight and bias.
    pub(super) fn learn<'a>(
        &self,
        arch: Arch,
        dy: &Image,
        inputs: impl Fn(usize) -> [&'a [f32]; IMAGES],
        gradient: &mut Weights,
    ) {
        let (line, outputs) = (dy.w + 2, self.outputs());
        // From the first inside pixel to the last, borders between rows included.
        let (first, pixels) = (line + 1, dy.h * line - 2);
        let total: usize = self.inputs.iter().sum();
        let weight = sums(gradient, &format!("{}.weight", self.name));
        let mut before = 0;
        for (input, channels) in self.inputs.iter().copied().enumerate() {
            let mut part = vec![0.0; outputs * 3 * channels];
            for row in 0..3 {
                for frame in 0..dy.frames {
                    let errors = View::new(&dy.frame(frame)[first * outputs..], pixels, outputs, outputs);
                    let near = &inputs(frame)[input][row * line * channels..];
                    let near = View::new(near, pixels, 3 * channels, channels);
                    multiply(&mut part, 3 * channels, frame > 0, errors.turned(), near);
                }
                for (output, sums) in part.chunks_exact(3 * channels).enumerate() {
                    for (column, sums) in sums.chunks_exact(channels).enumerate() {
                        let at = (output * 9 + row * 3 + column) * total + before;
                        weight[at..at + channels].iter_mut().zip(sums).for_each(|(to, sum)| *to += sum);
                    }
                }
            }
            before += channels;
        }
        let bias = sums(gradient, &format!("{}.bias", self.name));
        (0..dy.frames).for_each(|frame| rows::column_sums(arch, dy.frame(frame), bias));
    }
}
