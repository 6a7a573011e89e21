//! The stages by name and in order.

use crate::config::TrainConfig;
use crate::error::TrainError;
use crate::{Progress, Report, autoencoder, decoder, ode, self_forcing, ship, teacher, trajectories};

/// A stage of the video model's training.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "the stages, named in the crate's documentation")]
pub enum Stage {
    Autoencoder,
    Prior,
    Teacher,
    Trajectories,
    Ode,
    SelfForcing,
    Decoder,
    Ship,
}

impl Stage {
    /// All stages, in the order in which they need each other.
    pub const ALL: [Self; 8] = [
        Self::Autoencoder,
        Self::Prior,
        Self::Teacher,
        Self::Trajectories,
        Self::Ode,
        Self::SelfForcing,
        Self::Decoder,
        Self::Ship,
    ];

    /// Returns the name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Autoencoder => "autoencoder",
            Self::Prior => "prior",
            Self::Teacher => "teacher",
            Self::Trajectories => "trajectories",
            Self::Ode => "ode",
            Self::SelfForcing => "self-forcing",
            Self::Decoder => "decoder",
            Self::Ship => "ship",
        }
    }

    /// Says whether a recipe describes the stage.
    #[must_use]
    pub fn described(self, config: &TrainConfig) -> bool {
        match self {
            Self::Autoencoder => config.autoencoder.is_some(),
            Self::Prior => config.prior.is_some(),
            Self::Teacher => config.teacher.is_some(),
            Self::Trajectories => config.trajectories.is_some(),
            Self::Ode => config.ode.is_some(),
            Self::SelfForcing => config.self_forcing.is_some(),
            Self::Decoder => config.decoder.is_some(),
            Self::Ship => true,
        }
    }

    /// Runs the stage to its end, or until `progress` stops it; nothing is reported by stages that train nothing.
    ///
    /// # Errors
    /// If the recipe does not describe it, an earlier stage is missing, a file cannot be used, or the device is
    /// absent.
    pub fn run(self, config: &TrainConfig, progress: &mut dyn Progress) -> Result<Option<Report>, TrainError> {
        config.backend.ready()?;
        match self {
            Self::Autoencoder => autoencoder::run(config, progress).map(Some),
            Self::Prior => teacher::prior(config, progress).map(Some),
            Self::Teacher => teacher::teacher(config, progress).map(Some),
            Self::Trajectories => trajectories::run(config, progress).map(|()| None),
            Self::Ode => ode::run(config, progress).map(Some),
            Self::SelfForcing => self_forcing::run(config, progress).map(Some),
            Self::Decoder => decoder::run(config, progress).map(Some),
            Self::Ship => ship::run(config, None, None, progress).map(|()| None),
        }
    }
}
