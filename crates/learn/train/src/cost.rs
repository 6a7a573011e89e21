//! What a recipe costs: floating-point operations per update of each stage, products alone, forward once and backward
//! twice. Reading clips, norms, activations and the measurements after a stage are not counted.

use ds_nn::work;
use ds_video::ModelConfig;

use crate::config::{OdeSource, TrainConfig};
use crate::error::TrainError;

/// The cost of a stage.
#[derive(Debug, Clone, PartialEq)]
pub struct Cost {
    /// The stage.
    pub stage: &'static str,
    /// Updates, or trajectories.
    pub updates: u64,
    /// Operations of one.
    pub operations: f64,
    /// Updates that the stage's log tells of.
    pub done: u64,
}

/// Lists the costs of all stages that a recipe describes.
///
/// # Errors
/// If the model preset cannot be used.
pub fn costs(config: &TrainConfig) -> Result<Vec<Cost>, TrainError> {
    let model = config.model()?;
    let counter = Counter::new(&model);
    let mut list = Vec::new();
    let mut add = |stage: &'static str, updates: u64, operations: f64, done: u64| {
        list.push(Cost { stage, updates, operations, done });
    };
    let logged = |stage: &str| {
        let text = std::fs::read_to_string(config.folder.join(format!("{stage}.jsonl")));
        text.map_or(0, |text| text.lines().count() as u64)
    };
    if let Some(stage) = &config.autoencoder {
        let drawn = counter.drawn(stage.crop_px.map(|crop| crop.map(|side| side as usize)));
        let clip = 3.0 * drawn * (counter.encode(stage.latents) + counter.decode(stage.latents, 0));
        add("autoencoder", stage.steps.into(), clip * stage.batch() as f64, logged("autoencoder"));
    }
    for (name, stage) in
        [("prior", config.prior.as_ref()), ("teacher", config.teacher.as_ref().map(|teacher| &teacher.stage))]
    {
        if let Some(stage) = stage {
            let clip = counter.bidirectional(stage.latents) * stage.batch() as f64;
            add(name, stage.steps.into(), clip, logged(name));
        }
    }
    if let Some(made) = &config.trajectories {
        let passes = if (made.guidance - 1.0).abs() < f32::EPSILON { 1.0 } else { 2.0 };
        let one = passes * made.steps as f64 * counter.bidirectional(made.latents) / 3.0;
        add("trajectories", made.count * made.sets.len() as u64, one, 0);
    }
    if let Some(ode) = &config.ode {
        let latents = match (ode.source, &config.trajectories) {
            (OdeSource::Trajectories, Some(made)) => made.latents,
            _ => ode.stage.latents,
        };
        let clip = counter.causal(latents, latents - 1);
        add("ode", ode.stage.steps.into(), clip * ode.stage.batch() as f64, logged("ode"));
    }
    if let Some(forcing) = &config.self_forcing {
        let stage = &forcing.stage;
        let rollout = counter.rollout(forcing.rollout);
        let score = counter.bidirectional(stage.latents) / 3.0;
        // Critic once, teacher with and without the layout.
        let matched = rollout + 3.0 * score + counter.causal(forcing.rollout, stage.latents - 1);
        let regression = if forcing.regression > 0.0 { counter.causal(stage.latents, stage.latents - 1) } else { 0.0 };
        let generator = (matched + regression) / f64::from(forcing.generator_every);
        let update = (rollout + 3.0 * score + generator) * stage.batch() as f64;
        add("self_forcing", stage.steps.into(), update, logged("self_forcing"));
    }
    if let Some(decoder) = &config.decoder {
        let stage = &decoder.stage;
        let guides = if decoder.rollouts > 0 { model.control.decoder_layers } else { 0 };
        let decoded = 3.0 * counter.decode(stage.latents, guides);
        // Verdicts on made, true and noisy frames, their backward passes, and that of the decoder through the first.
        let judged = decoder.adversarial.as_ref().map_or(0.0, |against| {
            10.0 * work::judge(&against.shape(), stage.latents * model.vae.stride_t, counter.h, counter.w)
        });
        let clip = counter.drawn(decoder.crop_px) * (decoded + judged);
        add("decoder", stage.steps.into(), clip * stage.batch() as f64, logged("decoder"));
    }
    Ok(list)
}

struct Counter<'a> {
    model: &'a ModelConfig,
    h: usize,
    w: usize,
    n: usize,
}

impl<'a> Counter<'a> {
    fn new(model: &'a ModelConfig) -> Self {
        let (h, w) = model.latent_size();
        Self { model, h, w, n: model.dit().tokens() }
    }

    /// Returns the share of a frame that is drawn.
    fn drawn(&self, crop_px: Option<[usize; 2]>) -> f64 {
        let whole = f64::from(self.model.video.width_px * self.model.video.height_px);
        crop_px.map_or(1.0, |[width, height]| ((width * height) as f64 / whole).min(1.0))
    }

    fn encode(&self, latents: usize) -> f64 {
        work::encode(&self.model.ae(), latents, self.h, self.w)
    }

    fn decode(&self, latents: usize, guides: usize) -> f64 {
        work::decode(&ds_nn::tiny_ae::AeShape { guides, ..self.model.ae() }, latents, self.h, self.w)
    }

    /// A training step over a whole clip in which every frame sees all.
    fn bidirectional(&self, frames: usize) -> f64 {
        work::train(&self.model.dit(), [frames * self.n, frames, (frames * self.n).pow(2)])
    }

    /// A training step over a clip as the cache shows it, with `queries` frames denoised behind it.
    fn causal(&self, frames: usize, queries: usize) -> f64 {
        let seen = |frame: usize| (frame + 1).min(self.model.causal.window);
        let pairs: usize = (0..frames).chain(frames - queries..frames).map(seen).sum();
        work::train(&self.model.dit(), [(frames + queries) * self.n, frames, pairs * self.n * self.n])
    }

    /// Denoising all frames after the first by all steps of the sampler.
    fn rollout(&self, frames: usize) -> f64 {
        let cached = self.model.causal.window - self.model.causal.chunk;
        let passes = (frames - 1) * self.model.sampler.steps;
        passes as f64 * work::denoise(&self.model.dit(), 1, cached)
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::config::StageConfig;

    #[test]
    fn every_stage_of_the_shipped_recipe_has_a_cost() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs/train/cpu_train.toml");
        let config = TrainConfig::load(&path).expect("the recipe is valid");
        let costs = costs(&config).expect("the preset is valid");
        let names: Vec<&str> = costs.iter().map(|cost| cost.stage).collect();
        assert_eq!(names, ["autoencoder", "prior", "teacher", "trajectories", "ode", "self_forcing", "decoder"]);
        assert!(costs.iter().all(|cost| cost.updates > 0 && cost.operations > 1e9), "{costs:?}");
        let road = TrainConfig::load(&path.with_file_name("road.toml")).expect("the recipe is valid");
        let drawn = super::costs(&road).expect("the preset is valid")[0].operations;
        let whole = TrainConfig {
            autoencoder: road.autoencoder.clone().map(|stage| StageConfig { crop_px: None, ..stage }),
            ..road
        };
        let share = drawn / super::costs(&whole).expect("the preset is valid")[0].operations;
        assert!((share - 1.0 / 9.0).abs() < 1e-9, "64×64 of 256×144 pixels are a ninth, not {share}");
        // One frame more is seen by all others: more than its share.
        let model = config.model().expect("valid");
        let counter = Counter::new(&model);
        assert!(counter.bidirectional(8) > 2.0 * counter.bidirectional(4));
        assert!(counter.causal(6, 5) > counter.causal(6, 1));
    }
}
