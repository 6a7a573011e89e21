//! A whole clip in one forward pass, every frame seeing every other: the published models as they were trained.

use burn::tensor::Tensor;
use ds_nn::array::Array;

use super::{Context, Dit, Qkv, Tokens};
use crate::graph::{Mode, array_of};

/// A clip to denoise at once.
#[derive(Clone, Copy)]
pub struct Clip<'a> {
    /// The noisy latents, [frames, tokens, 4, z].
    pub noisy: &'a Array,
    /// Control latents, [frames, tokens, 4, control channels], where the shape has such channels.
    pub control: Option<&'a Array>,
    /// Start latents, [frames, tokens, 4, start channels], where the shape has such channels.
    pub start: Option<&'a Array>,
    /// The clean latent of a reference frame, [1, tokens, 4, z]; it takes the place before the first frame.
    pub reference: Option<&'a Array>,
    /// The timestep of each frame, or one for all.
    pub times: &'a [f32],
}

impl Dit {
    /// Returns the network's output for all frames of a clip, in the shape of the noisy latents. Absent control and
    /// start latents are zeros; a reference frame has the timestep of the first frame, and its output is dropped.
    #[must_use]
    pub fn whole(&self, clip: &Clip<'_>, context: &Context) -> Array {
        let shape = clip.noisy.shape().to_vec();
        let (frames, n, z) = (shape[0], shape[1], shape[3]);
        let rows = |array: Option<&Array>, channels: usize| {
            let channels = channels.max(1);
            let zeros = || Array::zeros(&[frames, n, 4, channels]);
            let array = array.map_or_else(zeros, Clone::clone);
            self.graph.tensor::<4>(&array).reshape([1, frames * n, 4, channels])
        };
        let tokens = Tokens {
            noisy: rows(Some(clip.noisy), z),
            control: rows(clip.control, self.shape.control_channels),
            start: rows(clip.start, self.shape.start_channels),
            times: clip.times.to_vec(),
        };
        let mut x = self.embed(tokens);
        let mut times = clip.times.to_vec();
        let lead = usize::from(clip.reference.is_some());
        if let (Some(reference), Some(layer)) = (clip.reference, &self.reference) {
            let reference = self.graph.tensor::<4>(reference).reshape([1, n, 4 * z]);
            x = Tensor::cat(vec![layer.apply(reference), x], 1);
            if times.len() > 1 {
                times.insert(0, times[0]);
            }
        }
        let heads = self.heads();
        let rotation = heads.rotation(&self.graph, &(0..frames + lead).collect::<Vec<_>>());
        let lower = |x| self.graph.lower(x);
        let y = self.run(x, &times, context, &mut |_, Qkv { q, k, v }| {
            heads.attend(Mode::Infer, lower(rotation.apply(q)), lower(rotation.apply(k)), lower(v))
        });
        let y = y.slice([0..1, lead * n..(lead + frames) * n, 0..4 * z]);
        array_of(y.reshape([frames, n, 4, z]))
    }
}
