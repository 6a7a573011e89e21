//! The recipe of the guided decoder.

use ds_nn::tiny_ae::BLOCK_PX;
use serde::{Deserialize, Serialize};

use super::StageConfig;
use crate::error::TrainError;

/// The recipe of the guided decoder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DecoderConfig {
    /// What all stages have.
    pub stage: StageConfig,
    /// Clips of the sets that the student is rolled out over; 0 trains an unguided decoder on encoded frames
    /// alone, before there is a student.
    pub rollouts: u64,
    /// Latent frames of such a rollout, of which windows of the stage's length are drawn.
    #[serde(default)]
    pub rollout: usize,
    /// The share of clips that are rollouts.
    #[serde(default = "most")]
    pub rolled: f64,
    /// How much a pixel of a rollout counts where the layout tells nothing but ground or sky.
    #[serde(default = "super::alike")]
    pub untold: f32,
    /// How much a pixel of a rollout counts where the layout tells that something stands, but not what it looks like.
    #[serde(default = "super::alike")]
    pub structures: f32,
    /// How much more a pixel counts whose layout shows a line or a crossing, in rollouts and encoded frames.
    #[serde(default = "super::alike")]
    pub markings: f32,
    /// How much a pixel of a road user counts in a rollout, which cannot know what paint one wears that was not seen yet; as in all
    /// stages without it.
    #[serde(default)]
    pub rolled_road_users: Option<f32>,
    /// The share of drawn parts that lie around a road user or what blocks the way, where a layout shows one.
    #[serde(default)]
    pub aimed: f64,
    /// How much the error of what changes from frame to frame counts beside that of the frames.
    #[serde(default)]
    pub change: f32,
    /// How much the error of texture counts beside that of the frames: of how much neighbouring pixels differ on average within each
    /// block of 8×8, wherever it is that they do.
    #[serde(default)]
    pub texture: f32,
    /// Width and height of the part of a clip that is drawn, multiples of 8; all without it.
    #[serde(default)]
    pub crop_px: Option<[usize; 2]>,
    /// What the decoder is trained against; reconstruction alone without it.
    #[serde(default)]
    pub adversarial: Option<AdversarialConfig>,
}

fn most() -> f64 {
    0.7
}

/// The discriminator that a decoder is trained against.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AdversarialConfig {
    /// Widths at 1/2, 1/4 and 1/8 resolution.
    pub widths: [usize; 3],
    /// Its learning rate.
    pub learning_rate: f32,
    /// Updates before the decoder meets it; it learns from the first on.
    #[serde(default)]
    pub after: u32,
    /// Size of its gradient in units of the reconstruction's, at the frames.
    pub share: f32,
    /// Weight of the distance of features beside the verdict, for encoded frames.
    pub features: f32,
    /// The share of its gradient's colour that reaches pixels which count less than 1, as `untold` makes them; their brightness gets
    /// all of it.
    #[serde(default = "super::alike")]
    pub colour: f32,
    /// Deviation of the noise around true frames within which its verdict is to stay; frames reach from −1 to 1.
    pub noise: f32,
    /// Weight of the square of what that noise changes.
    pub smoothness: f32,
}

impl DecoderConfig {
    pub(super) fn check(&self) -> Result<(), TrainError> {
        let refuse = |field, rule: &str| Err(TrainError::Config { field, rule: rule.to_owned() });
        if ![self.rolled, f64::from(self.untold), f64::from(self.structures)].iter().all(|v| (0.0..=1.0).contains(v)) {
            return refuse("decoder", "rolled, untold and structures must lie within 0 to 1");
        }
        if !(0.0..=1.0).contains(&self.aimed) {
            return refuse("decoder.aimed", "must lie within 0 to 1");
        }
        if self.rolled_road_users.is_some_and(|weight| !(0.0..=1e3).contains(&weight)) {
            return refuse("decoder.rolled_road_users", "must lie within 0 to 1000");
        }
        if !(1.0..=1e3).contains(&self.markings) {
            return refuse("decoder.markings", "must be 1 to 1000");
        }
        if self.crop_px.is_some_and(|crop| crop.iter().any(|side| *side == 0 || !side.is_multiple_of(BLOCK_PX))) {
            return refuse("decoder.crop_px", "must be multiples of 8 pixels");
        }
        if ![self.change, self.texture].iter().all(|weight| (0.0..=1e3).contains(weight)) {
            return refuse("decoder", "change and texture must lie within 0 to 1000");
        }
        let Some(against) = &self.adversarial else { return Ok(()) };
        let weights = [against.share, against.features, against.noise, against.smoothness];
        if !(0.0..=1.0).contains(&against.colour) {
            return refuse("decoder.adversarial.colour", "must lie within 0 to 1");
        }
        let rate = against.learning_rate > 0.0 && against.learning_rate < 1.0;
        if against.widths.contains(&0) || !rate || weights.iter().any(|weight| !(0.0..=1e3).contains(weight)) {
            let rule = "widths must be positive, learning_rate within (0, 1), the others within 0 to 1000";
            return refuse("decoder.adversarial", rule);
        }
        Ok(())
    }
}
