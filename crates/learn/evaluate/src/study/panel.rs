//! The panel: policies that say what they attend to, with the digest of their weights.

use ds_graph::panel::Kind;
use ds_nn::Weights;
use ds_nn::safetensors::WeightsFile;
use ds_policy::Policy;
use ds_policy::camera::{self, CameraPolicy};
use ds_policy::panel::PanelPolicy;
use ds_space::Digest;

use super::config::FidelityConfig;
use crate::error::AppraisalError;

/// A policy of the panel.
pub(crate) struct Member {
    pub(crate) name: String,
    pub(crate) control: bool,
    pub(crate) policy: Box<dyn Policy>,
    pub(crate) digest: Digest,
}

/// Loads the panel of a study.
///
/// # Errors
/// If a policy has no features of frames alone, or its weights cannot be used.
pub(crate) fn load(config: &FidelityConfig) -> Result<Vec<Member>, AppraisalError> {
    let one = |member: &super::config::MemberConfig| {
        let kind = Kind::of(&member.policy);
        if kind.is_none() && member.policy != camera::NAME {
            let known = Kind::ALL.map(Kind::name).join(", ");
            let rule = format!("policy {:?} tells of no features; {} and {known} do", member.policy, camera::NAME);
            return Err(AppraisalError::config(format!("panel.{}", member.name), rule));
        }
        let refuse = |error: &dyn std::fmt::Display| {
            AppraisalError::config(format!("panel.{}.weights", member.name), error.to_string())
        };
        let weights = match &member.weights {
            Some(path) => {
                let path = config.path(path);
                WeightsFile::read(&path).map_err(|error| refuse(&format!("{}: {error}", path.display())))?.weights
            }
            None => {
                let declared = kind.map_or_else(|| camera::SIZE.declared(), Kind::declared);
                Weights::initialised(&declared, &Digest::of(member.name.as_bytes()))
            }
        };
        let policy: Box<dyn Policy> = match kind {
            None => Box::new(CameraPolicy::new(&weights).map_err(|error| refuse(&error))?),
            Some(kind) => Box::new(PanelPolicy::new(kind, &weights).map_err(|error| refuse(&error))?),
        };
        let (name, control) = (member.name.clone(), member.control);
        Ok(Member { name, control, policy, digest: weights.digest() })
    };
    config.panel.iter().map(one).collect()
}
