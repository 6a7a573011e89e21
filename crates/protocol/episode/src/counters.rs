//! What a machine counts, so that nothing is dropped in silence.

/// Counts since the machine was made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counters {
    /// Messages that were asked for.
    pub pulls: u64,
    /// Sequence numbers that were skipped by pushes (lost or overtaken).
    pub gaps: u64,
    /// Messages that were there already, with equal content.
    pub duplicates: u64,
    /// Messages refused because their epoch or publisher is not the assigned one.
    pub refused_epochs: u64,
    /// Orders refused because a higher term is known.
    pub refused_terms: u64,
    /// Orders that were sent (driver) or seen (stage) again.
    pub repeats: u64,
    /// Messages dropped because the inbox was full or they lie beyond it; pulled later.
    pub dropped: u64,
    /// Messages of another episode, attempt or schema version.
    pub foreign: u64,
    /// Plans that came after one was accepted, from a later epoch, with other content (the first is final).
    pub superseded_plans: u64,
    /// Outputs that were made while the lease had run out.
    pub withheld: u64,
    /// Roles given to another instance.
    pub reassignments: u64,
}
