//! What a stage is told and what it asks for.

use std::collections::BTreeMap;

use bytes::Bytes;
use ds_space::{AttemptId, Digest, EpisodeId, Tick};
use ds_topic::{Advance, Envelope, Owner, Role, Slot};

use crate::clock::Millis;
use crate::fault::Fault;

/// What the orchestrator assigned to this instance.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Assignment {
    /// The episode.
    pub episode: EpisodeId,
    /// The attempt at it.
    pub attempt: AttemptId,
    /// The role.
    pub role: Role,
    /// This instance and its epoch.
    pub owner: Owner,
    /// The orchestrator's term.
    pub term: u64,
    /// When the lease runs out by the own clock, unless renewed.
    pub lease_until: Millis,
}

/// Who is asked for a missing message.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub enum PullFrom {
    /// The holder of the role that makes it.
    Owner(Owner),
    /// The orchestrator, who holds orders, scenes and the journal.
    Journal,
}

/// One message as a maker hands it over.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Output {
    /// Its place in the episode.
    pub slot: Slot,
    /// The tick that it describes.
    pub tick: Tick,
    /// Digest over its decoded fields.
    pub content: Digest,
    /// Its encoded body.
    pub body: Bytes,
}

/// What a stage is told.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// A message was pushed to it.
    Message(Envelope),
    /// A pull ended: with the message, or with nothing (none there, timed out, failed).
    Pulled {
        /// What was asked for.
        slot: Slot,
        /// Who was asked.
        from: PullFrom,
        /// What came.
        reply: Option<Envelope>,
    },
    /// Someone asks for one of its messages.
    Asked {
        /// Names the question in the answer.
        query: u64,
        /// What is asked for.
        slot: Slot,
    },
    /// The maker ended a restore.
    Restored {
        /// Content digest of the order that it was for.
        order: Digest,
        /// The outcome.
        result: Result<(), Fault>,
    },
    /// The maker ended its work.
    Worked {
        /// Content digest of the order that it was for.
        order: Digest,
        /// All outputs due, or what went wrong.
        result: Result<Vec<Output>, Fault>,
    },
    /// The orchestrator renewed the lease.
    LeaseRenewed {
        /// The own clock when the renewed heartbeat was sent, plus the lease.
        until: Millis,
    },
    /// Take no further orders.
    Drain,
    /// Time passed.
    Now,
}

/// Why a stage ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum StopReason {
    /// An order names a later holder of the role.
    Superseded(Owner),
    /// It was told to drain and has handed over.
    Drained,
}

/// What a stage wants done, in this order.
#[derive(Debug, Clone, PartialEq)]
pub enum Action {
    /// Push a message to everybody.
    Publish(Envelope),
    /// Ask for a message; report the outcome as [`Event::Pulled`] in any case.
    Pull {
        /// What.
        slot: Slot,
        /// From whom.
        from: PullFrom,
    },
    /// Answer a question of [`Event::Asked`].
    Answer {
        /// Which.
        query: u64,
        /// The message, or nothing.
        reply: Option<Envelope>,
    },
    /// Make the maker's state as it was before the order, from the scene and the inputs alone; then [`Event::Restored`].
    Restore {
        /// The scene.
        scene: Envelope,
        /// What [`crate::due::restore_inputs`] lists.
        inputs: BTreeMap<Slot, Envelope>,
        /// The order to come.
        advance: Advance,
    },
    /// Work on an order; then [`Event::Worked`]. Never sent twice for one state.
    Work {
        /// The order.
        advance: Advance,
        /// What [`crate::due::inputs`] lists.
        inputs: BTreeMap<Slot, Envelope>,
    },
    /// Tell the orchestrator that orders may come.
    Ready {
        /// The own epoch.
        epoch: u64,
    },
    /// Tell the orchestrator of a fault.
    Report(Fault),
    /// End; nothing is done after it.
    Stop(StopReason),
}
