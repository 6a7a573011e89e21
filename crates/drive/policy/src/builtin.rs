//! The built-in policies by name.

use std::path::PathBuf;

use crate::Policy;
use crate::camera::{self, CameraPolicy};
use crate::constant_velocity::{self, ConstantVelocity};
use crate::error::PolicyError;
use crate::lattice::{self, Lattice};
use crate::log_replay::{self, LogReplay};
use crate::route_follower::{self, RouteFollower};

/// The built-in policies' names, and whether each is privileged.
pub const NAMES: [(&str, bool); 5] = [
    (camera::NAME, false),
    (constant_velocity::NAME, false),
    (lattice::NAME, false),
    (log_replay::NAME, true),
    (route_follower::NAME, true),
];

/// What a built-in policy may need besides its name.
#[derive(Debug, Clone, Default)]
pub struct Builtin {
    /// The safetensors file of the `camera` policy.
    pub camera_weights: Option<PathBuf>,
}

/// Makes a built-in policy.
///
/// # Errors
/// [`PolicyError`] lists the known names, or says what is wrong with the weights.
pub fn builtin(name: &str, needs: &Builtin) -> Result<Box<dyn Policy>, PolicyError> {
    match name {
        camera::NAME => {
            let path = needs.camera_weights.as_ref().ok_or(PolicyError::NeedsWeights { name: camera::NAME })?;
            Ok(Box::new(CameraPolicy::load(path)?))
        }
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
                Err(error) => assert!(matches!(error, PolicyError::NeedsWeights { name: "camera" }), "{error}"),
            }
        }
        let error = builtin("camra", &Builtin::default()).err().expect("no such policy").to_string();
        assert!(error.contains("camra") && error.contains("constant-velocity"), "{error}");
    }
}
