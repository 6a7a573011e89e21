//! The built-in policies by name.

use std::path::PathBuf;

use ds_world::Anchor;

use crate::Policy;
use crate::careful::Careful;
use crate::constant_velocity::{self, ConstantVelocity};
use crate::error::PolicyError;
use crate::idm::Idm;
use crate::lattice::{self, Lattice};
use crate::learned::Learned;
use crate::log_replay::LogReplay;
use crate::route_follower::RouteFollower;

/// The built-in policies' names, and whether each is privileged.
pub const NAMES: [(&str, bool); 14] = [
    ("camera", false),
    (Anchor::Careful.name(), true),
    (constant_velocity::NAME, false),
    ("diffusiondrive", false),
    ("diffusiondrive_v2", false),
    ("drivor", false),
    (Anchor::Expert.name(), true),
    (Anchor::Idm.name(), true),
    (lattice::NAME, false),
    (Anchor::LogReplay.name(), true),
    ("ltf", false),
    ("rap", false),
    (Anchor::RouteFollower.name(), true),
    ("sparsedrive", false),
];

/// Says whether a policy of this name is built in.
#[must_use]
pub fn is_builtin(name: &str) -> bool {
    NAMES.iter().any(|(known, _)| *known == name)
}

/// What a built-in policy may need besides its name.
#[derive(Debug, Clone, Default)]
pub struct Builtin {
    /// The safetensors file of the policy, or of the `camera` policy: see [`Learned::weights_file`].
    pub weights: Option<PathBuf>,
}

/// Makes a built-in policy.
///
/// # Errors
/// [`PolicyError`] lists the known names, or says what is wrong with the weights.
pub fn builtin(name: &str, needs: &Builtin) -> Result<Box<dyn Policy>, PolicyError> {
    if let Some(learned) = Learned::of(name) {
        let given = needs.weights.as_deref().ok_or(PolicyError::NeedsWeights { name: learned.name() })?;
        return learned.load(&learned.weights_file(given));
    }
    match (name, Anchor::from_name(name)) {
        (constant_velocity::NAME, _) => Ok(Box::new(ConstantVelocity)),
        (lattice::NAME, _) => Ok(Box::new(Lattice)),
        (_, Some(Anchor::LogReplay)) => Ok(Box::new(LogReplay)),
        (_, Some(Anchor::RouteFollower)) => Ok(Box::new(RouteFollower::default())),
        (_, Some(Anchor::Idm)) => Ok(Box::new(Idm::default())),
        (_, Some(Anchor::Careful)) => Ok(Box::new(Careful::default())),
        (_, Some(expert @ Anchor::Expert)) => Err(PolicyError::NeedsSimulator { name: expert.name() }),
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
                Err(PolicyError::NeedsWeights { name: asked } | PolicyError::NeedsSimulator { name: asked }) => {
                    assert_eq!(asked, name);
                }
                Err(error) => panic!("{name}: {error}"),
            }
        }
        assert!(Anchor::ALL.iter().all(|anchor| NAMES.contains(&(anchor.name(), true))));
        assert!(Learned::ALL.iter().all(|learned| NAMES.contains(&(learned.name(), false))));
        let error = builtin("camra", &Builtin::default()).err().expect("no such policy").to_string();
        assert!(error.contains("camra") && error.contains("constant-velocity"), "{error}");
    }
}
