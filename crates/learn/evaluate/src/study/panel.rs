//! The panel: policies that say what they attend to, with the digest of their weights.

use std::error::Error;
use std::path::Path;

use ds_nn::Weights;
use ds_nn::safetensors::WeightsFile;
use ds_policy::{Context, Learned, Own, Policy};
use ds_raster::RgbImage;
use ds_space::{CameraModel, Digest};

use super::config::{MemberConfig, StudyConfig};
use crate::error::AppraisalError;

/// A policy of the panel.
pub(crate) struct Member {
    pub(crate) name: String,
    pub(crate) control: bool,
    pub(crate) policy: Box<dyn Policy>,
    pub(crate) digest: Digest,
}

impl Member {
    /// Returns what the policy attends to in one frame; `whose` names the frames in errors.
    ///
    /// # Errors
    /// If it cannot look at the frame or tells of nothing that it attends to.
    pub(crate) fn context(
        &mut self,
        camera: &CameraModel,
        frame: &RgbImage,
        whose: &str,
    ) -> Result<Context, AppraisalError> {
        let seen = self.policy.context(std::slice::from_ref(camera), std::slice::from_ref(frame));
        let refuse = |source| AppraisalError::Policy { policy: self.name.clone(), frames: whose.to_owned(), source };
        seen.map_err(refuse)?
            .ok_or_else(|| AppraisalError::config(format!("panel.{}", self.name), "the policy tells of no features"))
    }
}

/// Loads the panel of a study.
///
/// # Errors
/// If a policy has no features of frames alone, or its weights cannot be used.
pub(crate) fn load(config: &StudyConfig) -> Result<Vec<Member>, AppraisalError> {
    let one = |member: &MemberConfig| {
        if let Some(manifest) = Own::named(&member.policy) {
            return own(config, member, &manifest);
        }
        let learned = Learned::of(&member.policy).ok_or_else(|| {
            let known = Learned::ALL.map(Learned::name).join(", ");
            let rule = format!(
                "policy {:?} tells of no features; {known} do, and an ONNX network by its manifest",
                member.policy
            );
            AppraisalError::config(format!("panel.{}", member.name), rule)
        })?;
        let refuse = |error: &dyn std::fmt::Display| {
            AppraisalError::config(format!("panel.{}.weights", member.name), error.to_string())
        };
        let weights = match &member.weights {
            Some(path) => {
                let path = config.path(path);
                WeightsFile::read(&path).map_err(|error| refuse(&format!("{}: {error}", path.display())))?.weights
            }
            None => Weights::initialised(&learned.declared(), &Digest::of(member.name.as_bytes())),
        };
        let policy = learned.policy(&weights).map_err(|error| refuse(&error))?;
        let (name, control) = (member.name.clone(), member.control);
        Ok(Member { name, control, policy, digest: weights.digest() })
    };
    config.panel.iter().map(one).collect()
}

/// Loads a network of others.
fn own(config: &StudyConfig, member: &MemberConfig, manifest: &Path) -> Result<Member, AppraisalError> {
    let refuse = |field: &str, rule: &str| {
        Err(AppraisalError::config(format!("panel.{}.{field}", member.name), format!("{}: {rule}", manifest.display())))
    };
    if member.weights.is_some() {
        return refuse("weights", "a manifest names its network");
    }
    let own = match Own::read(&config.path(manifest)) {
        Ok(own) if own.has_feature() => own,
        Ok(_) => return refuse("policy", "tells of no features: its manifest has no [feature]"),
        Err(error) => {
            let cause = error.source().map(|source| format!(": {source}")).unwrap_or_default();
            return refuse("policy", &format!("{error}{cause}"));
        }
    };
    let (name, control, digest) = (member.name.clone(), member.control, *own.digest());
    Ok(Member { name, control, policy: Box::new(own), digest })
}
