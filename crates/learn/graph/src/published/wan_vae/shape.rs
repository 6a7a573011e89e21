//! The layers of Wan's autoencoders in order, the weights that they ask for, and the statistics of their latents.
//!
//! Both versions have four stages of widths 1, 2, 4 and 4 times a base width; the first three of the encoder halve
//! space, the second and third also time. Version 2.2 folds 2×2 pixels into channels before and after, and each of
//! its stages has a shortcut without weights around it.

use ds_nn::array::{Declared, Initial};

use super::STEP;

/// Widths of the stages, in units of the base width.
const MULTIPLES: [usize; 4] = [1, 2, 4, 4];
/// Whether a stage of the encoder halves time; the decoder goes the other way round.
const HALVES_TIME: [bool; 3] = [false, true, true];
/// Residual blocks of a stage of the encoder; the decoder has one more.
const BLOCKS: usize = 2;

/// Sizes of an autoencoder of Wan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WanVaeShape {
    /// Latent channels.
    pub z: usize,
    /// Base width of the encoder.
    pub encoder_width: usize,
    /// Base width of the decoder.
    pub decoder_width: usize,
    /// Whether pixels are folded 2×2 and stages have shortcuts, as in version 2.2.
    pub folded: bool,
}

impl WanVaeShape {
    /// Wan2.1: stride 4×8×8, 16 channels.
    pub const WAN21: Self = Self { z: 16, encoder_width: 96, decoder_width: 96, folded: false };
    /// Wan2.2: stride 4×16×16, 48 channels.
    pub const WAN22: Self = Self { z: 48, encoder_width: 160, decoder_width: 256, folded: true };

    /// Returns the pixels of a latent pixel's side.
    #[must_use]
    pub fn stride(&self) -> usize {
        8 * self.fold()
    }

    /// Returns the side of the squares of pixels that are folded into channels.
    pub(super) fn fold(&self) -> usize {
        if self.folded { 2 } else { 1 }
    }

    fn channels(&self) -> usize {
        3 * self.fold() * self.fold()
    }

    /// Lists the weights of both halves.
    #[must_use]
    pub fn declare(&self) -> Vec<Declared> {
        let mut list = Vec::new();
        for part in self.encoder().into_iter().chain(self.decoder()) {
            part.declare(&mut list);
        }
        list
    }

    /// The encoder from folded pixels to means and log variances.
    pub(super) fn encoder(&self) -> Vec<Part> {
        let widths = MULTIPLES.map(|multiple| multiple * self.encoder_width);
        let mut parts = vec![Part::convolution("encoder.conv1", self.channels(), widths[0])];
        let (mut inputs, mut index) = (widths[0], 0);
        for (stage, outputs) in widths.into_iter().enumerate() {
            let mut name = |block: usize| {
                index += 1;
                if self.folded {
                    format!("encoder.downsamples.{stage}.downsamples.{block}")
                } else {
                    format!("encoder.downsamples.{}", index - 1)
                }
            };
            let mut inner = Vec::new();
            for block in 0..BLOCKS {
                let inputs = if block == 0 { inputs } else { outputs };
                inner.push(Part::Residual { name: name(block), inputs, outputs });
            }
            if stage < 3 {
                inner.push(Part::Down { name: name(BLOCKS), width: outputs, time: HALVES_TIME[stage] });
            }
            let time = stage < 3 && HALVES_TIME[stage];
            let shortcut = Shortcut { inputs, outputs, time: 1 + usize::from(time), space: 1 + usize::from(stage < 3) };
            self.add_stage(&mut parts, Part::Average { inner, shortcut });
            inputs = outputs;
        }
        parts.extend(middle("encoder", inputs));
        parts.push(Part::Norm { name: "encoder.head.0".to_owned(), width: inputs });
        parts.push(Part::convolution("encoder.head.2", inputs, 2 * self.z));
        parts.push(Part::Convolution { name: "conv1".to_owned(), inputs: 2 * self.z, outputs: 2 * self.z, side: 1 });
        parts
    }

    /// The decoder from latents to folded pixels.
    pub(super) fn decoder(&self) -> Vec<Part> {
        let widths = MULTIPLES.map(|multiple| multiple * self.decoder_width);
        let mut parts = vec![Part::Convolution { name: "conv2".to_owned(), inputs: self.z, outputs: self.z, side: 1 }];
        let mut inputs = widths[3];
        parts.push(Part::convolution("decoder.conv1", self.z, inputs));
        parts.extend(middle("decoder", inputs));
        let mut index = 0;
        for (stage, outputs) in widths.into_iter().rev().enumerate() {
            let mut name = |block: usize| {
                index += 1;
                if self.folded {
                    format!("decoder.upsamples.{stage}.upsamples.{block}")
                } else {
                    format!("decoder.upsamples.{}", index - 1)
                }
            };
            let mut inner = Vec::new();
            for block in 0..=BLOCKS {
                let inputs = if block == 0 { inputs } else { outputs };
                inner.push(Part::Residual { name: name(block), inputs, outputs });
            }
            let time = stage < 3 && HALVES_TIME[2 - stage];
            let mut leaves = outputs;
            if stage < 3 {
                // Without a shortcut the upsampler halves the width.
                leaves = if self.folded { outputs } else { outputs / 2 };
                inner.push(Part::Up { name: name(BLOCKS + 1), width: outputs, outputs: leaves, time });
            }
            if stage < 3 {
                let shortcut = Shortcut { inputs, outputs, time: 1 + usize::from(time), space: 2 };
                self.add_stage(&mut parts, Part::Repeat { inner, shortcut });
            } else {
                parts.extend(inner);
            }
            inputs = leaves;
        }
        parts.push(Part::Norm { name: "decoder.head.0".to_owned(), width: inputs });
        parts.push(Part::convolution("decoder.head.2", inputs, self.channels()));
        parts
    }

    /// Returns how many frames back the encoder's memory and newest latent may depend on.
    #[must_use]
    pub fn encoder_reach(&self) -> usize {
        let mut rate = 1;
        STEP + self.encoder().iter().map(|part| part.reach(&mut rate)).sum::<usize>()
    }

    /// Adds a stage, with its shortcut where the version has them.
    fn add_stage(&self, parts: &mut Vec<Part>, stage: Part) {
        match stage {
            Part::Average { inner, .. } | Part::Repeat { inner, .. } if !self.folded => parts.extend(inner),
            stage => parts.push(stage),
        }
    }

    /// Returns mean and deviation of each latent channel of the published weights, if these are their sizes.
    #[must_use]
    pub fn statistics(&self) -> Option<(&'static [f32], &'static [f32])> {
        match self.z {
            16 => Some((&MEAN_21, &DEVIATION_21)),
            48 => Some((&MEAN_22, &DEVIATION_22)),
            _ => None,
        }
    }
}

fn middle(half: &str, width: usize) -> [Part; 3] {
    [
        Part::Residual { name: format!("{half}.middle.0"), inputs: width, outputs: width },
        Part::Attention { name: format!("{half}.middle.1"), width },
        Part::Residual { name: format!("{half}.middle.2"), inputs: width, outputs: width },
    ]
}

/// How the shortcut around a stage changes width, time and space.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shortcut {
    pub(super) inputs: usize,
    pub(super) outputs: usize,
    pub(super) time: usize,
    pub(super) space: usize,
}

/// A layer of an autoencoder.
#[derive(Debug, Clone)]
pub(super) enum Part {
    /// A causal convolution of `side`³.
    Convolution { name: String, inputs: usize, outputs: usize, side: usize },
    /// Norm and SiLU before the last convolution.
    Norm { name: String, width: usize },
    /// Two convolutions with norms, around them a shortcut.
    Residual { name: String, inputs: usize, outputs: usize },
    /// Attention within a frame.
    Attention { name: String, width: usize },
    /// Halves space and, if told, time.
    Down { name: String, width: usize, time: bool },
    /// Doubles space and, if told, time.
    Up { name: String, width: usize, outputs: usize, time: bool },
    /// A stage of the encoder with averages around it.
    Average { inner: Vec<Self>, shortcut: Shortcut },
    /// A stage of the decoder with repeated values around it.
    Repeat { inner: Vec<Self>, shortcut: Shortcut },
}

impl Part {
    fn convolution(name: &str, inputs: usize, outputs: usize) -> Self {
        Self::Convolution { name: name.to_owned(), inputs, outputs, side: 3 }
    }

    fn declare(&self, list: &mut Vec<Declared>) {
        let mut weight = |name: String, shape: &[usize]| {
            let inputs: usize = shape[1..].iter().product();
            list.push(Declared::new(format!("{name}.weight"), shape, Initial::Normal(1.0 / (inputs as f32).sqrt())));
            list.push(Declared::new(format!("{name}.bias"), &shape[..1], Initial::Constant(0.0)));
        };
        match self {
            Self::Convolution { name, inputs, outputs, side } => {
                weight(name.clone(), &[*outputs, *inputs, *side, *side, *side]);
            }
            Self::Norm { name, width } => list.push(gamma(name, &[*width, 1, 1, 1])),
            Self::Residual { name, inputs, outputs } => {
                weight(format!("{name}.residual.2"), &[*outputs, *inputs, 3, 3, 3]);
                weight(format!("{name}.residual.6"), &[*outputs, *outputs, 3, 3, 3]);
                if inputs != outputs {
                    weight(format!("{name}.shortcut"), &[*outputs, *inputs, 1, 1, 1]);
                }
                list.push(gamma(&format!("{name}.residual.0"), &[*inputs, 1, 1, 1]));
                list.push(gamma(&format!("{name}.residual.3"), &[*outputs, 1, 1, 1]));
            }
            Self::Attention { name, width } => {
                weight(format!("{name}.to_qkv"), &[3 * width, *width, 1, 1]);
                weight(format!("{name}.proj"), &[*width, *width, 1, 1]);
                list.push(gamma(&format!("{name}.norm"), &[*width, 1, 1]));
            }
            Self::Down { name, width, time } => {
                weight(format!("{name}.resample.1"), &[*width, *width, 3, 3]);
                if *time {
                    weight(format!("{name}.time_conv"), &[*width, *width, 3, 1, 1]);
                }
            }
            Self::Up { name, width, outputs, time } => {
                weight(format!("{name}.resample.1"), &[*outputs, *width, 3, 3]);
                if *time {
                    weight(format!("{name}.time_conv"), &[2 * width, *width, 3, 1, 1]);
                }
            }
            Self::Average { inner, .. } | Self::Repeat { inner, .. } => {
                for part in inner {
                    part.declare(list);
                }
            }
        }
    }
}

impl Part {
    /// Returns the past frames that a layer of the encoder reads, and moves `rate`, the frames per step, on.
    fn reach(&self, rate: &mut usize) -> usize {
        match self {
            Self::Convolution { side, .. } => (side - 1) * *rate,
            Self::Residual { .. } => 4 * *rate,
            Self::Down { time: true, .. } => {
                *rate *= 2;
                *rate
            }
            Self::Average { inner, .. } => inner.iter().map(|part| part.reach(rate)).sum(),
            Self::Norm { .. } | Self::Attention { .. } | Self::Down { .. } | Self::Up { .. } | Self::Repeat { .. } => 0,
        }
    }
}

fn gamma(name: &str, shape: &[usize]) -> Declared {
    Declared::new(format!("{name}.gamma"), shape, Initial::Constant(1.0))
}

const MEAN_21: [f32; 16] = [
    -0.7571, -0.7089, -0.9113, 0.1075, -0.1745, 0.9653, -0.1517, 1.5508, 0.4134, -0.0715, 0.5517, -0.3632, -0.1922,
    -0.9497, 0.2503, -0.2921,
];
const DEVIATION_21: [f32; 16] = [
    2.8184, 1.4541, 2.3275, 2.6558, 1.2196, 1.7708, 2.6052, 2.0743, 3.2687, 2.1526, 2.8652, 1.5579, 1.6382, 1.1253,
    2.8251, 1.9160,
];
const MEAN_22: [f32; 48] = [
    -0.2289, -0.0052, -0.1323, -0.2339, -0.2799, 0.0174, 0.1838, 0.1557, -0.1382, 0.0542, 0.2813, 0.0891, 0.1570,
    -0.0098, 0.0375, -0.1825, -0.2246, -0.1207, -0.0698, 0.5109, 0.2665, -0.2108, -0.2158, 0.2502, -0.2055, -0.0322,
    0.1109, 0.1567, -0.0729, 0.0899, -0.2799, -0.1230, -0.0313, -0.1649, 0.0117, 0.0723, -0.2839, -0.2083, -0.0520,
    0.3748, 0.0152, 0.1957, 0.1433, -0.2944, 0.3573, -0.0548, -0.1681, -0.0667,
];
const DEVIATION_22: [f32; 48] = [
    0.4765, 1.0364, 0.4514, 1.1677, 0.5313, 0.4990, 0.4818, 0.5013, 0.8158, 1.0344, 0.5894, 1.0901, 0.6885, 0.6165,
    0.8454, 0.4978, 0.5759, 0.3523, 0.7135, 0.6804, 0.5833, 1.4146, 0.8986, 0.5659, 0.7069, 0.5338, 0.4889, 0.4917,
    0.4069, 0.4999, 0.6866, 0.4093, 0.5709, 0.6065, 0.6415, 0.4944, 0.5726, 1.2042, 0.5458, 1.6887, 0.3971, 1.0600,
    0.3943, 0.5537, 0.5444, 0.4089, 0.7468, 0.7744,
];
