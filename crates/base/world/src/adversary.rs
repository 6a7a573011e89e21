//! A road user that is meant to collide with the ego: what kind of collision it plans.
//!
//! It drives as planned until its attack; then, unless it is only replayed, it may spend a budget on meeting an ego that
//! does otherwise than its log. Classes are those of the NHTSA pre-crash typology (Najm 2007, Swanson 2019) between vehicles in traffic.

use ds_space::{AgentId, DVec2, Tick};

/// The kind of a collision between two vehicles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum CrashClass {
    /// The ego's front meets the rear of one that has driven ahead of it in its lane.
    RearEnd,
    /// The other comes from an adjacent lane of the same direction.
    ChangingLanes,
    /// The other comes towards the ego.
    OppositeDirection,
    /// Both go straight over a junction, across each other.
    StraightCrossingPaths,
    /// One turns across the way of the other, which goes straight over a junction: left in right-hand traffic.
    LeftTurnAcrossPath,
}

impl CrashClass {
    /// All classes.
    pub const ALL: [Self; 5] = [
        Self::RearEnd,
        Self::ChangingLanes,
        Self::OppositeDirection,
        Self::StraightCrossingPaths,
        Self::LeftTurnAcrossPath,
    ];

    /// Returns the name in files and on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::RearEnd => "rear-end",
            Self::ChangingLanes => "changing-lanes",
            Self::OppositeDirection => "opposite-direction",
            Self::StraightCrossingPaths => "straight-crossing-paths",
            Self::LeftTurnAcrossPath => "left-turn-across-path",
        }
    }

    /// Returns the class of a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|class| class.name() == name)
    }
}

/// What an adversary does about an ego that leaves its log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum AdversaryMode {
    /// Nothing: it drives as planned.
    Replay,
    /// It aims anew within its budget, and only as long as the ego can still avoid the contact.
    Reactive,
    /// It aims anew within its budget, whether or not the ego can avoid the contact.
    Unshielded,
}

impl AdversaryMode {
    /// All modes.
    pub const ALL: [Self; 3] = [Self::Replay, Self::Reactive, Self::Unshielded];

    /// Returns the name in files and on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Replay => "replay",
            Self::Reactive => "reactive",
            Self::Unshielded => "reactive-unshielded",
        }
    }

    /// Returns the mode of a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|mode| mode.name() == name)
    }
}

/// What an adversary may spend on its attack.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Budget {
    /// How long it attacks at most, in seconds.
    pub attack_secs: f64,
    /// Integral of |a − planned a| over time, in metres per second.
    pub effort_mps: f64,
    /// How far it leaves its corridor sideways, in metres.
    pub aside_m: f64,
    /// How often it aims anew.
    pub reaims: u32,
}

impl Default for Budget {
    fn default() -> Self {
        Self { attack_secs: 4.0, effort_mps: 12.0, aside_m: 3.75, reaims: 6 }
    }
}

/// A track that is meant to collide with the ego.
#[derive(Debug, Clone, PartialEq)]
pub struct Adversary {
    /// Its track, present at every tick: what it drives if nobody does otherwise than logged.
    pub track: AgentId,
    /// The planned kind of collision.
    pub class: CrashClass,
    /// What it does about an ego that leaves its log.
    pub mode: AdversaryMode,
    /// The tick from which it aims anew.
    pub attack: Tick,
    /// The tick of the planned contact, after the attack.
    pub contact: Tick,
    /// What it may spend.
    pub budget: Budget,
    /// The line along which it attacks, world frame, in metres; at least two points.
    pub corridor: Vec<DVec2>,
}
