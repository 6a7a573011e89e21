//! The built-in policies by name.

use std::path::{Path, PathBuf};

use ds_graph::panel::Kind;

use crate::Policy;
use crate::camera::{self, CameraPolicy};
use crate::constant_velocity::{self, ConstantVelocity};
use crate::error::PolicyError;
use crate::lattice::{self, Lattice};
use crate::log_replay::{self, LogReplay};
use crate::panel::PanelPolicy;
use crate::route_follower::{self, RouteFollower};

/// The built-in policies' names, and whether each is privileged.
pub const NAMES: [(&str, bool); 7] = [
    (camera::NAME, false),
    (constant_velocity::NAME, false),
    ("drivor", false),
    (lattice::NAME, false),
    (log_replay::NAME, true),
    ("ltf", false),
    (route_follower::NAME, true),
];

/// What a built-in policy may need besides its name.
#[derive(Debug, Clone, Default)]
pub struct Builtin {
    /// The safetensors file of the policy, or of the `camera` policy: see [`weights_file`].
    pub weights: Option<PathBuf>,
}

/// Returns where the weights of a policy of the panel are, `given` being the file that was named: that file if it is called
/// after the policy (`drivor.safetensors`), else `panel/NAME.safetensors` beside it.
#[must_use]
pub fn weights_file(kind: Kind, given: &Path) -> PathBuf {
    if given.file_stem().is_some_and(|stem| stem == kind.name()) {
        return given.to_owned();
    }
    given.with_file_name("panel").join(kind.name()).with_extension("safetensors")
}

/// Makes a built-in policy.
///
/// # Errors
/// [`PolicyError`] lists the known names, or says what is wrong with the weights.
pub fn builtin(name: &str, needs: &Builtin) -> Result<Box<dyn Policy>, PolicyError> {
    let weights = |name| needs.weights.as_deref().ok_or(PolicyError::NeedsWeights { name });
    if let Some(kind) = Kind::of(name) {
        return Ok(Box::new(PanelPolicy::load(kind, &weights_file(kind, weights(kind.name())?))?));
    }
    match name {
        camera::NAME => Ok(Box::new(CameraPolicy::load(weights(camera::NAME)?)?)),
        constant_velocity::NAME => Ok(Box::new(ConstantVelocity)),
        lattice::NAME => Ok(Box::new(Lattice)),
        log_replay::NAME => Ok(Box::new(LogReplay)),
        route_follower::NAME => Ok(Box::new(RouteFollower::default())),
        _ => {
            let known = NAMES.map(|(name, _)| format!("{name:?}")).join(", ");
            Err(PolicyError::Unknown { name: name.to_owned(), known })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_listed_name_is_made_or_says_what_it_needs() {
        for (name, privileged) in NAMES {
            match builtin(name, &Builtin::default()) {
                Ok(policy) => assert_eq!((policy.name(), policy.privileged()), (name, privileged)),
                Err(error) => assert!(matches!(error, PolicyError::NeedsWeights { name: asked } if asked == name)),
            }
        }
        assert!(Kind::ALL.iter().all(|kind| NAMES.contains(&(kind.name(), false))));
        let error = builtin("camra", &Builtin::default()).err().expect("no such policy").to_string();
        assert!(error.contains("camra") && error.contains("constant-velocity"), "{error}");
    }

    #[test]
    fn weights_of_the_panel_lie_beside_those_of_the_camera_policy() {
        let beside = weights_file(Kind::Drivor, Path::new("models/camera_policy.safetensors"));
        assert_eq!(beside, Path::new("models/panel/drivor.safetensors"));
        assert_eq!(
            weights_file(Kind::Drivor, Path::new("mine/drivor.safetensors")),
            Path::new("mine/drivor.safetensors")
        );
    }
}
