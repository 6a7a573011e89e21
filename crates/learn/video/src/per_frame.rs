//! Frames made one by one: same weights, prompt, first frame and layouts as a rollout, but nothing is remembered.
//!
//! The window holds the frame's own latent alone, the decoder begins anew, noise is drawn for the tick. A latent stands
//! for several ticks: the tick's layout is shown for all of them and the last frame is taken. The shipped weights were
//! trained with memory, so this says what memory is worth to them, not how good a model trained without it would be.

use std::sync::Arc;

use ds_raster::RgbImage;
use ds_space::{Digest, Tick};

use crate::error::VideoError;
use crate::model::VideoModel;
use crate::rollout::Rollout;

/// One camera of one episode.
pub struct PerFrame {
    begun: Rollout,
}

impl PerFrame {
    /// Encodes prompt and first frame.
    ///
    /// # Errors
    /// If the prompt cannot be encoded.
    pub fn new(
        model: Arc<VideoModel>,
        draw_key: Digest,
        camera: &str,
        prompt: &str,
        first_frame: &RgbImage,
    ) -> Result<Self, VideoError> {
        Ok(Self { begun: Rollout::remembering_nothing(model, draw_key, camera, prompt, first_frame)? })
    }

    /// Returns the first frame at the model's video size: what tick 0 shows.
    #[must_use]
    pub fn first_frame(&self) -> &RgbImage {
        self.begun.first_frame()
    }

    /// Makes the frame of a tick of its layout.
    ///
    /// # Errors
    /// If the model gives values that are not finite.
    pub fn frame(&self, tick: Tick, layout: &RgbImage) -> Result<RgbImage, VideoError> {
        if tick == Tick(0) { Ok(self.first_frame().clone()) } else { self.begun.alone(tick, layout) }
    }
}
