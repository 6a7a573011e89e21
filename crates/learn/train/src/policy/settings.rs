//! The settings of policy training, read from TOML (`configs/train/policy.toml`) and checked.

use ds_space::{Digest, DigestWriter};
use serde::Deserialize;

use super::PolicyTrainError;

/// A round of training: first the policy so far drives scenarios for new samples, then it is trained on all samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Round {
    /// Scenarios that the policy drives before this round; 0 for none.
    pub scenarios: u32,
    /// Steps of training.
    pub steps: u32,
}

/// What training depends on.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PolicySettings {
    /// The version of this form, 1.
    pub version: u32,
    /// The seed of all draws.
    pub seed: u64,
    /// Training scenarios with states beside the expert's drive; the families take turns.
    pub scenarios: u32,
    /// States per scenario.
    pub states_per_scenario: u32,
    /// Held-out scenarios of the open-loop measure.
    pub held_out_scenarios: u32,
    /// Held-out scenarios that are driven in closed loop.
    pub driven_scenarios: u32,
    /// Length of a closed-loop drive, in ticks.
    pub drive_ticks: u32,
    /// Ticks driven of each plan.
    pub replan_ticks: u32,
    /// Largest sideways shift of a state, in metres.
    pub lateral_m: f64,
    /// Largest turn of a state, in radians.
    pub heading_rad: f64,
    /// Samples per step.
    pub batch: u32,
    /// The highest learning rate.
    pub learning_rate: f32,
    /// Steps until it is reached.
    pub warm_up: u32,
    /// Decoupled weight decay.
    pub weight_decay: f32,
    /// Decay of the average of the weights, which is what ships.
    pub average_decay: f32,
    /// Steps between log lines.
    pub log_every: u32,
    /// Steps between checkpoints.
    pub save_every: u32,
    /// The rounds.
    pub rounds: Vec<Round>,
}

impl PolicySettings {
    /// Reads and checks settings.
    ///
    /// # Errors
    /// [`PolicyTrainError`] names the setting.
    pub fn parse(text: &str) -> Result<Self, PolicyTrainError> {
        let settings: Self = toml::from_str(text)?;
        settings.check()?;
        Ok(settings)
    }

    /// Checks all numbers.
    ///
    /// # Errors
    /// [`PolicyTrainError::Setting`] names the first bad one.
    pub fn check(&self) -> Result<(), PolicyTrainError> {
        let whole = |field, value: u32, most: u32, need| {
            let bad = PolicyTrainError::Setting { field, value: value.to_string(), need };
            if (1..=most).contains(&value) { Ok(()) } else { Err(bad) }
        };
        let real = |field, value: f64, low: f64, high: f64, need| {
            let bad = PolicyTrainError::Setting { field, value: value.to_string(), need };
            if (low..=high).contains(&value) { Ok(()) } else { Err(bad) }
        };
        whole("version", self.version, 1, "1")?;
        whole("scenarios", self.scenarios, 4_000, "1 to 4000")?;
        whole("states_per_scenario", self.states_per_scenario, 1_000, "1 to 1000")?;
        whole("held_out_scenarios", self.held_out_scenarios, 1_000, "1 to 1000")?;
        whole("driven_scenarios", self.driven_scenarios, 1_000, "1 to 1000")?;
        whole("drive_ticks", self.drive_ticks, 150, "1 to 150")?;
        whole("replan_ticks", self.replan_ticks, 50, "1 to 50")?;
        whole("batch", self.batch, 1_024, "1 to 1024")?;
        whole("log_every", self.log_every, u32::MAX, "at least 1")?;
        whole("save_every", self.save_every, u32::MAX, "at least 1")?;
        real("lateral_m", self.lateral_m, 0.0, 3.0, "0 to 3")?;
        real("heading_rad", self.heading_rad, 0.0, 0.6, "0 to 0.6")?;
        real("learning_rate", f64::from(self.learning_rate), 1e-7, 0.1, "0.0000001 to 0.1")?;
        real("weight_decay", f64::from(self.weight_decay), 0.0, 1.0, "0 to 1")?;
        real("average_decay", f64::from(self.average_decay), 0.0, 0.99999, "0 to 0.99999")?;
        let driven: u32 = self.rounds.iter().map(|round| round.scenarios.min(10_000)).sum();
        real("rounds.scenarios", f64::from(driven), 0.0, 30_000.0, "at most 30000 in all")
    }

    /// Returns the number of steps of all rounds.
    #[must_use]
    pub fn steps(&self) -> u32 {
        self.rounds.iter().fold(0, |sum, round| sum.saturating_add(round.steps))
    }

    /// Returns the digest of all settings.
    #[must_use]
    pub fn digest(&self) -> Digest {
        DigestWriter::new().text(&format!("{self:?}")).finish()
    }
}
