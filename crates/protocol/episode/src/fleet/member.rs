//! What instances say of themselves, and what the fleet answers.

use ds_space::{AttemptId, EpisodeId, InstanceId};
use ds_topic::{Owner, Role};

use crate::clock::Millis;

/// The digest or name of all that may change a result's bits; fail-over stays within one.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ComputeClass(pub String);

/// What an instance says when it joins. It holds nothing then: it dropped all earlier work before.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Hello {
    /// Unique to the started process.
    pub instance: InstanceId,
    /// What it can do.
    pub role: Role,
    /// How many episodes it can hold.
    pub slots: u32,
    /// Devices that it sees, any of which it could use; empty if it needs none.
    pub devices: Vec<String>,
    /// Whether it may use a device that another instance holds.
    pub shares_device: bool,
    /// Its compute class.
    pub class: ComputeClass,
}

/// The fleet took an instance in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Joined {
    /// The device that it shall use; `None` if it named none.
    pub device: Option<String>,
    /// The length of leases.
    pub lease_ms: u64,
    /// The orchestrator's term.
    pub term: u64,
    /// Roles that it held before, now free.
    pub lost: Vec<Lost>,
}

/// A role that an instance no longer holds.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Lost {
    /// The episode.
    pub episode: EpisodeId,
    /// The role.
    pub role: Role,
    /// Who held it, in which epoch.
    pub owner: Owner,
    /// Why it is free.
    pub cause: LossCause,
}

/// Why a role became free.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum LossCause {
    /// The lease and the margin passed without a renewal.
    Died,
    /// The instance said goodbye.
    Left,
    /// The instance joined again and so dropped what it held.
    Rejoined,
}

impl LossCause {
    /// Returns the cause's name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Died => "died",
            Self::Left => "left",
            Self::Rejoined => "rejoined",
        }
    }
}

/// What is to be held.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Request {
    /// The episode.
    pub episode: EpisodeId,
    /// The attempt at it.
    pub attempt: AttemptId,
    /// The role.
    pub role: Role,
    /// An instance that shall not get it.
    pub exclude: Option<InstanceId>,
}

/// A role was given to an instance.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Granted {
    /// What was asked for.
    pub request: Request,
    /// The holder and its epoch, in the ledger already.
    pub owner: Owner,
    /// The orchestrator's term.
    pub term: u64,
    /// The length of the lease.
    pub lease_ms: u64,
}

/// What is known of an instance.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Member {
    /// What it said.
    pub hello: Hello,
    /// The device that it uses.
    pub device: Option<String>,
    /// When it was last heard.
    pub heard: Millis,
    /// How many episodes it holds.
    pub held: u32,
    /// Whether it gets no further work, having failed different episodes.
    pub cordoned: bool,
    /// Whether it gets no further work, having said that it wants to leave.
    pub draining: bool,
}
