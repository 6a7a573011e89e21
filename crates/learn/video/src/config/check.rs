//! The rules of a model's configuration.

use ds_nn::tiny_ae::BLOCK_PX;

use super::{CacheSource, ConfigError, ModelConfig};

pub(super) const MAX_WIDTH: usize = 16_384;

impl ModelConfig {
    pub(super) fn check(&self) -> Result<(), ConfigError> {
        let (v, c) = (&self.vae, &self.causal);
        if self.version != 1 {
            return refuse("version", self.version.to_string(), "must be 1");
        }
        let side = 2 * v.stride_s.clamp(1, 16) as u32;
        for (field, pixels) in [("video.width_px", self.video.width_px), ("video.height_px", self.video.height_px)] {
            if pixels == 0 || pixels > 4_096 || pixels % side != 0 {
                return refuse(field, pixels.to_string(), "must be 16 to 4096 and divisible by stride·patch, 16 or 32");
            }
        }
        self.check_model()?;
        match v.kind.as_str() {
            "tiny" => self.check_tiny()?,
            kind => self.check_published(kind)?,
        }
        self.check_files()?;
        self.check_inputs()?;
        if self.sampler.steps == 0
            || self.sampler.steps > 64
            || !(self.sampler.shift >= 1.0 && self.sampler.shift < 100.0)
        {
            return refuse("sampler.steps", self.sampler.steps.to_string(), "must be 1 to 64 with a shift of 1 to 100");
        }
        if c.chunk == 0 || c.window > 1_024 || c.window < c.sink + c.chunk {
            return refuse("causal.window", c.window.to_string(), "must be at least sink + chunk and at most 1024");
        }
        if !c.first_frame_independent {
            return refuse("causal.first_frame_independent", "false".to_owned(), "must be true");
        }
        self.check_cache_source()
    }

    fn check_model(&self) -> Result<(), ConfigError> {
        let m = &self.model;
        let head = m.dim.checked_div(m.heads).unwrap_or(0);
        let sizes = [m.layers, m.dim, m.heads, m.ffn, m.freq_dim, m.cross_every, self.vae.z];
        if sizes.iter().any(|size| *size == 0 || *size > MAX_WIDTH) {
            return refuse("model, vae", format!("{sizes:?}"), "sizes must be 1 to 16384");
        }
        if m.layers > 128 {
            return refuse("model.layers", m.layers.to_string(), "at most 128 layers");
        }
        if head * m.heads != m.dim || head % 2 == 1 || head < 12 {
            return refuse("model.heads", m.heads.to_string(), "must divide dim into even heads of 12 or more");
        }
        if m.patch != [1, 2, 2] {
            return refuse("model.patch", format!("{:?}", m.patch), "must be [1, 2, 2]");
        }
        if m.freq_dim % 2 == 1 {
            return refuse("model.freq_dim", m.freq_dim.to_string(), "must be even");
        }
        if m.text_len > 1_024 || (m.text_len > 0) != (m.text_dim > 0) || m.text_dim > MAX_WIDTH {
            return refuse("model.text_len", m.text_len.to_string(), "at most 1024, and 0 exactly if text_dim is 0");
        }
        let (h, w) = self.latent_size();
        if m.clip_dim > MAX_WIDTH {
            return refuse("model.clip_dim", m.clip_dim.to_string(), "at most 16384");
        }
        if m.clip_dim == 0 && m.img_tokens != 0 && m.img_tokens != h * w / 4 {
            return refuse("model.img_tokens", m.img_tokens.to_string(), "must be 0 or the tokens of a latent frame");
        }
        if m.clip_dim > 0 && m.text_len == 0 {
            return refuse("model.clip_dim", m.clip_dim.to_string(), "states of CLIP stand beside a prompt");
        }
        Ok(())
    }

    /// The rules of the own autoencoder.
    fn check_tiny(&self) -> Result<(), ConfigError> {
        let v = &self.vae;
        if v.encoder_widths.is_some() && v.encoder_width != 0 {
            let rule = "belongs to an encoder at 1/8 resolution alone, not beside encoder_widths";
            return refuse("vae.encoder_width", v.encoder_width.to_string(), rule);
        }
        if v.encoder().len() != v.encoder_blocks.each().len() {
            let rule = "must be one number beside encoder_width and three beside encoder_widths";
            return refuse("vae.encoder_blocks", format!("{:?}", v.encoder_blocks.each()), rule);
        }
        let widths = [v.encoder(), &v.decoder_widths].concat();
        if widths.iter().any(|width| *width == 0 || *width > MAX_WIDTH) {
            return refuse("vae", format!("{widths:?}"), "sizes must be 1 to 16384");
        }
        if v.width != 0 {
            return refuse("vae.width", v.width.to_string(), "belongs to published autoencoders");
        }
        let blocks = [v.encoder_blocks.each(), &v.decoder_blocks].concat();
        if blocks.iter().any(|blocks| *blocks > 16) {
            return refuse("vae.encoder_blocks", format!("{blocks:?}"), "at most 16 memory blocks");
        }
        let (sketch, layers) = (self.control.sketch_widths, self.control.decoder_layers);
        if sketch.is_some_and(|widths| layers == 0 || widths.iter().any(|width| *width == 0 || *width > MAX_WIDTH)) {
            let rule = "three sizes of 1 to 16384, beside decoder_layers above 0";
            return refuse("control.sketch_widths", format!("{:?}", sketch.unwrap_or_default()), rule);
        }
        if self.control.carried && layers == 0 {
            return refuse(
                "control.carried",
                "true".to_owned(),
                "needs decoder_layers above 0, which see the carried frame",
            );
        }
        if let Some(falls) = &self.control.falls {
            let rule = "needs carried = true and words for both";
            if !self.control.carried || falls.snow.is_empty() || falls.rain.is_empty() {
                return refuse("control.falls", format!("{falls:?}"), rule);
            }
        }
        if !self.control.carried && !self.control.paints.is_empty() {
            return refuse("control.paints", format!("{:?}", self.control.paints), "needs carried = true");
        }
        if !matches!(v.stride_t, 1 | 2 | 4) || v.stride_s != BLOCK_PX || v.z > 64 {
            return refuse("vae.stride_t", v.stride_t.to_string(), "must be 1, 2 or 4, with stride_s 8 and z up to 64");
        }
        Ok(())
    }

    /// The rules of published autoencoders, whose sizes are fixed.
    fn check_published(&self, kind: &str) -> Result<(), ConfigError> {
        let v = &self.vae;
        let Some(shape) = self.wan_vae() else {
            return refuse("vae.kind", kind.to_owned(), "must be \"tiny\", \"wan21\", \"wan22\" or \"taew21\"");
        };
        if (v.z, v.stride_t, v.stride_s) != (shape.z, 4, shape.stride()) {
            let found = format!("{kind} with z {}, strides {} and {}", v.z, v.stride_t, v.stride_s);
            return refuse("vae.kind", found, "wan21 and taew21 have z 16, strides 4 and 8; wan22 has 48, 4 and 16");
        }
        if v.width > MAX_WIDTH {
            return refuse("vae.width", v.width.to_string(), "at most 16384");
        }
        let sizes = [v.encoder(), v.encoder_blocks.each(), &v.decoder_widths, &v.decoder_blocks].concat();
        if sizes.iter().any(|size| *size > 0) {
            return refuse("vae.encoder_width", format!("{:?}", v.encoder()), "widths and blocks belong to kind tiny");
        }
        let control = &self.control;
        if control.decoder_layers > 0
            || control.sketch_widths.is_some()
            || control.carried
            || control.falls.is_some()
            || !control.paints.is_empty()
        {
            return refuse(
                "control.decoder_layers",
                control.decoder_layers.to_string(),
                "published decoders do not see layouts",
            );
        }
        Ok(())
    }

    /// The rules of what stands side by side in the transformer's input.
    fn check_inputs(&self) -> Result<(), ConfigError> {
        let (m, v, control) = (&self.model, &self.vae, &self.control);
        let fits = match control.encoder.as_str() {
            "unshuffle" => v.kind == "tiny" && control.channels > 0 && control.channels <= MAX_WIDTH,
            "vae" => v.kind != "tiny" && control.channels == v.z,
            "none" => control.channels == 0,
            _ => false,
        };
        if !fits {
            let rule = "must be \"unshuffle\" with channels (tiny), \"vae\" with vae.z channels (published) or \"none\" with 0";
            return refuse("control.encoder", format!("{} with {} channels", control.encoder, control.channels), rule);
        }
        if m.in_dim != v.z + control.channels + self.start_channels() {
            let rule = "must be vae.z + control.channels + vae.z again unless model.start is none";
            return refuse("model.in_dim", m.in_dim.to_string(), rule);
        }
        if m.out_dim != v.z {
            return refuse("model.out_dim", m.out_dim.to_string(), "must be vae.z");
        }
        Ok(())
    }

    fn check_cache_source(&self) -> Result<(), ConfigError> {
        let (text, steps) = (&self.causal.cache_source, self.sampler.steps);
        let fits = match CacheSource::parse(text) {
            Some(CacheSource::Clean) => true,
            Some(CacheSource::Renoise(sigma)) => (0.0..1.0).contains(&sigma),
            Some(CacheSource::State(1)) => self.causal.ablation,
            Some(CacheSource::State(step)) => (2..=steps).contains(&step),
            Some(CacheSource::X0Hat(step)) => (1..steps).contains(&step),
            None => false,
        };
        let rule = "must be clean, renoise(0 to 1), state(2 to steps), or x0hat(1 to steps − 1)";
        if fits { Ok(()) } else { Err(ConfigError::Field { field: "causal.cache_source", value: text.clone(), rule }) }
    }
}

fn refuse(field: &'static str, value: String, rule: &'static str) -> Result<(), ConfigError> {
    Err(ConfigError::Field { field, value, rule })
}
