//! The panel: policies that say what they attend to, with the digest of their weights, or of what a guest answers.

use std::error::Error;
use std::path::Path;

use ds_nn::Weights;
use ds_nn::safetensors::WeightsFile;
use ds_policy::builtin::is_builtin;
use ds_policy::{Context, EgoView, Learned, Observation, Own, Policy};
use ds_raster::RgbImage;
use ds_space::{CameraModel, Digest, DigestWriter, Draws, SimTime};
use ds_world::{EgoState, RouteCommand};

use super::config::{MemberConfig, StudyConfig};
use crate::error::EvaluationError;

/// How far the plan reaches that a guest is asked for at first, in ticks of 0.1 s.
const HORIZON_TICKS: u32 = 80;

/// Returns the policy of a name that connects to an endpoint.
pub type Guests<'a> = dyn Fn(&str, &str) -> Result<Box<dyn Policy>, Box<dyn Error + Send + Sync>> + 'a;

/// A policy of the panel.
pub(crate) struct Member {
    pub(crate) name: String,
    pub(crate) control: bool,
    pub(crate) policy: Box<dyn Policy>,
    /// Of its weights; of a guest, of what it answered to [`Member::greet`].
    pub(crate) digest: Digest,
    pub(crate) guest: bool,
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
    ) -> Result<Context, EvaluationError> {
        let seen = self.policy.context(std::slice::from_ref(camera), std::slice::from_ref(frame));
        let refuse = |source| EvaluationError::Policy { policy: self.name.clone(), frames: whose.to_owned(), source };
        seen.map_err(refuse)?.ok_or_else(|| self.tells_nothing())
    }

    fn tells_nothing(&self) -> EvaluationError {
        EvaluationError::config(format!("panel.{}", self.name), "the policy tells of no features")
    }

    /// Asks a guest for one frame: what it answers names its features, as its weights are its own affair.
    ///
    /// # Errors
    /// As of [`Member::context`].
    pub(crate) fn greet(&mut self, camera: &CameraModel, frame: &RgbImage, whose: &str) -> Result<(), EvaluationError> {
        let shown = Observation {
            frames: vec![vec![frame.clone()]],
            cameras: vec![camera.clone()],
            ego: EgoView::of(&[EgoState::default()]),
            command: RouteCommand::Straight,
            stamps: vec![SimTime(0)],
            horizon_ticks: HORIZON_TICKS,
            dt: SimTime::from_secs(0.1),
            draw: Draws::from_seed(0, "study guest"),
        };
        let answer = self.policy.plan(&shown, None);
        let refuse = |source| EvaluationError::Policy { policy: self.name.clone(), frames: whose.to_owned(), source };
        let answer = answer.map_err(refuse)?;
        let told = answer.context.ok_or_else(|| self.tells_nothing())?;
        let mut writer = DigestWriter::new();
        writer.text("study guest");
        told.tokens.digest_into(&mut writer);
        for point in answer.trajectory.points() {
            writer.u64(point.after.0.unsigned_abs()).f64s(&[
                point.pose.position.x,
                point.pose.position.y,
                point.pose.heading_rad,
            ]);
        }
        self.digest = writer.finish();
        Ok(())
    }
}

/// Loads the panel of a study.
///
/// # Errors
/// If a policy has no features of frames alone, or its weights cannot be used.
pub(crate) fn load(config: &StudyConfig, guests: &Guests<'_>) -> Result<Vec<Member>, EvaluationError> {
    let one = |member: &MemberConfig| {
        if let Some(listen) = &member.listen {
            return guest(member, listen, guests);
        }
        if let Some(manifest) = Own::named(&member.policy) {
            return own(config, member, &manifest);
        }
        let learned = Learned::of(&member.policy).ok_or_else(|| {
            let known = Learned::ALL.map(Learned::name).join(", ");
            let rule = format!(
                "policy {:?} tells of no features; {known} do, an ONNX network by its manifest, and one that connects to `listen`",
                member.policy
            );
            EvaluationError::config(format!("panel.{}", member.name), rule)
        })?;
        let refuse = |error: &dyn std::fmt::Display| {
            EvaluationError::config(format!("panel.{}.weights", member.name), error.to_string())
        };
        let weights = match &member.weights {
            Some(path) => {
                let path = config.path(path);
                learned.trained(&path).map_err(|error| refuse(&error))?;
                WeightsFile::read(&path).map_err(|error| refuse(&format!("{}: {error}", path.display())))?.weights
            }
            None => Weights::initialised(&learned.declared(), &Digest::of(member.name.as_bytes())),
        };
        let policy = learned.policy(&weights).map_err(|error| refuse(&error))?;
        let (name, control) = (member.name.clone(), member.control);
        Ok(Member { name, control, policy, digest: weights.digest(), guest: false })
    };
    config.panel.iter().map(one).collect()
}

/// Loads a network of others.
fn own(config: &StudyConfig, member: &MemberConfig, manifest: &Path) -> Result<Member, EvaluationError> {
    let refuse = |field: &str, rule: &str| {
        Err(EvaluationError::config(
            format!("panel.{}.{field}", member.name),
            format!("{}: {rule}", manifest.display()),
        ))
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
    Ok(Member { name, control, policy: Box::new(own), digest, guest: false })
}

/// Waits for a policy in another process.
fn guest(member: &MemberConfig, listen: &str, guests: &Guests<'_>) -> Result<Member, EvaluationError> {
    let refuse = |field: &str, rule: String| EvaluationError::config(format!("panel.{}.{field}", member.name), rule);
    if member.weights.is_some() {
        return Err(refuse("weights", "a policy that connects has its own".to_owned()));
    }
    if Own::named(&member.policy).is_some() || is_builtin(&member.policy) {
        return Err(refuse("listen", format!("{:?} runs inside, it does not connect", member.policy)));
    }
    let policy = guests(&member.policy, listen).map_err(|error| refuse("listen", error.to_string()))?;
    Ok(Member { name: member.name.clone(), control: member.control, policy, digest: Digest::default(), guest: true })
}
