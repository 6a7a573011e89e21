//! The settings of an episode, part of `scene`.

use ds_space::{EpisodeId, Tick};
use ds_topic::{
    EpisodeSpec, MAX_LAYOUT_MEMORY_TICKS, ObservationSource, ProposalScorer, ReplanAlignment, ScoreProfile,
    SwitchedEffect,
};
use ds_world::{AgentMode, LayoutBackend, TrackerKind};

use crate::error::FieldError;
use crate::field::{checked, choice, digest, enumeration, list, named, number, text, whole};
use crate::scene::{MAX_NAME_BYTES, MAX_TEXT_BYTES, MAX_TICKS};
use crate::v1;

enumeration!(v1::ObservationSource, ObservationSource, {
    Dreamstream = Dreamstream, Reference = Reference, SimRgb = SimRgb, Layout = Layout,
    DreamstreamNoGuidance = DreamstreamNoGuidance, DreamstreamCleanCache = DreamstreamCleanCache,
    DreamstreamNoLayout = DreamstreamNoLayout, PerFrame = PerFrame, Reprojected = Reprojected, Logged = Logged,
    SecondCamera = Abroad,
});
enumeration!(v1::AgentMode, AgentMode, {
    LogReplay = LogReplay, IdmBehindEgo = IdmBehindEgo, IdmAll = IdmAll, Interactive = Interactive,
});
enumeration!(v1::ReplanAlignment, ReplanAlignment, { Rollback = Rollback, Exact = Exact });

enumeration!(v1::ProposalScorer, ProposalScorer, {
    Learned = Learned, Oracle = Oracle, OracleNavsim = OracleNavsim,
});
enumeration!(v1::ScoreProfile, ScoreProfile, { Bridgesim = Bridgesim, Strict = Strict });

/// Reads a choice that older messages lack: unspecified is the default.
fn chosen<W, T>(field: &str, value: i32) -> Result<T, FieldError>
where
    W: TryFrom<i32>,
    T: TryFrom<W, Error = FieldError> + Default,
{
    if value == 0 { Ok(T::default()) } else { choice::<W, T>(field, value) }
}

/// Bounds on the effects of an episode.
pub(crate) const MAX_EFFECTS: usize = 64;
const MAX_VALUES: usize = 16;
/// Longest id of an effect, which may be the text of a law.
const MAX_EFFECT_BYTES: usize = 1024;
const MAX_DELAY_TICKS: u32 = 100;

impl From<&SwitchedEffect> for v1::SwitchedEffect {
    fn from(value: &SwitchedEffect) -> Self {
        Self { id: value.id.clone(), values: value.values.clone() }
    }
}

impl TryFrom<v1::SwitchedEffect> for SwitchedEffect {
    type Error = FieldError;
    fn try_from(message: v1::SwitchedEffect) -> Result<Self, FieldError> {
        if message.values.len() > MAX_VALUES {
            return Err(FieldError::new(
                "values",
                format!("has {} values, the limit is {MAX_VALUES}", message.values.len()),
            ));
        }
        let values = message.values.into_iter().enumerate();
        Ok(Self {
            id: text("id", message.id, MAX_EFFECT_BYTES)?,
            values: values.map(|(i, value)| number(&format!("values[{i}]"), Some(value))).collect::<Result<_, _>>()?,
        })
    }
}

impl From<&EpisodeSpec> for v1::EpisodeSpec {
    fn from(value: &EpisodeSpec) -> Self {
        let bytes = |digest: &ds_space::Digest| digest.0.to_vec().into();
        Self {
            episode: value.episode.as_str().to_owned(),
            scenario: value.scenario.clone(),
            scenario_digest: bytes(&value.scenario_digest),
            policy: value.policy.clone(),
            observation: v1::ObservationSource::from(value.observation).into(),
            appearance: value.appearance.clone(),
            seed: value.seed,
            replan_period: value.replan_period,
            horizon: value.horizon,
            history: value.history,
            warm_up: value.warm_up,
            last_tick: value.last_tick.0,
            agents: v1::AgentMode::from(value.agents).into(),
            tracker: value.tracker.name().to_owned(),
            layout_backend: value.layout_backend.name().to_owned(),
            alignment: v1::ReplanAlignment::from(value.alignment).into(),
            chunk_ticks: value.chunk_ticks,
            video_model: bytes(&value.video_model),
            policy_model: bytes(&value.policy_model),
            configuration: bytes(&value.configuration),
            scorer: v1::ProposalScorer::from(value.scorer).into(),
            score_profile: v1::ScoreProfile::from(value.score_profile).into(),
            effects: value.effects.iter().map(Into::into).collect(),
            vehicle_log: value.vehicle_log,
            observation_delay: value.observation_delay,
            layout_memory_ticks: value.layout_memory_ticks,
            layout_geometry: value.layout_geometry,
            prompt: value.prompt.clone(),
            wall_clock: value.wall_clock,
        }
    }
}

impl TryFrom<v1::EpisodeSpec> for EpisodeSpec {
    type Error = FieldError;
    fn try_from(message: v1::EpisodeSpec) -> Result<Self, FieldError> {
        let most = MAX_TICKS as u32;
        Ok(Self {
            episode: checked("episode", EpisodeId::new(&message.episode))?,
            scenario: text("scenario", message.scenario, MAX_NAME_BYTES)?,
            scenario_digest: digest("scenario_digest", &message.scenario_digest)?,
            policy: text("policy", message.policy, MAX_NAME_BYTES)?,
            observation: choice::<v1::ObservationSource, _>("observation", message.observation)?,
            appearance: text("appearance", message.appearance, MAX_NAME_BYTES)?,
            seed: message.seed,
            replan_period: whole("replan_period", message.replan_period, 1, most)?,
            horizon: whole("horizon", message.horizon, 1, most)?,
            history: whole("history", message.history, 1, most)?,
            warm_up: whole("warm_up", message.warm_up, 0, most)?,
            last_tick: Tick(whole("last_tick", message.last_tick, 0, most)?),
            agents: choice::<v1::AgentMode, _>("agents", message.agents)?,
            tracker: named("tracker", &message.tracker, TrackerKind::from_name)?,
            layout_backend: named("layout_backend", &message.layout_backend, LayoutBackend::from_name)?,
            alignment: choice::<v1::ReplanAlignment, _>("alignment", message.alignment)?,
            chunk_ticks: whole("chunk_ticks", message.chunk_ticks, 0, most)?,
            video_model: digest("video_model", &message.video_model)?,
            policy_model: digest("policy_model", &message.policy_model)?,
            configuration: digest("configuration", &message.configuration)?,
            scorer: chosen::<v1::ProposalScorer, _>("scorer", message.scorer)?,
            score_profile: chosen::<v1::ScoreProfile, _>("score_profile", message.score_profile)?,
            effects: list("effects", message.effects, MAX_EFFECTS)?,
            vehicle_log: message.vehicle_log,
            observation_delay: whole("observation_delay", message.observation_delay, 0, MAX_DELAY_TICKS)?,
            layout_memory_ticks: whole("layout_memory_ticks", message.layout_memory_ticks, 0, MAX_LAYOUT_MEMORY_TICKS)?,
            layout_geometry: message.layout_geometry,
            prompt: text("prompt", message.prompt, MAX_TEXT_BYTES)?,
            wall_clock: message.wall_clock,
        })
    }
}
