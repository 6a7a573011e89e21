//! The resolved specification of an episode: everything besides the scene that its result depends on.

use ds_space::{Digest, EpisodeId, Tick};
use ds_world::{AgentMode, Anchor, LayoutBackend, TrackerKind};

/// Which renderer makes the frames that the policy sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub enum ObservationSource {
    /// The autoregressive video model.
    #[default]
    Dreamstream,
    /// The rich renderer that stands in for a real camera.
    Reference,
    /// A plain game-engine look.
    SimRgb,
    /// The condition image itself.
    Layout,
    /// The video model with the transformer of a student whose teacher was not guided.
    DreamstreamNoGuidance,
    /// The video model with the clean latents of each chunk cached, not the noisy ones that it was trained with.
    DreamstreamCleanCache,
    /// The video model to which no layout is shown.
    DreamstreamNoLayout,
    /// The video model making each frame anew, without cache and decoder memory.
    PerFrame,
    /// The reference camera's frame of the log half a second ago, warped into the present view by its depth.
    Reprojected,
    /// The reference camera's frame of the log, whatever the ego does.
    Logged,
    /// The camera of the second world, which no training has seen.
    SecondCamera,
}

impl ObservationSource {
    /// All sources.
    pub const ALL: [Self; 11] = [
        Self::Dreamstream,
        Self::Reference,
        Self::SimRgb,
        Self::Layout,
        Self::DreamstreamNoGuidance,
        Self::DreamstreamCleanCache,
        Self::DreamstreamNoLayout,
        Self::PerFrame,
        Self::Reprojected,
        Self::Logged,
        Self::SecondCamera,
    ];

    /// Returns the source's name on the command line and in results.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Dreamstream => "dreamstream",
            Self::Reference => "reference",
            Self::SimRgb => "sim-rgb",
            Self::Layout => "layout",
            Self::DreamstreamNoGuidance => "dreamstream-no-guidance",
            Self::DreamstreamCleanCache => "dreamstream-clean-cache",
            Self::DreamstreamNoLayout => "dreamstream-no-layout",
            Self::PerFrame => "per-frame",
            Self::Reprojected => "reprojected",
            Self::Logged => "logged",
            Self::SecondCamera => "second-camera",
        }
    }

    /// Returns the source of a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|source| source.name() == name)
    }

    /// Says whether frames are made from the world state, not from the layout alone.
    #[must_use]
    pub fn needs_world(self) -> bool {
        matches!(self, Self::Reference | Self::SimRgb | Self::Reprojected | Self::Logged | Self::SecondCamera)
    }

    /// Says whether a video model makes the frames.
    #[must_use]
    pub fn is_generated(self) -> bool {
        self.has_cache() || self == Self::PerFrame
    }

    /// Says whether a condition, such as snow or night, changes the frames.
    #[must_use]
    pub fn has_look(self) -> bool {
        !matches!(self, Self::Layout | Self::SimRgb)
    }

    /// Says whether a video model makes the frames of what it made before, and keeps a `cache` log.
    #[must_use]
    pub fn has_cache(self) -> bool {
        matches!(
            self,
            Self::Dreamstream | Self::DreamstreamNoGuidance | Self::DreamstreamCleanCache | Self::DreamstreamNoLayout
        )
    }
}

/// What happens when Δr is not a multiple of the frames per chunk.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub enum ReplanAlignment {
    /// The partial chunk is generated, published, rolled back and generated again with the true layouts.
    #[default]
    Rollback,
    /// Δr must be a multiple; anything else is refused.
    Exact,
}

/// Who ranks the proposals of a plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub enum ProposalScorer {
    /// The policy itself: its answer is driven.
    #[default]
    Learned,
    /// The simulator: each proposal is rolled out in a copy of the world with reacting agents, the best one is driven.
    Oracle,
    /// The same in open loop: executed by the score's own tracker among agents that do not react.
    OracleNavsim,
}

impl ProposalScorer {
    /// All scorers.
    pub const ALL: [Self; 3] = [Self::Learned, Self::Oracle, Self::OracleNavsim];

    /// Returns the scorer's name on the command line and in results.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Learned => "learned",
            Self::Oracle => "oracle",
            Self::OracleNavsim => "oracle-navsim",
        }
    }

    /// Returns the scorer of a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|scorer| scorer.name() == name)
    }
}

/// Which definition of the driving score is used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub enum ScoreProfile {
    /// As the public closed-loop benchmark computes it, deviations included.
    #[default]
    Bridgesim,
    /// As its definition means it.
    Strict,
}

impl ScoreProfile {
    /// All profiles.
    pub const ALL: [Self; 2] = [Self::Bridgesim, Self::Strict];

    /// Returns the profile's name on the command line and in results.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Bridgesim => "bridgesim",
            Self::Strict => "strict",
        }
    }

    /// Returns the profile of a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|profile| profile.name() == name)
    }
}

/// An effect that the world of an episode has beyond the nominal one.
#[derive(Debug, Clone, PartialEq)]
pub struct SwitchedEffect {
    /// Its id in the library.
    pub id: String,
    /// One value per parameter, in reported units.
    pub values: Vec<f64>,
}

/// The settings of one episode, fully resolved.
#[derive(Debug, Clone, PartialEq)]
pub struct EpisodeSpec {
    /// The episode.
    pub episode: EpisodeId,
    /// The scenario's name.
    pub scenario: String,
    /// Digest of the scenario.
    pub scenario_digest: Digest,
    /// The policy's name.
    pub policy: String,
    /// The renderer of the frames.
    pub observation: ObservationSource,
    /// The look of the reference camera, such as `day` or `seed-17`.
    pub appearance: String,
    /// The seed of all draws.
    pub seed: u64,
    /// Δr: ticks executed of each plan; at least 1.
    pub replan_period: u32,
    /// H: length of a plan, in ticks.
    pub horizon: u32,
    /// K: frames that the policy sees; at least 1.
    pub history: u32,
    /// Iterations driven by the log before the policy takes over.
    pub warm_up: u32,
    /// The last tick of the episode.
    pub last_tick: Tick,
    /// Which agents react.
    pub agents: AgentMode,
    /// What follows the plan.
    pub tracker: TrackerKind,
    /// What renders layout images.
    pub layout_backend: LayoutBackend,
    /// Chunk alignment.
    pub alignment: ReplanAlignment,
    /// Ticks per committed chunk of the video model; 0 for sources without a cache.
    pub chunk_ticks: u32,
    /// Digest of the video model's configuration and weights; zero without one.
    pub video_model: Digest,
    /// Digest of the policy's weights; zero without any.
    pub policy_model: Digest,
    /// Digest over all of the run's settings.
    pub configuration: Digest,
    /// Who ranks the proposals of a plan.
    pub scorer: ProposalScorer,
    /// Which definition of the driving score is used.
    pub score_profile: ScoreProfile,
    /// Effects of the world; each service switches on those whose insertion point it owns.
    pub effects: Vec<SwitchedEffect>,
    /// Whether the car records itself between ticks.
    pub vehicle_log: bool,
    /// Ticks by which the frames that the policy sees are older than its plan.
    pub observation_delay: u32,
    /// Ticks before the last committed one whose layouts a fresh video worker needs too; 0 where none are remembered.
    pub layout_memory_ticks: u32,
    /// Whether layouts tell their geometry beside their picture.
    pub layout_geometry: bool,
    /// What the video model is told in words; empty where no video model runs.
    pub prompt: String,
    /// Whether the policy has the time of the wall clock for each plan: the result then depends on the machine.
    pub wall_clock: bool,
}

/// How far back a policy that sees the world remembers it, in ticks.
const WITNESSED_TICKS: u32 = 10;
/// The most that a spec may say of `layout_memory_ticks`.
pub const MAX_LAYOUT_MEMORY_TICKS: u32 = 512;

impl EpisodeSpec {
    /// Returns the settings of an episode that replays a scenario's log among recorded agents and shows layouts, all else as
    /// plain as can be: what others differ from.
    #[must_use]
    pub fn replay(episode: EpisodeId, scenario: &str, last_tick: Tick) -> Self {
        Self {
            episode,
            scenario: scenario.to_owned(),
            scenario_digest: Digest::default(),
            policy: Anchor::LogReplay.name().to_owned(),
            observation: ObservationSource::Layout,
            appearance: "day".to_owned(),
            seed: 1,
            replan_period: 5,
            horizon: 80,
            history: 1,
            warm_up: 0,
            last_tick,
            agents: AgentMode::LogReplay,
            tracker: TrackerKind::Lqr,
            layout_backend: LayoutBackend::Cpu,
            alignment: ReplanAlignment::Rollback,
            chunk_ticks: 0,
            video_model: Digest::default(),
            policy_model: Digest::default(),
            configuration: Digest::default(),
            scorer: ProposalScorer::default(),
            score_profile: ScoreProfile::default(),
            effects: Vec::new(),
            vehicle_log: false,
            observation_delay: 0,
            layout_memory_ticks: 0,
            layout_geometry: false,
            prompt: String::new(),
            wall_clock: false,
        }
    }

    /// Returns the key of the episode's random draws: never the id, the policy or the observation source.
    #[must_use]
    pub fn draw_key(&self) -> Digest {
        ds_space::Draws::key(&self.scenario_digest, &self.appearance, self.seed)
    }

    /// Returns the number of iterations, the initial one included.
    #[must_use]
    pub fn iterations(&self) -> u32 {
        1 + self.last_tick.0.div_ceil(self.replan_period.max(1))
    }

    /// Returns the first and last tick of the frames that the policy sees for a plan made at a tick.
    #[must_use]
    pub fn seen_at(&self, now: Tick) -> (Tick, Tick) {
        let last = now.0.saturating_sub(self.observation_delay);
        (Tick((last + 1).saturating_sub(self.history.max(1))), Tick(last))
    }

    /// Returns the first and last tick of the worlds that the policy sees for a plan made at a tick; none for all policies
    /// but the few privileged ones that see others live.
    #[must_use]
    pub fn witnessed_at(&self, now: Tick) -> Option<(Tick, Tick)> {
        let live = Anchor::from_name(&self.policy).is_some_and(Anchor::sees_live);
        live.then(|| (Tick(now.0.saturating_sub(WITNESSED_TICKS)), now))
    }

    /// Returns the last tick of the warm-up, from which on the policy drives.
    #[must_use]
    pub fn taken_over_at(&self) -> Tick {
        self.ticks_of(self.warm_up).1
    }

    /// Returns the first and last tick of an iteration.
    #[must_use]
    pub fn ticks_of(&self, iteration: u32) -> (Tick, Tick) {
        if iteration == 0 {
            return (Tick(0), Tick(0));
        }
        let first = (iteration - 1) * self.replan_period + 1;
        (Tick(first), Tick((first + self.replan_period - 1).min(self.last_tick.0)))
    }

    /// Returns the chunks whose last tick lies in an iteration; chunk 0 is the first frame.
    #[must_use]
    pub fn chunks_of(&self, iteration: u32) -> std::ops::Range<u32> {
        if self.chunk_ticks == 0 {
            return 0..0;
        }
        let (first, last) = self.ticks_of(iteration);
        let before = if iteration == 0 { 0 } else { 1 + (first.0 - 1) / self.chunk_ticks };
        before..1 + last.0 / self.chunk_ticks
    }
}
