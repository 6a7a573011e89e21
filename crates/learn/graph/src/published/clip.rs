//! The image half of CLIP (ViT-H/14), whose next to last states Wan's image models attend to.
//!
//! Frames of 0 to 1 are resized to 224×224 by bicubic interpolation without cropping, as the published pipelines do,
//! and brought to CLIP's mean and deviation. The last block is not run.

use burn::tensor::{FloatDType, Tensor, activation, module};
use ds_nn::array::{Array, Declared, Initial};
use ds_nn::checkpoint::{CheckpointError, Finite, Fitted};

use crate::attention::inferred;
use crate::device::Precision;
use crate::graph::{Graph, Linear, Mode, array_of};

const EPSILON: f64 = 1e-5;
const MEAN: [f32; 3] = [0.481_454_66, 0.457_827_5, 0.408_210_73];
const DEVIATION: [f32; 3] = [0.268_629_54, 0.261_302_6, 0.275_777_1];
/// The parameter of the cubic kernel.
const SHARPNESS: f64 = -0.75;

/// Sizes of the image encoder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ClipShape {
    /// Side of the image in pixels.
    pub image: usize,
    /// Side of a patch in pixels.
    pub patch: usize,
    /// Width.
    pub dim: usize,
    /// Heads.
    pub heads: usize,
    /// Width of the feed-forward.
    pub ffn: usize,
    /// Blocks, the last included, which is not run.
    pub layers: usize,
}

impl ClipShape {
    /// ViT-H/14, the image encoder of Wan.
    pub const H14: Self = Self { image: 224, patch: 14, dim: 1280, heads: 16, ffn: 5120, layers: 32 };

    fn side(&self) -> usize {
        self.image / self.patch
    }

    /// Returns the number of states: one per patch and one for the class.
    #[must_use]
    pub fn tokens(&self) -> usize {
        self.side() * self.side() + 1
    }

    /// Lists the weights.
    #[must_use]
    pub fn declare(&self) -> Vec<Declared> {
        let d = self.dim;
        let patch = 3 * self.patch * self.patch;
        let small = Initial::Normal(1.0 / (d as f32).sqrt());
        let name = |part: &str| format!("visual.{part}");
        let mut list = vec![
            Declared::new(name("cls_embedding"), &[1, 1, d], small),
            Declared::new(name("pos_embedding"), &[1, self.tokens(), d], small),
            Declared::new(
                name("patch_embedding.weight"),
                &[d, 3, self.patch, self.patch],
                Initial::Normal(1.0 / (patch as f32).sqrt()),
            ),
        ];
        let norm = |list: &mut Vec<Declared>, name: String| {
            list.push(Declared::new(format!("{name}.weight"), &[d], Initial::Constant(1.0)));
            list.push(Declared::new(format!("{name}.bias"), &[d], Initial::Constant(0.0)));
        };
        norm(&mut list, name("pre_norm"));
        norm(&mut list, name("post_norm"));
        for layer in 0..self.layers {
            let name = |part: &str| format!("visual.transformer.{layer}.{part}");
            norm(&mut list, name("norm1"));
            norm(&mut list, name("norm2"));
            Declared::linear(&mut list, &name("attn.to_qkv"), d, 3 * d, 1.0);
            Declared::linear(&mut list, &name("attn.proj"), d, d, 1.0);
            Declared::linear(&mut list, &name("mlp.0"), d, self.ffn, 1.0);
            Declared::linear(&mut list, &name("mlp.2"), self.ffn, d, 1.0);
        }
        list
    }
}

type Norm = [Tensor<1>; 2];

struct Block {
    norms: [Norm; 2],
    qkv: Linear,
    proj: Linear,
    mlp: [Linear; 2],
}

/// The image encoder bound to the device.
pub struct Clip {
    shape: ClipShape,
    graph: Graph,
    patch: Linear,
    class: Tensor<3>,
    positions: Tensor<3>,
    pre_norm: Norm,
    blocks: Vec<Block>,
}

impl Clip {
    /// Binds a checkpoint that was fitted to [`ClipShape::declare`].
    ///
    /// # Errors
    /// If a value is not finite and that is checked.
    pub fn load(
        shape: &ClipShape,
        fitted: &Fitted<'_>,
        finite: Finite,
        precision: Precision,
    ) -> Result<Self, CheckpointError> {
        let d = shape.dim;
        let mut graph = Graph::empty(Mode::Infer, precision);
        fitted.each(finite, |name, array| {
            let lowered = name.starts_with("visual.transformer.") && array.shape().len() > 1;
            graph.bind(name, &array, if lowered { precision } else { Precision::F32 });
        })?;
        let norm = |name: &str| ["weight", "bias"].map(|part| graph.weight::<1>(&format!("{name}.{part}"), [d]));
        let block = |layer: usize| {
            let name = |part: &str| format!("visual.transformer.{layer}.{part}");
            Block {
                norms: [norm(&name("norm1")), norm(&name("norm2"))],
                qkv: graph.linear(&name("attn.to_qkv")),
                proj: graph.linear(&name("attn.proj")),
                mlp: [graph.linear(&name("mlp.0")), graph.linear(&name("mlp.2"))],
            }
        };
        let blocks = (0..shape.layers.saturating_sub(1)).map(block).collect();
        let (patch, pre_norm) = (graph.linear("visual.patch_embedding"), norm("visual.pre_norm"));
        let class = graph.weight("visual.cls_embedding", [1, 1, d]);
        let positions = graph.weight("visual.pos_embedding", [1, shape.tokens(), d]);
        graph.forget();
        Ok(Self { shape: *shape, patch, class, positions, pre_norm, blocks, graph })
    }

    /// Returns the states [1, tokens, dim] of an image [rows, columns, 3] of 0 to 1, class first.
    #[must_use]
    pub fn states(&self, image: &Array) -> Array {
        let (s, p, d) = (self.shape.side(), self.shape.patch, self.shape.dim);
        let mut image = resized(image, self.shape.image);
        for pixel in image.values_mut().chunks_exact_mut(3) {
            for (channel, value) in pixel.iter_mut().enumerate() {
                *value = (*value - MEAN[channel]) / DEVIATION[channel];
            }
        }
        let x: Tensor<5> = self.graph.tensor::<3>(&image).reshape([s, p, s, p, 3]);
        let x = x.permute([0, 2, 4, 1, 3]).reshape([1, s * s, 3 * p * p]);
        let x = Tensor::cat(vec![self.class.clone(), self.patch.apply(x)], 1) + self.positions.clone();
        let mut x = norm(x, &self.pre_norm);
        let n = s * s + 1;
        for block in &self.blocks {
            let y = block.qkv.apply(norm(x.clone(), &block.norms[0]));
            let part = |index: usize| {
                let y = y.clone().slice([0..1, 0..n, index * d..(index + 1) * d]);
                self.graph.lower(y.reshape([1, n, self.shape.heads, d / self.shape.heads]).swap_dims(1, 2))
            };
            let y = inferred([part(0), part(1), part(2)]).cast(FloatDType::F32);
            x = x + block.proj.apply(y.swap_dims(1, 2).reshape([1, n, d]));
            let y = activation::gelu(block.mlp[0].apply(norm(x.clone(), &block.norms[1])));
            x = x + block.mlp[1].apply(y);
        }
        array_of(x)
    }
}

fn norm(x: Tensor<3>, norm: &Norm) -> Tensor<3> {
    let [weight, bias] = norm.clone();
    module::layer_norm(x, weight, Some(bias), EPSILON)
}

/// Weights of the four pixels around a place between the second and the third.
fn cubic(place: f64) -> [f64; 4] {
    let a = SHARPNESS;
    let near = |x: f64| ((a + 2.0) * x - (a + 3.0)) * x * x + 1.0;
    let far = |x: f64| ((a * x - 5.0 * a) * x + 8.0 * a) * x - 4.0 * a;
    [far(place + 1.0), near(place), near(1.0 - place), far(2.0 - place)]
}

/// Resizes an image [rows, columns, 3] to a square by bicubic interpolation; pixels beyond the border repeat it.
#[must_use]
pub fn resized(image: &Array, side: usize) -> Array {
    let [rows, columns, channels]: [usize; 3] = image.shape().try_into().expect("an image has three axes");
    #[expect(clippy::cast_possible_truncation, reason = "places lie within the image")]
    let taps = |length: usize| -> Vec<[(usize, f64); 4]> {
        let tap = |index: usize| {
            let place = (index as f64 + 0.5) * length as f64 / side as f64 - 0.5;
            let first = place.floor();
            let at = |offset: isize| (first as isize + offset).clamp(0, length.cast_signed() - 1).cast_unsigned();
            let weights = cubic(place - first);
            [(at(-1), weights[0]), (at(0), weights[1]), (at(1), weights[2]), (at(2), weights[3])]
        };
        (0..side).map(tap).collect()
    };
    let (down, across) = (taps(rows), taps(columns));
    let mut values = Vec::with_capacity(side * side * channels);
    for row in &down {
        for column in &across {
            for channel in 0..channels {
                let pixel = |y: usize, x: usize| f64::from(image.values()[(y * columns + x) * channels + channel]);
                let line = |y: usize| column.iter().map(|(x, weight)| weight * pixel(y, *x)).sum::<f64>();
                #[expect(clippy::cast_possible_truncation, reason = "pixels are single precision")]
                values.push(row.iter().map(|(y, weight)| weight * line(*y)).sum::<f64>() as f32);
            }
        }
    }
    Array::new(&[side, side, channels], values)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_published_tensors_are_asked_for() {
        let parameters: usize =
            ClipShape::H14.declare().iter().map(|weight| weight.shape.iter().product::<usize>()).sum();
        // The published 632.08 million also count the projection [1280, 1024] that nothing here needs.
        assert_eq!(parameters + 1280 * 1024, 632_076_800);
        assert_eq!(ClipShape::H14.tokens(), ds_nn::dit::CLIP_STATES);
    }

    #[test]
    fn resizing_keeps_what_is_even_and_the_size_that_fits() {
        let even = Array::new(&[5, 7, 3], vec![0.25; 105]);
        assert!(resized(&even, 16).values().iter().all(|value| (value - 0.25).abs() < 1e-6));
        let image = Array::new(&[4, 4, 3], (0..48).map(|i| i as f32 / 48.0).collect());
        assert_eq!(resized(&image, 4), image);
    }
}
