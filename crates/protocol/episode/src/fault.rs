//! Named faults and their classes. `infrastructure` is retried elsewhere, `deterministic` would fail again and ends the
//! attempt, `policy` ends the episode by rule.

use std::fmt;

/// What follows from a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum FaultClass {
    /// Death, lost lease, memory: another instance takes over.
    Infrastructure,
    /// Bad input, NaN, divergence: would happen again.
    Deterministic,
    /// The policy under test broke a rule.
    Policy,
}

impl FaultClass {
    /// All classes.
    pub const ALL: [Self; 3] = [Self::Infrastructure, Self::Deterministic, Self::Policy];

    /// Returns the class's name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Infrastructure => "infrastructure",
            Self::Deterministic => "deterministic",
            Self::Policy => "policy",
        }
    }

    /// Returns the class of a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|class| class.name() == name)
    }
}

/// Something that went wrong: a class, a stable name such as `wrong_border`, and details.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub struct Fault {
    /// What follows from it.
    pub class: FaultClass,
    /// Stable, lower case with underscores.
    pub name: String,
    /// The offending values.
    pub detail: String,
}

impl Fault {
    /// Two orders for one iteration.
    pub const CONFLICTING_ADVANCE: &'static str = "conflicting_advance";
    /// An order that starts from another state than the own.
    pub const WRONG_BORDER: &'static str = "wrong_border";
    /// Two messages of one slot with different content.
    pub const DIVERGENT_DUPLICATE: &'static str = "divergent_duplicate";
    /// A message that cannot be read or contradicts the settings.
    pub const BAD_MESSAGE: &'static str = "bad_message";
    /// A maker answered other slots than those due.
    pub const WRONG_OUTPUTS: &'static str = "wrong_outputs";
    /// A replayed state differs from the journalled digests; makers report it on restore.
    pub const RECOVERY_MISMATCH: &'static str = "recovery_mismatch";
    /// A plan that cannot be followed.
    pub const PLAN_REFUSED: &'static str = "plan_refused";

    /// Makes a fault of any class.
    #[must_use]
    pub fn new(class: FaultClass, name: &str, detail: impl fmt::Display) -> Self {
        Self { class, name: name.to_owned(), detail: detail.to_string() }
    }

    /// Makes a fault that would happen again.
    #[must_use]
    pub fn deterministic(name: &str, detail: impl fmt::Display) -> Self {
        Self::new(FaultClass::Deterministic, name, detail)
    }

    /// Makes a fault that another instance may not have.
    #[must_use]
    pub fn infrastructure(name: &str, detail: impl fmt::Display) -> Self {
        Self::new(FaultClass::Infrastructure, name, detail)
    }

    /// Makes a fault of the policy under test.
    #[must_use]
    pub fn policy(name: &str, detail: impl fmt::Display) -> Self {
        Self::new(FaultClass::Policy, name, detail)
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.name, self.detail)
    }
}
