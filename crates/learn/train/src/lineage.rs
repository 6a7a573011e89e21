//! What a checkpoint tells of the recipe that made it, so that no other recipe goes on from it unnoticed.
//!
//! A stage's part of the recipe is written flat, one text per key (`teacher.stage.learning_rate` is `0.002`), with what
//! the stage reads of the rest: the seed, the preset's keys, the recipe of its trajectories. Left out is what changes no
//! weight: where files lie, how often checkpoints are stored, the set to look at, and the back end, whose results equal
//! another's up to rounding.

use std::collections::BTreeMap;

use ds_nn::optimiser::Shape;
use serde::Serialize;
use serde_json::Value;

use crate::config::{OdeSource, StageConfig, TrainConfig};
use crate::error::TrainError;

/// The keys of a recipe that a stage depends on.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Lineage {
    keys: BTreeMap<String, String>,
    /// The key of the stage's number of steps.
    steps: String,
}

impl Lineage {
    /// Gathers the keys that a stage depends on.
    pub(crate) fn of(config: &TrainConfig, stage: &str) -> Result<Self, TrainError> {
        let mut keys = BTreeMap::new();
        let mut add = |key: &str, value: Value| flatten(key, value, &mut keys);
        add("seed", told(&config.seed));
        add("road_users", told(&config.road_users));
        add("lights", told(&config.lights));
        add("preset", told(&config.model()?));
        add(stage, stage_recipe(config, stage));
        match stage {
            "autoencoder" | "decoder" => add("initial", told(&config.initial)),
            "prior" => {
                add("without_first", told(&config.without_first));
                add("initial", told(&config.initial));
            }
            "teacher" => add("without_first", told(&config.without_first)),
            "ode" if config.ode.as_ref().is_some_and(|ode| !ode.from_teacher) => add("initial", told(&config.initial)),
            "self_forcing" => {
                add("unconditional", told(&config.unconditional));
                add("keep_look", told(&config.keep_look));
                add("guide_levels", told(&config.guide_levels));
            }
            _ => {}
        }
        let regression = config.self_forcing.as_ref().is_some_and(|recipe| recipe.regression > 0.0);
        if let Some(ode) = config.ode.as_ref().filter(|_| stage == "ode" || (stage == "self_forcing" && regression)) {
            add("ode.source", told(&ode.source));
            add("ode.stage.sets", told(&ode.stage.sets));
            add("ode.stage.latents", told(&ode.stage.latents));
            if ode.source == OdeSource::Trajectories {
                add("trajectories", told(&config.trajectories));
            }
        }
        keys.retain(|key, _| depends(stage, key));
        let nested = keys.keys().any(|key| key.starts_with(&format!("{stage}.stage.")));
        let steps = if nested { format!("{stage}.stage.steps") } else { format!("{stage}.steps") };
        Ok(Self { keys, steps })
    }

    /// Returns the keys as one line of text, for a file.
    pub(crate) fn text(&self) -> String {
        told(&self.keys).to_string()
    }

    /// Refuses to go on after `made` steps from a checkpoint that tells another recipe. More steps are granted where
    /// the learning rate of the steps made does not depend on how many there are: with a constant schedule.
    pub(crate) fn check(&self, made_by: &str, stage: &StageConfig, made: u32, path: &str) -> Result<(), TrainError> {
        let was: BTreeMap<String, String> = serde_json::from_str(made_by).map_err(|error| TrainError::Checkpoint {
            path: path.to_owned(),
            reason: format!("its recipe cannot be read: {error}"),
        })?;
        let granted = stage.schedule == Shape::Constant && stage.steps >= made;
        let mut now = self.keys.clone();
        if granted {
            now.remove(&self.steps);
        }
        let differences = differences(&was, &now);
        if differences.is_empty() {
            return Ok(());
        }
        Err(TrainError::Recipe { path: path.to_owned(), differences: differences.join(", ") })
    }
}

/// Returns the recipe of a stage.
fn stage_recipe(config: &TrainConfig, stage: &str) -> Value {
    match stage {
        "autoencoder" => told(&config.autoencoder),
        "prior" => told(&config.prior),
        "teacher" => told(&config.teacher),
        "ode" => told(&config.ode),
        "self_forcing" => told(&config.self_forcing),
        _ => told(&config.decoder),
    }
}

/// Says whether the weights of a stage depend on a key.
fn depends(stage: &str, key: &str) -> bool {
    let Some(preset) = key.strip_prefix("preset.") else { return !key.ends_with(".checkpoint_every") };
    match stage {
        _ if preset == "name" || preset == "version" || preset.starts_with("weights.") => false,
        "autoencoder" => preset.starts_with("video.") || preset.starts_with("vae."),
        // Whole clips are neither cached nor made in few steps.
        "prior" | "teacher" => {
            let later = ["sampler.steps", "control.decoder_layers", "control.sketch_widths"];
            !(preset.starts_with("causal.") || later.contains(&preset))
        }
        _ => true,
    }
}

/// Names the keys in which two recipes differ, of those that both have.
pub(crate) fn differences(was: &BTreeMap<String, String>, now: &BTreeMap<String, String>) -> Vec<String> {
    let both = was.iter().filter_map(|(key, was)| Some((key, was, now.get(key)?)));
    both.filter(|(_, was, now)| was != now).map(|(key, was, now)| format!("{key:?} was {was} and is {now}")).collect()
}

/// Writes the leaves of a value under their dotted keys.
pub(crate) fn flatten(key: &str, value: Value, keys: &mut BTreeMap<String, String>) {
    match value {
        Value::Object(fields) => {
            for (name, value) in fields {
                let inner = if key.is_empty() { name } else { format!("{key}.{name}") };
                flatten(&inner, value, keys);
            }
        }
        leaf => drop(keys.insert(key.to_owned(), leaf.to_string())),
    }
}

/// Returns a value as JSON by way of its text, so that a number of single precision stays as short as it was written.
fn told(value: &impl Serialize) -> Value {
    let text = serde_json::to_string(value).expect("a recipe is plain data");
    serde_json::from_str(&text).expect("what was just written is JSON")
}
