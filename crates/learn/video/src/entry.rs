//! The cache log: what a successor needs to continue a rollout, one entry per committed chunk.

use ds_nn::Array;
use ds_space::Digest;

/// A plain latent: shape and row-major values.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Latent {
    /// Shape.
    pub shape: Vec<u32>,
    /// Values.
    pub values: Vec<f32>,
}

impl Latent {
    pub(crate) fn of(array: &Array) -> Self {
        Self { shape: array.shape().iter().map(|side| *side as u32).collect(), values: array.values().to_vec() }
    }

    pub(crate) fn digest(&self) -> Digest {
        let shape: Vec<usize> = self.shape.iter().map(|side| *side as usize).collect();
        Array::new(&shape, self.values.clone()).digest()
    }

    /// Returns the array if it has the expected shape and is finite.
    pub(crate) fn checked(&self, shape: &[usize]) -> Result<Array, String> {
        let fits = self.shape.len() == shape.len() && self.shape.iter().zip(shape).all(|(a, b)| *a as usize == *b);
        if !fits || self.values.len() != shape.iter().product::<usize>() {
            let count = self.values.len();
            return Err(format!("has shape {:?} and {count} values, {shape:?} expected", self.shape));
        }
        match self.values.iter().position(|value| !value.is_finite()) {
            Some(index) => Err(format!("holds {} at index {index}", self.values[index])),
            None => Ok(Array::new(shape, self.values.clone())),
        }
    }
}

/// One committed chunk.
#[derive(Debug, Clone, PartialEq)]
pub struct CacheEntry {
    /// The chunk; 0 is the first frame.
    pub chunk: u32,
    /// The first tick of the chunk, counted from the tick of the first frame.
    pub first_tick_offset: u32,
    /// Ticks of the chunk.
    pub ticks: u32,
    /// The exact tensor fed to the forward pass that wrote the cache, [frames, tokens, 4, z].
    pub cached_input: Latent,
    /// The clean latent that was decoded, [frames, tokens, 4, z], normalised.
    pub clean: Latent,
    /// The control latent of the chunk, [frames, tokens, 4, channels].
    pub control: Latent,
    /// Digest of all that does not change during a rollout: draw key, camera, prompt, first frame.
    pub conditioning: Digest,
    /// Digest over all keys and values committed so far; of a published model over the outputs of the passes that made
    /// them.
    pub cache_digest: Digest,
    /// Digest of the encoder's memory after the first frame, or of the first frame's latent.
    pub encoder_digest: Digest,
    /// Digest of the decoder's memory after the chunk; of a published model over the last frame of every chunk.
    pub decoder_digest: Digest,
}
