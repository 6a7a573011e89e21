//! Delays and limits of the protocol, in milliseconds. They decide when to ask again and when to give up; no value that
//! an episode produces depends on them.

/// Delays and limits, the same for stages and driver.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Timing {
    /// After how long a missing message is asked for; doubles up to eight times while it stays away.
    pub pull_after_ms: u64,
    /// How often orders, scenes, readiness and faults are repeated.
    pub repeat_after_ms: u64,
    /// How long an iteration may take while all roles are held.
    pub iteration_deadline_ms: u64,
    /// How long a role may stay without a ready holder.
    pub vacancy_deadline_ms: u64,
    /// How often roles may change hands in an attempt.
    pub max_reassignments: u64,
}

impl Default for Timing {
    fn default() -> Self {
        Self {
            pull_after_ms: 200,
            repeat_after_ms: 1_000,
            iteration_deadline_ms: 300_000,
            vacancy_deadline_ms: 120_000,
            max_reassignments: 16,
        }
    }
}
