//! What a prompt says is falling.

use ds_raster::{Fall, Falling};
use ds_space::Digest;
use serde::{Deserialize, Serialize};

/// How densely what a prompt tells of falls, 0 to 1.
const FALL: f64 = 0.8;

/// Words of prompts, as the model was trained on, that say that something falls.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FallsConfig {
    /// Of snow.
    pub snow: String,
    /// Of rain.
    pub rain: String,
}

impl FallsConfig {
    /// Returns what a prompt says is falling, drawn by a key.
    #[must_use]
    pub fn said(&self, prompt: &str, key: Digest) -> Option<Fall> {
        let words = [(&self.snow, Falling::Snow), (&self.rain, Falling::Rain)];
        let (_, falling) = words.into_iter().find(|(words, _)| prompt.contains(words.as_str()))?;
        Some(Fall::new(falling, FALL, key, 0))
    }
}
