//! A first frame from layout and prompt alone: the teacher's one-frame mode.
//!
//! The teacher samples one latent after an empty first frame, as `without_first` of its training clips had it, in a world
//! that stands still; the last of the latent's frames is the answer.

use std::path::Path;

use ds_nn::Array;
use ds_nn::tiny_ae::Memory;
use ds_raster::RgbImage;
use ds_space::{Digest, Tick};
use ds_video::{Carry, Layout, ModelConfig, VideoModel, tokens};

use crate::condition::Condition;
use crate::condition::noise;
use crate::error::TrainError;
use crate::guidance::{Dropout, Guidance, Teacher};

/// What a first frame is made of.
pub struct Request<'a> {
    /// The layout of the moment.
    pub layout: &'a Layout,
    /// Words for what is to be seen.
    pub prompt: &'a str,
    /// Keys the noise.
    pub key: Digest,
    /// Euler steps.
    pub steps: usize,
    /// Guidance w towards layout and prompt, 1 being none.
    pub guidance: f32,
}

/// A teacher with its autoencoder, ready to imagine first frames.
pub struct FirstFrames {
    config: ModelConfig,
    model: VideoModel,
    teacher: Teacher,
}

impl FirstFrames {
    /// Loads a teacher's weights with their autoencoder. Guidance amplifies layout and prompt together.
    ///
    /// # Errors
    /// If the weights cannot be used.
    pub fn load(config: &ModelConfig, weights: &Path) -> Result<Self, TrainError> {
        let weights = VideoModel::read(config, weights)?;
        let model = VideoModel::new(config, &weights)?;
        let teacher = Teacher::new(config, &weights.part("dit."), Dropout::All)?;
        Ok(Self { config: config.clone(), model, teacher })
    }

    /// Samples a first frame.
    ///
    /// # Errors
    /// If the frame is not finite.
    pub fn make(&self, request: &Request<'_>) -> Result<RgbImage, TrainError> {
        let (config, model) = (&self.config, &self.model);
        let ((h, w), z, stride, n) = (config.latent_size(), config.vae.z, config.vae.stride_t, config.dit().tokens());
        let still = vec![&request.layout.image; stride];
        let (empty, layouts) = (vec![0.0; n * 4 * z], [still.clone(), still.clone()]);
        let condition =
            Condition { start: &empty, clean: &empty, layouts: &layouts, layout_on: true, prompt: request.prompt };
        let batch = condition.batch(config);
        let noise = noise(&request.key, "first frame", &[], &[1, 1, n, 4, z]);
        let sampled =
            self.teacher.sample(&batch, &noise, request.steps, Guidance::by(request.guidance), &mut |_, _| ());
        let latents = Array::new(&[1, h, w, z], tokens::from_tokens(sampled.values(), h, w));
        let [width, height] = [config.video.width_px, config.video.height_px];
        let guide = (config.control.decoder_layers > 0)
            .then(|| Carry::default().guide(&config.ae(), width, height, &vec![request.layout; stride]));
        let frames = model.autoencoder().decode(&model.denormalised(latents), guide.as_ref(), &mut Memory::default());
        if !frames.is_finite() {
            return Err(TrainError::NotFinite { what: "first frame" });
        }
        let last = frames.values().len() / stride * (stride - 1);
        let frame = RgbImage::of_values(&frames.values()[last..], width, height);
        let fall = config.control.falls.as_ref().and_then(|falls| falls.said(request.prompt, request.key));
        Ok(request.layout.falling(&frame, fall, Tick(0)))
    }
}
