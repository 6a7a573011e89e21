//! The autoencoder of a model with what stands around it: pictures to normalised latents and back, layouts to control
//! latents.
//!
//! An own autoencoder folds layouts into control inputs; one of Wan takes them as a video, and its tiny companion may
//! decode in its place. Latents are [frames, h, w, z], channels last.

use ds_graph::published::tae::{self, Tae, TaeMemory};
use ds_graph::published::wan_vae::{WanMemory, WanVae};
use ds_nn::Array;
use ds_nn::body::{Autoencoder, Control, Transformer};
use ds_nn::tiny_ae::Memory;
use ds_raster::RgbImage;
use ds_space::{Digest, DigestWriter};

use crate::config::ModelConfig;
use crate::tokens;

/// An autoencoder and the statistics of its latents, per channel.
pub(crate) struct Codec {
    coder: Coder,
    mean: Vec<f32>,
    std: Vec<f32>,
}

enum Coder {
    Own(Box<dyn Autoencoder>),
    Wan { vae: Box<WanVae>, tiny: Option<Tae> },
}

/// What a decoder remembers of a rollout; empty at its start. A clone shares all tensors.
#[derive(Clone, Default)]
pub(crate) struct DecoderMemory {
    own: Memory,
    wan: WanMemory,
    tiny: TaeMemory,
    begun: bool,
    /// Over the last frame of every call of a published decoder: its tensors stay on the device.
    seen: Digest,
}

/// What the encoder remembers of a rollout's layouts; empty at its start. A clone shares all tensors.
#[derive(Clone, Default)]
pub(crate) struct LayoutMemory(WanMemory);

impl Codec {
    pub(crate) fn own(autoencoder: Box<dyn Autoencoder>, mean: Vec<f32>, std: Vec<f32>) -> Self {
        Self { coder: Coder::Own(autoencoder), mean, std }
    }

    /// Takes an autoencoder of Wan, whose statistics are published.
    pub(crate) fn wan(vae: WanVae, tiny: Option<Tae>) -> Self {
        let (mean, std) = vae.shape().statistics().expect("configurations have the latent channels of Wan");
        let (mean, std) = (mean.to_vec(), std.to_vec());
        Self { coder: Coder::Wan { vae: Box::new(vae), tiny }, mean, std }
    }

    /// Returns the own autoencoder, if it is one.
    pub(crate) fn autoencoder(&self) -> Option<&dyn Autoencoder> {
        match &self.coder {
            Coder::Own(autoencoder) => Some(&**autoencoder),
            Coder::Wan { .. } => None,
        }
    }

    pub(crate) fn normalised(&self, latents: Array) -> Array {
        self.each(latents, |value, mean, std| (value - mean) / std)
    }

    pub(crate) fn denormalised(&self, latents: Array) -> Array {
        self.each(latents, |value, mean, std| value * std + mean)
    }

    fn each(&self, mut latents: Array, change: impl Fn(f32, f32, f32) -> f32) -> Array {
        for pixel in latents.values_mut().chunks_exact_mut(self.mean.len()) {
            for (channel, value) in pixel.iter_mut().enumerate() {
                *value = change(*value, self.mean[channel], self.std[channel]);
            }
        }
        latents
    }

    /// Encodes the first frame of a rollout. Returns its normalised latent and a digest of what the encoder has come to.
    pub(crate) fn encode_first(&self, config: &ModelConfig, frame: &RgbImage) -> (Array, Digest) {
        match &self.coder {
            Coder::Own(autoencoder) => {
                let (h, w) = config.latent_size();
                let folded = tokens::fold(&vec![frame; config.vae.stride_t]);
                let mut memory = Memory::default();
                let latent = autoencoder.encode(&Array::new(&[1, h, w, config.ae().inputs()], folded), &mut memory);
                (self.normalised(latent), memory.digest())
            }
            Coder::Wan { vae, .. } => {
                let latent = self.normalised(vae.encode(&tokens::stacked(&[frame]), &mut WanMemory::default()));
                let digest = latent.digest();
                (latent, digest)
            }
        }
    }

    /// Computes the control latent of the layouts of whole latent frames that follow those in `memory`; a single layout
    /// stands for the first frame. Layouts have the size of the video.
    pub(crate) fn control(
        &self,
        dit: &dyn Transformer,
        config: &ModelConfig,
        layouts: &[&RgbImage],
        memory: &mut LayoutMemory,
    ) -> Control {
        let ((h, w), n) = (config.latent_size(), config.dit().tokens());
        let steps = layouts.len().div_ceil(config.vae.stride_t);
        match &self.coder {
            Coder::Own(_) => {
                let steps: Vec<Vec<&RgbImage>> = match layouts {
                    [single] => vec![vec![*single; config.vae.stride_t]],
                    many => many.chunks(config.vae.stride_t).map(<[&RgbImage]>::to_vec).collect(),
                };
                let tokens = |step: &Vec<&RgbImage>| tokens::to_tokens(&tokens::fold(step), h, w);
                let values = steps.iter().flat_map(tokens).collect();
                dit.control(&Array::new(&[1, steps.len() * n, 4, config.ae().inputs()], values))
            }
            Coder::Wan { .. } if config.control.channels == 0 => dit.control_of(&Array::zeros(&[steps, n, 4, 0])),
            Coder::Wan { vae, .. } => {
                let latents = self.normalised(vae.encode(&tokens::stacked(layouts), &mut memory.0));
                dit.control_of(&tokens::latents_to_tokens(&latents))
            }
        }
    }

    /// Decodes normalised latents that follow those in `memory` to the frames of their ticks, [ticks, rows, columns, 3]
    /// of −1 to 1. An own decoder may be guided by the frames' layouts, in the same shape.
    pub(crate) fn decode(&self, latents: Array, guide: Option<&Array>, memory: &mut DecoderMemory) -> Array {
        let steps = latents.shape()[0];
        // All but Wan's decoder give a whole step for the first frame too.
        let (frames, lead) = match &self.coder {
            Coder::Own(autoencoder) => {
                let frames = autoencoder.decode(&self.denormalised(latents), guide, &mut memory.own);
                let lead = frames.shape()[0] / steps - 1;
                (frames, lead)
            }
            Coder::Wan { tiny: Some(tiny), .. } => {
                let mut frames = tiny.decode(&latents, &mut memory.tiny);
                frames.values_mut().iter_mut().for_each(|value| *value = *value * 2.0 - 1.0);
                (frames, tae::LEAD)
            }
            Coder::Wan { vae, tiny: None } => (vae.decode(&self.denormalised(latents), &mut memory.wan), 0),
        };
        let frames = if memory.begun || lead == 0 { frames } else { without(&frames, lead) };
        memory.begun = true;
        if let Coder::Wan { .. } = self.coder {
            let mut writer = DigestWriter::new();
            writer.digest(&memory.seen);
            without(&frames, frames.shape()[0] - 1).digest_into(&mut writer);
            memory.seen = writer.finish();
        }
        frames
    }

    /// Returns the digest of what a decoder has come to.
    pub(crate) fn decoder_digest(&self, memory: &DecoderMemory) -> Digest {
        match self.coder {
            Coder::Own(_) => memory.own.digest(),
            Coder::Wan { .. } => memory.seen,
        }
    }
}

/// Returns the frames after the first few.
fn without(frames: &Array, lead: usize) -> Array {
    let mut shape = frames.shape().to_vec();
    let frame: usize = shape[1..].iter().product();
    shape[0] -= lead;
    Array::new(&shape, frames.values()[lead * frame..].to_vec())
}
