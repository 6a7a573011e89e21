//! Choices about a drive that simulation, messages, settings and the command line name alike, each parsed once at the
//! border.

/// Which agents react, and to whom.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub enum AgentMode {
    /// All agents follow their log.
    LogReplay,
    /// Agents behind the ego follow it by IDM, the others their log.
    #[default]
    IdmBehindEgo,
    /// All agents with a route drive by IDM.
    IdmAll,
    /// The same; they change lanes, yield by right of way, and people on foot walk by themselves.
    Interactive,
}

impl AgentMode {
    /// All modes.
    pub const ALL: [Self; 4] = [Self::LogReplay, Self::IdmBehindEgo, Self::IdmAll, Self::Interactive];

    /// Returns the mode's name on the command line and in results.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::LogReplay => "log-replay",
            Self::IdmBehindEgo => "idm-behind-ego",
            Self::IdmAll => "idm-all",
            Self::Interactive => "interactive",
        }
    }

    /// Returns the mode of a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|mode| mode.name() == name)
    }
}

/// A built-in policy that sees the truth: it serves as a reference, and is refused where policies compete.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Anchor {
    /// Repeats the expert's recorded drive.
    LogReplay,
    /// Follows the route among others as they were recorded.
    RouteFollower,
    /// Follows the route behind whoever is in its way now.
    Idm,
    /// The same; where a collision comes nearer it brakes hard, 0.8 s late.
    Careful,
    /// Tries its plans in copies of the world.
    Expert,
}

impl Anchor {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::LogReplay, Self::RouteFollower, Self::Idm, Self::Careful, Self::Expert];

    /// Returns the policy's name on the command line, in messages and in results.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::LogReplay => "log-replay",
            Self::RouteFollower => "route-follower",
            Self::Idm => "idm",
            Self::Careful => "careful",
            Self::Expert => "expert",
        }
    }

    /// Returns the anchor of a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|anchor| anchor.name() == name)
    }

    /// Says whether it sees others as they are, not only as they were recorded.
    #[must_use]
    pub const fn sees_live(self) -> bool {
        matches!(self, Self::Idm | Self::Careful | Self::Expert)
    }
}

/// The controller that follows the plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TrackerKind {
    /// Linear-quadratic tracking of speed and lateral error over a 1 s preview, as in NAVSIM and nuPlan.
    #[default]
    Lqr,
    /// Pure pursuit of a point ahead on the plan, speed from its timing.
    PurePursuit,
}

impl TrackerKind {
    /// All trackers.
    pub const ALL: [Self; 2] = [Self::Lqr, Self::PurePursuit];

    /// Returns the tracker's name on the command line, in messages and in results.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Lqr => "lqr",
            Self::PurePursuit => "pure-pursuit",
        }
    }

    /// Returns the tracker of a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|tracker| tracker.name() == name)
    }
}

/// What renders layout images.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LayoutBackend {
    /// A hardware adapter if there is one, else the software rasteriser.
    #[default]
    Auto,
    /// The software rasteriser.
    Cpu,
    /// Any Vulkan or GL adapter, software ones too.
    Wgpu,
}

impl LayoutBackend {
    /// All back ends.
    pub const ALL: [Self; 3] = [Self::Auto, Self::Cpu, Self::Wgpu];

    /// Returns the back end's name on the command line and in messages.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Cpu => "cpu",
            Self::Wgpu => "wgpu",
        }
    }

    /// Returns the back end of a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|backend| backend.name() == name)
    }
}
