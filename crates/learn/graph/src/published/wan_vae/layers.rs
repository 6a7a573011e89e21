//! The layers of Wan's autoencoders over [1, channels, frames, rows, columns], each with its memory of past frames.
//!
//! A causal convolution over three frames remembers its last two inputs. The temporal upsampler does nothing at the
//! very first latent of a rollout and has zeros as history at the second; the temporal downsampler passes the first
//! frame through and afterwards sees one frame of the past.

use burn::tensor::ops::{AttentionModuleOptions, ConvOptions};
use burn::tensor::{FloatDType, Tensor, activation, module};

use super::shape::{Part, Shortcut};
use crate::graph::{Graph, Linear};

/// What a layer remembers.
#[derive(Clone, Default)]
#[expect(clippy::large_enum_variant, reason = "a network has a few dozen layers")]
pub(super) enum Slot {
    /// Nothing yet.
    #[default]
    Empty,
    /// That the first latent has passed.
    First,
    /// Its last inputs.
    Frames(Tensor<5>),
}

/// The memories of all layers during one pass.
pub(super) struct Walk<'a> {
    pub(super) slots: &'a mut Vec<Slot>,
    pub(super) at: usize,
    /// Whether this is the first piece of the rollout.
    pub(super) first: bool,
}

impl Walk<'_> {
    fn slot(&mut self) -> &mut Slot {
        if self.slots.len() <= self.at {
            self.slots.resize(self.at + 1, Slot::Empty);
        }
        self.at += 1;
        &mut self.slots[self.at - 1]
    }
}

#[expect(clippy::large_enum_variant, reason = "a network has a few dozen layers")]
pub(super) enum Layer {
    Convolution(Convolution),
    Norm(Tensor<1>),
    Residual { norms: [Tensor<1>; 2], convolutions: [Convolution; 2], shortcut: Option<Convolution> },
    Attention { norm: Tensor<1>, qkv: Linear, proj: Linear },
    Down { space: Plane, time: Option<Convolution> },
    Up { space: Plane, time: Option<Convolution> },
    Average(Vec<Self>, Shortcut),
    Repeat(Vec<Self>, Shortcut),
}

impl Layer {
    pub(super) fn new(graph: &Graph, part: &Part) -> Self {
        let gamma = |name: String, width: usize| graph.weight::<1>(&format!("{name}.gamma"), [width]);
        let all = |parts: &[Part]| parts.iter().map(|part| Self::new(graph, part)).collect();
        match part {
            Part::Convolution { name, inputs, outputs, side } => {
                Self::Convolution(Convolution::new(graph, name, [*outputs, *inputs, *side, *side, *side]))
            }
            Part::Norm { name, width } => Self::Norm(gamma(name.clone(), *width)),
            Part::Residual { name, inputs, outputs } => {
                let layer = |index: usize, inputs: usize| {
                    Convolution::new(graph, &format!("{name}.residual.{index}"), [*outputs, inputs, 3, 3, 3])
                };
                let shortcut = || Convolution::new(graph, &format!("{name}.shortcut"), [*outputs, *inputs, 1, 1, 1]);
                Self::Residual {
                    norms: [
                        gamma(format!("{name}.residual.0"), *inputs),
                        gamma(format!("{name}.residual.3"), *outputs),
                    ],
                    convolutions: [layer(2, *inputs), layer(6, *outputs)],
                    shortcut: (inputs != outputs).then(shortcut),
                }
            }
            Part::Attention { name, width } => Self::Attention {
                norm: gamma(format!("{name}.norm"), *width),
                qkv: graph.linear(&format!("{name}.to_qkv")),
                proj: graph.linear(&format!("{name}.proj")),
            },
            Part::Down { name, width, time } => Self::Down {
                space: Plane::new(graph, &format!("{name}.resample.1"), *width, *width),
                time: time.then(|| Convolution::new(graph, &format!("{name}.time_conv"), [*width, *width, 3, 1, 1])),
            },
            Part::Up { name, width, outputs, time } => Self::Up {
                space: Plane::new(graph, &format!("{name}.resample.1"), *width, *outputs),
                time: time.then(|| Convolution::new(graph, &format!("{name}.time_conv"), [2 * width, *width, 3, 1, 1])),
            },
            Part::Average { inner, shortcut } => Self::Average(all(inner), *shortcut),
            Part::Repeat { inner, shortcut } => Self::Repeat(all(inner), *shortcut),
        }
    }

    pub(super) fn apply(&self, x: Tensor<5>, walk: &mut Walk<'_>) -> Tensor<5> {
        match self {
            Self::Convolution(convolution) => convolution.causal(x, walk),
            Self::Norm(gamma) => activation::silu(norm(x, gamma)),
            Self::Residual { norms, convolutions, shortcut } => {
                let past = match shortcut {
                    Some(shortcut) => shortcut.plain(x.clone(), 1),
                    None => x.clone(),
                };
                let mut y = x;
                for (gamma, convolution) in norms.iter().zip(convolutions) {
                    y = convolution.causal(activation::silu(norm(y, gamma)), walk);
                }
                past + y
            }
            Self::Attention { norm: gamma, qkv, proj } => attend(x, gamma, qkv, proj),
            Self::Down { space, time } => {
                let y = space.halved(x);
                match time {
                    Some(time) => halved_in_time(y, time, walk),
                    None => y,
                }
            }
            Self::Up { space, time } => {
                let y = match time {
                    Some(time) => doubled_in_time(x, time, walk),
                    None => x,
                };
                space.doubled(y)
            }
            Self::Average(inner, shortcut) => shortcut.averaged(x.clone()) + run(inner, x, walk),
            Self::Repeat(inner, shortcut) => {
                let past = shortcut.repeated(x.clone(), walk.first);
                past + run(inner, x, walk)
            }
        }
    }
}

/// Runs layers one after another.
pub(super) fn run(layers: &[Layer], x: Tensor<5>, walk: &mut Walk<'_>) -> Tensor<5> {
    layers.iter().fold(x, |x, layer| layer.apply(x, walk))
}

fn frames(x: &Tensor<5>, range: std::ops::Range<usize>) -> Tensor<5> {
    let [b, c, _, h, w] = x.dims();
    x.clone().slice([0..b, 0..c, range, 0..h, 0..w])
}

fn blank(x: &Tensor<5>, count: usize) -> Tensor<5> {
    let [b, c, _, h, w] = x.dims();
    Tensor::zeros([b, c, count, h, w], &x.device())
}

/// Returns the last two frames of what a convolution has seen, fewer at the start of a rollout.
fn last_two(x: &Tensor<5>, past: Option<&Tensor<5>>) -> Tensor<5> {
    let t = x.dims()[2];
    match past {
        _ if t >= 2 => frames(x, t - 2..t),
        Some(past) => {
            let count = past.dims()[2];
            Tensor::cat(vec![frames(past, count - 1..count), x.clone()], 2)
        }
        None => x.clone(),
    }
}

/// x / ‖x‖ over channels, times the root of their number and gamma.
fn norm(x: Tensor<5>, gamma: &Tensor<1>) -> Tensor<5> {
    let channels = gamma.dims()[0];
    let x = x.cast(FloatDType::F32);
    let length = x.clone().powi_scalar(2).sum_dim(1).sqrt().clamp_min(1e-12);
    x / length * (channels as f64).sqrt() * gamma.clone().reshape([1, channels, 1, 1, 1])
}

/// A convolution over frames, rows and columns.
pub(super) struct Convolution {
    weight: Tensor<5>,
    bias: Tensor<1>,
}

impl Convolution {
    fn new(graph: &Graph, name: &str, shape: [usize; 5]) -> Self {
        let weight = graph.weight::<5>(&format!("{name}.weight"), shape);
        let bias = graph.weight::<1>(&format!("{name}.bias"), [shape[0]]).cast(weight.dtype());
        Self { weight, bias }
    }

    /// Convolves without padding in time.
    fn plain(&self, x: Tensor<5>, stride: usize) -> Tensor<5> {
        let [_, _, _, h, w] = self.weight.dims();
        let options = ConvOptions::new([stride, 1, 1], [0, h / 2, w / 2], [1, 1, 1], 1);
        let x = x.cast(self.weight.dtype());
        module::conv3d(x, self.weight.clone(), Some(self.bias.clone()), options).cast(FloatDType::F32)
    }

    /// Convolves with the remembered frames in front; zeros stand for what lies before the rollout.
    fn causal(&self, x: Tensor<5>, walk: &mut Walk<'_>) -> Tensor<5> {
        if self.weight.dims()[2] == 1 {
            return self.plain(x, 1);
        }
        let slot = walk.slot();
        let past = match std::mem::take(slot) {
            Slot::Frames(past) => Some(past),
            Slot::Empty | Slot::First => None,
        };
        *slot = Slot::Frames(last_two(&x, past.as_ref()));
        self.after(x, past)
    }

    fn after(&self, x: Tensor<5>, past: Option<Tensor<5>>) -> Tensor<5> {
        let known = past.as_ref().map_or(0, |past| past.dims()[2]);
        let mut parts = Vec::new();
        if known < 2 {
            parts.push(blank(&x, 2 - known));
        }
        parts.extend(past);
        parts.push(x);
        self.plain(Tensor::cat(parts, 2), 1)
    }
}

fn halved_in_time(x: Tensor<5>, time: &Convolution, walk: &mut Walk<'_>) -> Tensor<5> {
    let t = x.dims()[2];
    let slot = walk.slot();
    match std::mem::replace(slot, Slot::Frames(frames(&x, t - 1..t))) {
        Slot::Frames(past) => time.plain(Tensor::cat(vec![past, x], 2), 2),
        Slot::Empty | Slot::First => x,
    }
}

fn doubled_in_time(x: Tensor<5>, time: &Convolution, walk: &mut Walk<'_>) -> Tensor<5> {
    let slot = walk.slot();
    let past = match std::mem::take(slot) {
        Slot::Empty => {
            *slot = Slot::First;
            return x;
        }
        Slot::First => blank(&x, 2),
        Slot::Frames(past) => past,
    };
    *slot = Slot::Frames(last_two(&x, Some(&past)));
    let [b, c, t, h, w] = x.dims();
    let y: Tensor<6> = time.after(x, Some(past)).reshape([b, 2, c, t, h, w]);
    y.permute([0, 2, 3, 1, 4, 5]).reshape([b, c, 2 * t, h, w])
}

/// A 3×3 convolution of single frames that changes their size.
pub(super) struct Plane {
    weight: Tensor<4>,
    bias: Tensor<1>,
}

impl Plane {
    fn new(graph: &Graph, name: &str, inputs: usize, outputs: usize) -> Self {
        let weight = graph.weight::<4>(&format!("{name}.weight"), [outputs, inputs, 3, 3]);
        let bias = graph.weight::<1>(&format!("{name}.bias"), [outputs]).cast(weight.dtype());
        Self { weight, bias }
    }

    fn apply(&self, x: Tensor<4>, stride: usize, padding: usize) -> Tensor<4> {
        let options = ConvOptions::new([stride; 2], [padding; 2], [1; 2], 1);
        let x = x.cast(self.weight.dtype());
        module::conv2d(x, self.weight.clone(), Some(self.bias.clone()), options).cast(FloatDType::F32)
    }

    /// Pads by one at the right and below, then takes every second pixel.
    fn halved(&self, x: Tensor<5>) -> Tensor<5> {
        per_frame(x, |x| {
            let [n, c, h, w] = x.dims();
            let right = Tensor::zeros([n, c, h, 1], &x.device());
            let below = Tensor::zeros([n, c, 1, w + 1], &x.device());
            let x = Tensor::cat(vec![Tensor::cat(vec![x, right], 3), below], 2);
            self.apply(x, 2, 0)
        })
    }

    /// Repeats each pixel 2×2.
    fn doubled(&self, x: Tensor<5>) -> Tensor<5> {
        per_frame(x, |x| {
            let [n, c, h, w] = x.dims();
            let x: Tensor<6> = x.reshape([n, c, h, 1, w, 1]).expand([n, c, h, 2, w, 2]);
            self.apply(x.reshape([n, c, 2 * h, 2 * w]), 1, 1)
        })
    }
}

/// Applies what works on images [N, C, H, W] to every frame.
fn per_frame(x: Tensor<5>, f: impl Fn(Tensor<4>) -> Tensor<4>) -> Tensor<5> {
    let [b, c, t, h, w] = x.dims();
    let y = f(x.swap_dims(1, 2).reshape([b * t, c, h, w]));
    let [_, c, h, w] = y.dims();
    y.reshape([b, t, c, h, w]).swap_dims(1, 2)
}

/// Single-head attention among the pixels of each frame.
fn attend(x: Tensor<5>, gamma: &Tensor<1>, qkv: &Linear, proj: &Linear) -> Tensor<5> {
    let [b, c, t, h, w] = x.dims();
    let y = norm(x.clone(), gamma).permute([0, 2, 3, 4, 1]).reshape([b * t, h * w, c]);
    let y = qkv.apply(y);
    let part = |index: usize| -> Tensor<4> {
        y.clone().slice([0..b * t, 0..h * w, index * c..(index + 1) * c]).reshape([b * t, 1, h * w, c])
    };
    let y = module::attention(part(0), part(1), part(2), None, None, AttentionModuleOptions::default());
    let y = proj.apply(y.reshape([b * t, h * w, c])).reshape([b, t, h, w, c]);
    x + y.permute([0, 4, 1, 2, 3])
}

impl Shortcut {
    /// Averages groups of what falls together when time and space shrink; zeros stand before the first frame.
    fn averaged(&self, x: Tensor<5>) -> Tensor<5> {
        let (f, s) = (self.time, self.space);
        let missing = (f - x.dims()[2] % f) % f;
        let x = if missing > 0 { Tensor::cat(vec![blank(&x, missing), x], 2) } else { x };
        let [b, c, t, h, w] = x.dims();
        let x: Tensor<8> = x.reshape([b, c, t / f, f, h / s, s, w / s, s]);
        let x = x.permute([0, 1, 3, 5, 7, 2, 4, 6]);
        let group = c * f * s * s / self.outputs;
        let x: Tensor<6> = x.reshape([b, self.outputs, group, t / f, h / s, w / s]);
        x.mean_dim(2).reshape([b, self.outputs, t / f, h / s, w / s])
    }

    /// Repeats channels to fill the frames and pixels that a stage adds; the first piece has but its last frame.
    fn repeated(&self, x: Tensor<5>, first: bool) -> Tensor<5> {
        let (f, s) = (self.time, self.space);
        let [b, c, t, h, w] = x.dims();
        debug_assert_eq!(c, self.inputs);
        let repeats = self.outputs * f * s * s / c;
        let x: Tensor<6> = x.reshape([b, c, 1, t, h, w]).repeat_dim(2, repeats);
        let x: Tensor<8> = x.reshape([b, self.outputs, f, s, s, t, h, w]);
        let x = x.permute([0, 1, 5, 2, 6, 3, 7, 4]).reshape([b, self.outputs, t * f, h * s, w * s]);
        if first { frames(&x, f - 1..t * f) } else { x }
    }
}
