//! The policies with weights: `camera` and those of the panel, by name, by file, by weights.

use std::path::{Path, PathBuf};

use ds_graph::panel::Kind;
use ds_nn::array::Declared;
use ds_nn::safetensors::WeightsFile;
use ds_nn::{Weights, WeightsError};

use crate::Policy;
use crate::camera::{self, CameraPolicy};
use crate::error::PolicyError;
use crate::panel::PanelPolicy;

/// A policy with weights.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Learned {
    /// The `camera` policy.
    Camera,
    /// A policy of the panel.
    Panel(Kind),
}

impl Learned {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::Camera,
        Self::Panel(Kind::Drivor),
        Self::Panel(Kind::Ltf),
        Self::Panel(Kind::Diffusiondrive),
        Self::Panel(Kind::DiffusiondriveV2),
        Self::Panel(Kind::Sparsedrive),
        Self::Panel(Kind::Rap),
    ];

    /// Finds a policy by its name.
    #[must_use]
    pub fn of(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|learned| learned.name() == name)
    }

    /// Returns the name, as in `run --policy`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Camera => camera::NAME,
            Self::Panel(kind) => kind.name(),
        }
    }

    /// Returns the name of the weights file.
    #[must_use]
    pub fn file_name(self) -> String {
        match self {
            Self::Camera => "camera_policy.safetensors".to_owned(),
            Self::Panel(kind) => format!("{}.safetensors", kind.name()),
        }
    }

    /// Returns where the weights are, `given` being the file that was named: for the camera policy that file; for one of the
    /// panel that file if it is called after the policy (`drivor.safetensors`), else `panel/NAME.safetensors` beside it.
    #[must_use]
    pub fn weights_file(self, given: &Path) -> PathBuf {
        match self {
            Self::Panel(kind) if given.file_stem().is_none_or(|stem| stem != kind.name()) => {
                given.with_file_name("panel").join(self.file_name())
            }
            Self::Camera | Self::Panel(_) => given.to_owned(),
        }
    }

    /// Returns the policy whose network this one's goes on from, its weights as they are.
    #[must_use]
    pub fn begins_with(self) -> Option<Self> {
        match self {
            Self::Panel(kind) => kind.begins_with().map(Self::Panel),
            Self::Camera => None,
        }
    }

    /// Returns how large a share of the expert's samples is shown to it as layout images instead of frames.
    #[must_use]
    pub fn rasters(self) -> f64 {
        if self == Self::Panel(Kind::Rap) { 1.0 / 3.0 } else { 0.0 }
    }

    /// Lists the weights.
    #[must_use]
    pub fn declared(self) -> Vec<Declared> {
        match self {
            Self::Camera => camera::SIZE.declared(),
            Self::Panel(kind) => kind.declared(),
        }
    }

    /// Makes the policy of weights.
    ///
    /// # Errors
    /// If a weight is missing, surplus, not finite or has a wrong shape.
    pub fn policy(self, weights: &Weights) -> Result<Box<dyn Policy>, WeightsError> {
        Ok(match self {
            Self::Camera => Box::new(CameraPolicy::new(weights)?),
            Self::Panel(kind) => Box::new(PanelPolicy::new(kind, weights)?),
        })
    }

    /// Says whether there is a file of weights.
    ///
    /// # Errors
    /// [`PolicyError::Untrained`] names the command that trains what is not there.
    pub fn trained(self, path: &Path) -> Result<(), PolicyError> {
        let absent = || PolicyError::Untrained { name: self.name(), path: path.display().to_string() };
        path.exists().then_some(()).ok_or_else(absent)
    }

    /// Makes the policy of a safetensors file.
    ///
    /// # Errors
    /// As of [`Self::trained`]; [`PolicyError::Weights`] names the file and what is wrong with it.
    pub fn load(self, path: &Path) -> Result<Box<dyn Policy>, PolicyError> {
        self.trained(path)?;
        let refuse = |source| PolicyError::Weights { path: path.display().to_string(), source };
        let file = WeightsFile::read(path).map_err(|error| refuse(error.into()))?;
        self.policy(&file.weights).map_err(|error| refuse(error.into()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_of_the_panel_lie_beside_those_of_the_camera_policy() {
        let (drivor, given) = (Learned::Panel(Kind::Drivor), Path::new("models/camera_policy.safetensors"));
        assert_eq!(drivor.weights_file(given), Path::new("models/panel/drivor.safetensors"));
        let own = Path::new("mine/drivor.safetensors");
        assert_eq!(drivor.weights_file(own), own);
        assert_eq!(Learned::Camera.weights_file(given), given);
        assert_eq!(Learned::ALL.len(), 1 + Kind::ALL.len());
        let error = drivor.load(own).err().expect("it is not there").to_string();
        assert!(error.contains("mine/drivor.safetensors") && error.contains("train policy --kind drivor"), "{error}");
    }
}
