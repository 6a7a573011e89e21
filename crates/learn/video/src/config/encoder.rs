//! The encoder of the own autoencoder as a preset names it: at 1/8 resolution alone, or in three stages.

use serde::{Deserialize, Serialize};

use super::VaeConfig;

/// Memory blocks of an encoder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected a number of memory blocks, or three in brackets beside encoder_widths")]
pub enum BlocksConfig {
    /// At 1/8 resolution alone.
    Single(usize),
    /// Of each stage.
    Staged([usize; 3]),
}

impl VaeConfig {
    /// Returns the widths of the encoder's stages.
    pub(super) fn encoder(&self) -> &[usize] {
        self.encoder_widths.as_ref().map_or(std::slice::from_ref(&self.encoder_width), |widths| widths)
    }
}

impl Default for BlocksConfig {
    fn default() -> Self {
        Self::Single(0)
    }
}

impl BlocksConfig {
    /// Returns the blocks of each stage.
    #[must_use]
    pub fn each(&self) -> &[usize] {
        match self {
            Self::Single(blocks) => std::slice::from_ref(blocks),
            Self::Staged(blocks) => blocks,
        }
    }
}
