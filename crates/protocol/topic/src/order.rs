//! The work order: which ticks are due, from which border state, made by whom.

use std::collections::BTreeMap;
use std::fmt;

use ds_space::{Digest, DigestWriter, InstanceId, Tick};
use ds_world::{Proposal, Trajectory};

/// The stages of the loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Role {
    /// sim-server: advance → world, ego.
    Sim,
    /// layout-render: world → layout.
    Layout,
    /// vdm-worker: layout → frame, cache.
    Video,
    /// policy-bridge: frame, ego → plan.
    Policy,
}

impl Role {
    /// All roles in loop order.
    pub const ALL: [Self; 4] = [Self::Sim, Self::Layout, Self::Video, Self::Policy];

    /// Returns the role's name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Sim => "sim",
            Self::Layout => "layout",
            Self::Video => "video",
            Self::Policy => "policy",
        }
    }

    /// Returns the role of a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|role| role.name() == name)
    }
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The instance that holds a role of an episode, and the epoch of its lease.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Owner {
    /// The instance.
    pub instance: InstanceId,
    /// Raised in the ledger before each assignment.
    pub epoch: u64,
}

/// What moves the ego during an iteration.
#[derive(Debug, Clone, PartialEq)]
pub enum Motion {
    /// Nothing: iteration 0 only renders the initial state.
    Initial,
    /// The logged drive (warm-up).
    Log,
    /// The policy's trajectory, in the rig frame at the border tick.
    Plan(Trajectory),
    /// The policy's proposals, in the rig frame at the border tick, at least one: the simulator drives the best.
    Choice(Vec<Proposal>),
}

/// The work order of one iteration, body of the `advance` topic.
///
/// Iteration 0 covers the start tick alone; iteration i > 0 covers the next Δr ticks (fewer at the end).
#[derive(Debug, Clone, PartialEq)]
pub struct Advance {
    /// The iteration, from 0.
    pub iteration: u32,
    /// The first tick to make.
    pub first: Tick,
    /// The last tick to make.
    pub last: Tick,
    /// What moves the ego.
    pub motion: Motion,
    /// Content digest of the `world` message at the tick before `first`; zero in iteration 0.
    pub border: Digest,
    /// Whether the policy must answer after the last tick (false in the last iteration).
    pub plan_due: bool,
    /// Who holds each role; not part of the order's identity.
    pub owners: BTreeMap<Role, Owner>,
}

impl Advance {
    /// Returns the digest of what is ordered, without who does it: two orders of one iteration must agree in it.
    #[must_use]
    pub fn content(&self) -> Digest {
        let mut writer = DigestWriter::new();
        writer.u32(self.iteration).u32(self.first.0).u32(self.last.0).bool(self.plan_due).digest(&self.border);
        match &self.motion {
            Motion::Initial => writer.u32(0),
            Motion::Log => writer.u32(1),
            Motion::Plan(plan) => {
                writer.u32(2);
                crate::body::digest_trajectory(&mut writer, plan);
                &mut writer
            }
            Motion::Choice(proposals) => {
                writer.u32(3).u64(proposals.len() as u64);
                for proposal in proposals {
                    crate::body::digest_trajectory(&mut writer, &proposal.trajectory);
                    writer.f64(proposal.score);
                }
                &mut writer
            }
        };
        writer.finish()
    }
}
