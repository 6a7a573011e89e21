//! Sizes of the transformer and the weights that they ask for, by the names of the published checkpoints.
//!
//! One description covers the own models and Wan's: own models embed the layout by a linear map (`control_inputs`),
//! take the first frame as a context of latent tokens and use the exact GELU; Wan takes latents of its autoencoder as
//! control, CLIP states as image context and the tanh form.

use crate::array::{Declared, Initial};

/// States of CLIP's ViT-H/14: its patches and the class.
pub const CLIP_STATES: usize = 257;

/// The form of the GELU of feed-forward layers and prompt embedding; weights trained with one need that one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Gelu {
    /// By the error function.
    #[default]
    Exact,
    /// By the hyperbolic tangent, as Wan.
    Tanh,
}

/// Sizes of the transformer.
#[derive(Debug, Clone, PartialEq)]
pub struct DitShape {
    /// Blocks.
    pub layers: usize,
    /// Model width.
    pub dim: usize,
    /// Attention heads.
    pub heads: usize,
    /// Feed-forward width.
    pub ffn: usize,
    /// Latent channels.
    pub latent_channels: usize,
    /// Values per latent pixel of the space-to-depth layout; 0 where control latents are given as they are.
    pub control_inputs: usize,
    /// Channels of the control latent; 0 leaves it out.
    pub control_channels: usize,
    /// Channels of the start latent; 0 leaves it out.
    pub start_channels: usize,
    /// Width of the sinusoidal time embedding.
    pub freq_dim: usize,
    /// Width of a prompt token.
    pub text_dim: usize,
    /// Prompt tokens; 0 leaves the context out.
    pub text_len: usize,
    /// Whether the first frame's latent tokens join the context.
    pub image_context: bool,
    /// Width of the CLIP states that are attended to beside the prompt; 0 leaves them out.
    pub clip_dim: usize,
    /// Whether a reference frame's tokens may stand in front of the clip.
    pub reference: bool,
    /// The form of the GELU.
    pub gelu: Gelu,
    /// Whether the start latent stands in every frame, or in the first alone.
    pub start_every: bool,
    /// Every how many blocks cross-attention sits.
    pub cross_every: usize,
    /// Token rows of a frame.
    pub grid_h: usize,
    /// Token columns of a frame.
    pub grid_w: usize,
}

impl DitShape {
    /// Returns the tokens of a frame.
    #[must_use]
    pub fn tokens(&self) -> usize {
        self.grid_h * self.grid_w
    }

    /// Says whether this is one of the project's own networks: exact GELU, an embedded layout, no CLIP states.
    #[must_use]
    pub fn is_own(&self) -> bool {
        let embedded = self.control_inputs > 0 && self.start_channels == self.latent_channels;
        embedded && self.gelu == Gelu::Exact && self.clip_dim == 0 && !self.reference
    }

    /// Returns the input channels of a latent pixel.
    #[must_use]
    pub fn in_dim(&self) -> usize {
        self.latent_channels + self.control_channels + self.start_channels
    }

    /// Says whether a block attends to the context.
    #[must_use]
    pub fn crosses(&self, layer: usize) -> bool {
        (self.text_len > 0 || self.image_context) && layer.is_multiple_of(self.cross_every)
    }

    /// Lists the weights.
    #[must_use]
    pub fn declare(&self) -> Vec<Declared> {
        let (d, mut list) = (self.dim, Vec::new());
        if self.control_inputs > 0 {
            Declared::linear(&mut list, "control_embedding", self.control_inputs, self.control_channels, 1.0);
        }
        let patch = 1.0 / ((4 * self.in_dim()) as f32).sqrt();
        list.push(Declared::new("patch_embedding.weight", &[d, self.in_dim(), 1, 2, 2], Initial::Normal(patch)));
        list.push(Declared::new("patch_embedding.bias", &[d], Initial::Constant(0.0)));
        Declared::linear(&mut list, "time_embedding.0", self.freq_dim, d, 1.0);
        Declared::linear(&mut list, "time_embedding.2", d, d, 1.0);
        Declared::linear(&mut list, "time_projection.1", d, 6 * d, 0.1);
        if self.text_len > 0 {
            Declared::linear(&mut list, "text_embedding.0", self.text_dim, d, 1.0);
            Declared::linear(&mut list, "text_embedding.2", d, d, 1.0);
        }
        if self.image_context {
            Declared::linear(&mut list, "img_emb.proj.1", 4 * self.latent_channels, d, 1.0);
        }
        if self.clip_dim > 0 {
            norm(&mut list, "img_emb.proj.0", self.clip_dim);
            Declared::linear(&mut list, "img_emb.proj.1", self.clip_dim, self.clip_dim, 1.0);
            Declared::linear(&mut list, "img_emb.proj.3", self.clip_dim, d, 1.0);
            norm(&mut list, "img_emb.proj.4", d);
        }
        if self.reference {
            let deviation = 1.0 / ((4 * self.latent_channels) as f32).sqrt();
            let shape = [d, self.latent_channels, 2, 2];
            list.push(Declared::new("ref_conv.weight", &shape, Initial::Normal(deviation)));
            list.push(Declared::new("ref_conv.bias", &[d], Initial::Constant(0.0)));
        }
        for layer in 0..self.layers {
            self.declare_block(&mut list, layer);
        }
        Declared::linear(&mut list, "head.head", d, 4 * self.latent_channels, 0.1);
        list.push(Declared::new("head.modulation", &[1, 2, d], Initial::Constant(0.0)));
        list
    }

    fn declare_block(&self, list: &mut Vec<Declared>, layer: usize) {
        let d = self.dim;
        let name = |part: &str| format!("blocks.{layer}.{part}");
        let attention = |list: &mut Vec<Declared>, kind: &str| {
            for part in ["q", "k", "v"] {
                Declared::linear(list, &name(&format!("{kind}.{part}")), d, d, 1.0);
            }
            Declared::linear(list, &name(&format!("{kind}.o")), d, d, 0.3);
            for part in ["norm_q", "norm_k"] {
                list.push(Declared::new(name(&format!("{kind}.{part}.weight")), &[d], Initial::Constant(1.0)));
            }
        };
        list.push(Declared::new(name("modulation"), &[1, 6, d], Initial::Gates));
        attention(list, "self_attn");
        if self.crosses(layer) {
            norm(list, &name("norm3"), d);
            attention(list, "cross_attn");
            if self.clip_dim > 0 {
                for part in ["k_img", "v_img"] {
                    Declared::linear(list, &name(&format!("cross_attn.{part}")), d, d, 1.0);
                }
                list.push(Declared::new(name("cross_attn.norm_k_img.weight"), &[d], Initial::Constant(1.0)));
            }
        }
        Declared::linear(list, &name("ffn.0"), d, self.ffn, 1.0);
        Declared::linear(list, &name("ffn.2"), self.ffn, d, 0.3);
    }
}

fn norm(list: &mut Vec<Declared>, name: &str, width: usize) {
    list.push(Declared::new(format!("{name}.weight"), &[width], Initial::Constant(1.0)));
    list.push(Declared::new(format!("{name}.bias"), &[width], Initial::Constant(0.0)));
}
