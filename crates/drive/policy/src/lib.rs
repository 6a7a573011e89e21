//! Policies: from what a car sees and knows of itself to a trajectory.
//!
//! One trait, [`Policy`], with the built-in policies behind [`builtin()`]. An unprivileged policy is handed an
//! [`Observation`] and nothing else: frames, calibration, stamps, its own motion and a route command; never the map, the
//! boxes of others, the absolute pose or the scenario's name. Privileged policies also get a [`PrivilegedView`]; they
//! serve as references and are refused in a benchmark.

pub mod anchor;
pub mod builtin;
pub mod camera;
pub mod careful;
pub mod constant_velocity;
pub mod doctor;
pub mod driver;
pub mod error;
mod grid;
pub mod idm;
pub mod lattice;
pub mod learned;
pub mod log_replay;
pub mod observation;
pub mod own;
pub mod panel;
pub mod plan;
pub mod route;
pub mod route_follower;

use ds_nn::Array;
use ds_raster::RgbImage;
use ds_space::CameraModel;

pub use builtin::{Builtin, builtin};
pub use error::PolicyError;
pub use grid::Grid;
pub use learned::Learned;
pub use observation::{EgoView, Live, Observation, PrivilegedView};
pub use own::Own;
pub use plan::PolicyAnswer;

/// What a policy needs after its process was replaced in the middle of an episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Restart {
    /// Nothing: each answer depends on its observation alone.
    Stateless,
    /// The episode must begin again.
    FromStart,
}

/// What a policy attends to of its frames: the keys of FDπ.
#[derive(Debug, Clone, PartialEq)]
pub struct Context {
    /// Tokens and channels: [T, C].
    pub tokens: Array,
    /// The grid that the tokens are places of, where they are.
    pub grid: Option<Grid>,
}

/// A driver: answers each observation with a trajectory in the rig frame at the newest frame.
pub trait Policy: Send {
    /// Returns the name under which the policy is listed and recorded.
    fn name(&self) -> &str;

    /// Says whether the policy sees what no real car could see.
    fn privileged(&self) -> bool;

    /// Plans from an observation; `privileged` is only ever given to a policy that declares itself privileged.
    ///
    /// # Errors
    /// [`PolicyError`] names what is wrong with the observation, the weights or the plan.
    fn plan(
        &mut self,
        observation: &Observation,
        privileged: Option<&PrivilegedView>,
    ) -> Result<PolicyAnswer, PolicyError>;

    /// Plans from several observations at once; none from a policy that is not made for it, or not for so many.
    ///
    /// # Errors
    /// As of [`Policy::plan`].
    fn plan_together(&mut self, _observations: &[&Observation]) -> Result<Option<Vec<PolicyAnswer>>, PolicyError> {
        Ok(None)
    }

    /// Returns what the policy attends to of the newest frame of each camera, before state or command enter; none for
    /// a policy that tells of nothing of the kind.
    ///
    /// # Errors
    /// [`PolicyError`] names what is wrong with cameras or frames.
    fn context(&mut self, _cameras: &[CameraModel], _frames: &[RgbImage]) -> Result<Option<Context>, PolicyError> {
        Ok(None)
    }

    /// Says what the policy needs after a restart.
    fn restart(&self) -> Restart;
}
