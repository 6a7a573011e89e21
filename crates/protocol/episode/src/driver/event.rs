//! What a driver is told and what it asks for.

use bytes::Bytes;
use ds_space::{Digest, InstanceId, Tick};
use ds_topic::{Envelope, Owner, Role, Slot};

use crate::fault::{Fault, FaultClass};

/// What a driver is told.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// Begin, or go on after a resume.
    Start,
    /// A role was given to an instance.
    Assigned {
        /// The role.
        role: Role,
        /// Its holder.
        owner: Owner,
    },
    /// A role cannot be given to anybody, now or later.
    Unassignable {
        /// The role.
        role: Role,
        /// A named reason, such as `quarantined`.
        fault: Fault,
    },
    /// A holder has the scene and waits for orders.
    ReadyBy {
        /// The role.
        role: Role,
        /// The epoch of its holder.
        epoch: u64,
    },
    /// A holder is gone: its lease ran out with the margin, or it left.
    Lost {
        /// The role.
        role: Role,
        /// The epoch that ended.
        epoch: u64,
        /// Why, for the event topic.
        reason: String,
    },
    /// A holder reports a fault.
    Faulted {
        /// The role.
        role: Role,
        /// The epoch of its holder.
        epoch: u64,
        /// The fault.
        fault: Fault,
    },
    /// A message was pushed.
    Message(Envelope),
    /// A pull ended, with the message or with nothing.
    Pulled {
        /// What was asked for.
        slot: Slot,
        /// What came.
        reply: Option<Envelope>,
    },
    /// Someone asks for a message of the journal, an order or the scene.
    Asked {
        /// Names the question in the answer.
        query: u64,
        /// What is asked for.
        slot: Slot,
    },
    /// The journal holds an iteration durably.
    Journalled {
        /// Which.
        iteration: u32,
    },
    /// The journal or the ledger refused this term: another orchestrator is in charge.
    Fenced {
        /// The term in charge.
        term: u64,
    },
    /// The scorer's answer to observed states.
    Scored {
        /// The last observed tick.
        tick: Tick,
        /// Digest of the score's fields.
        content: Digest,
        /// The encoded score.
        body: Bytes,
    },
    /// End the attempt.
    Cancel,
    /// Time passed.
    Now,
}

/// How an attempt ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Status {
    /// All ticks were driven.
    Completed,
    /// It ended by rule (policy), or cannot go on (deterministic).
    Failed,
    /// It was cancelled, ran out of time, or of instances.
    Aborted,
}

impl Status {
    /// Returns the status's name in results.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Completed => "completed",
            Self::Failed => "failed",
            Self::Aborted => "aborted",
        }
    }
}

/// The end of an attempt.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ending {
    /// The status.
    pub status: Status,
    /// A stable name, then details; empty when completed.
    pub reason: String,
    /// The class of the fault behind it; `Some(Infrastructure)` may be tried again as a new attempt.
    pub class: Option<FaultClass>,
    /// Iterations that are committed.
    pub committed: u32,
}

/// What a driver wants done, in this order.
#[derive(Debug, Clone, PartialEq)]
pub enum Action {
    /// Push a message to everybody (and record it, if it is an `event` or a `score`).
    Publish(Envelope),
    /// Ask the holder of a role for a message; report the outcome as [`Event::Pulled`] in any case.
    Pull {
        /// What.
        slot: Slot,
        /// From whom.
        owner: Owner,
    },
    /// Answer a question of [`Event::Asked`].
    Answer {
        /// Which.
        query: u64,
        /// The message, or nothing.
        reply: Option<Envelope>,
    },
    /// Answer a question of [`Event::Asked`] from the committed journal.
    Lookup {
        /// Which.
        query: u64,
        /// What is asked for.
        slot: Slot,
    },
    /// Append the messages of an iteration to the journal in this order, sync it; then [`Event::Journalled`].
    Commit {
        /// Which.
        iteration: u32,
        /// The scene (iteration 0), the order, then all outputs in slot order.
        messages: Vec<Envelope>,
    },
    /// Give a role to an instance; asked again while it stays vacant.
    Want {
        /// The role.
        role: Role,
        /// An instance that failed in it here.
        exclude: Option<InstanceId>,
    },
    /// Take a role away from an instance that reported a fault.
    Dismiss {
        /// The role.
        role: Role,
        /// Who failed.
        owner: Owner,
        /// How.
        fault: Fault,
    },
    /// Score a committed `world` message; they come in tick order, each once (after a resume from the first on).
    Observe(Envelope),
    /// The attempt ended; release all roles. Questions are still answered.
    Finish(Ending),
    /// Another orchestrator with a higher term is in charge: do nothing more.
    StepDown {
        /// The higher term.
        term: u64,
    },
}

/// A message that an iteration still lacks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Awaited {
    /// Which.
    pub slot: Slot,
    /// From whom; `None` while the role is vacant.
    pub owner: Option<Owner>,
    /// For how long, in milliseconds.
    pub for_ms: u64,
}
