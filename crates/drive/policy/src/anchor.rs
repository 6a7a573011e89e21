//! Privileged policies as one kind: what each would drive in a state that it sees whole.

use ds_space::PoseSe2;

use crate::error::PolicyError;
use crate::observation::{Observation, PrivilegedView};
use crate::plan::PolicyAnswer;
use crate::{Policy, Restart};

/// A policy that plans from the scenario, not from frames, and remembers nothing that counts.
pub trait Anchored: Send {
    /// The policy's name.
    const NAME: &'static str;

    /// Returns world poses of the next ticks, one each.
    ///
    /// # Errors
    /// If the view lacks what the policy needs.
    fn driven(&mut self, view: &PrivilegedView, horizon_ticks: u32) -> Result<Vec<PoseSe2>, PolicyError>;
}

impl<A: Anchored> Policy for A {
    fn name(&self) -> &str {
        A::NAME
    }

    fn privileged(&self) -> bool {
        true
    }

    fn plan(
        &mut self,
        observation: &Observation,
        privileged: Option<&PrivilegedView>,
    ) -> Result<PolicyAnswer, PolicyError> {
        observation.check()?;
        let view = privileged.ok_or(PolicyError::NeedsPrivilege { name: A::NAME })?;
        let driven = self.driven(view, observation.horizon_ticks)?;
        view.answer(A::NAME, &driven, observation.dt)
    }

    fn restart(&self) -> Restart {
        Restart::Stateless
    }
}
