//! From a submitted run to its episodes: every combination of scenario, policy, source, appearance and seed.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use ds_camera::Appearance;
use ds_raster::RgbImage;
use ds_space::{Digest, DigestWriter, EpisodeId, Framing, Intrinsics, RunId, Tick};
use ds_topic::{
    EpisodeSpec, ObservationSource, ProposalScorer, ReplanAlignment, SceneMessage, ScoreProfile, SwitchedEffect,
};
use ds_wire::control as pb;
use ds_world::{AgentMode, LayoutBackend, Scene, TrackerKind};

use crate::conditioning::{Conditioning, ConditioningError, first_frames};

/// The most episodes that a run may have.
const MAX_EPISODES: usize = 100_000;
/// The most effects that a run may switch on.
const MAX_EFFECTS: usize = 64;
/// The oldest frames that a policy may see, in ticks.
const MAX_DELAY_TICKS: f64 = 100.0;

/// A run is refused; nothing of it was begun.
#[derive(Debug, thiserror::Error)]
pub(crate) enum SubmissionError {
    /// A field is missing or out of bounds.
    #[error("submit.{field} is {value}: {why}")]
    Field {
        /// The field.
        field: &'static str,
        /// The value.
        value: String,
        /// What is allowed.
        why: &'static str,
    },
    /// An effect is refused.
    #[error("submit.settings.effects: {0}")]
    Effect(#[from] ds_effect::SettingError),
    /// Prompt or first frames are refused.
    #[error("submit.settings")]
    Conditioning(#[from] ConditioningError),
    /// A scenario is refused.
    #[error(transparent)]
    Scenario(#[from] ds_scenario::ScenarioError),
    /// A submitted file cannot be stored.
    #[error("submitted scenario cannot be stored: {path:?}")]
    Store {
        /// Where.
        path: PathBuf,
        /// Why.
        #[source]
        source: std::io::Error,
    },
}

/// One episode to drive.
#[derive(Debug, Clone)]
pub(crate) struct Job {
    /// The scenario file.
    pub file: PathBuf,
    /// The settings; the digests of video model and policy come from the fleet.
    pub spec: EpisodeSpec,
    /// The scenario's family; empty if imported.
    pub category: String,
    /// What the video model starts from.
    pub given: Arc<Conditioning>,
    /// Width and height of the video model's frames, which the cameras are brought to; known once a worker joined, and only
    /// where frames are generated.
    pub frame_px: Option<[u32; 2]>,
}

/// What the name of an appearance may be.
const LOOKS: &str =
    "`day`, `seed-N` or a condition such as `snow`, `rain-night`, `lighting=night,weather=fog,surface=dry`";

fn refuse<T>(field: &'static str, value: impl ToString, why: &'static str) -> Result<T, SubmissionError> {
    Err(SubmissionError::Field { field, value: value.to_string(), why })
}

/// Checks a run and lists its episodes, in order of scenario, policy, source, appearance, seed.
///
/// # Errors
/// [`SubmissionError`] names the field or the file.
pub(crate) fn jobs(run: &RunId, request: &pb::SubmitRequest, folder: &Path) -> Result<Vec<Job>, SubmissionError> {
    let asked = request.settings.clone().unwrap_or_default();
    let settings = Settings::of(&asked)?;
    let files = files(request, folder)?;
    let policies = &request.policies;
    if policies.is_empty() || policies.len() > 256 {
        return refuse("policies", policies.len(), "1 to 256 names");
    }
    let privileged = |name: &String| ds_policy::builtin::NAMES.contains(&(name.as_str(), true));
    if asked.benchmark
        && let Some(name) = policies.iter().find(|name| privileged(name))
    {
        return refuse("policies", name, "privileged: it sees more than frames and is refused in a benchmark");
    }
    if asked.wall_clock
        && let Some(name) = policies.iter().find(|name| asked.benchmark || ds_policy::builtin::is_builtin(name))
    {
        return refuse(
            "policies",
            name,
            "not to be driven by the wall clock: only one that connects is, in no benchmark",
        );
    }
    let observations = observations(request)?;
    let given = Arc::new(Conditioning::of(&asked, &observations)?);
    let appearances = if request.appearances.is_empty() { vec!["day".to_owned()] } else { request.appearances.clone() };
    let short = |name: &String| Appearance::short_name(name).or_else(|_| refuse("appearances", name, LOOKS));
    let appearances = appearances.iter().map(short).collect::<Result<Vec<_>, _>>()?;
    let seeds = if request.seeds.is_empty() { vec![0] } else { request.seeds.clone() };
    let count = files.len() * policies.len() * observations.len() * appearances.len() * seeds.len();
    if count > MAX_EPISODES {
        return refuse("scenarios", count, "at most 100000 episodes");
    }
    let mut jobs = Vec::with_capacity(count);
    for file in &files {
        let (scene, _warnings) = ds_scenario::load(file)?;
        given.pictures(&scene)?;
        for policy in policies {
            for observation in &observations {
                for appearance in &appearances {
                    for seed in &seeds {
                        let arm = Arm { policy, observation: *observation, appearance, seed: *seed };
                        let spec = spec(run, &scene, &arm, &settings, &given)?;
                        let (file, category) = (file.clone(), scene.family.clone());
                        jobs.push(Job { file, spec, category, given: Arc::clone(&given), frame_px: None });
                    }
                }
            }
        }
    }
    Ok(jobs)
}

struct Arm<'a> {
    policy: &'a str,
    observation: ObservationSource,
    appearance: &'a str,
    seed: u64,
}

fn choice<T: Default>(
    field: &'static str,
    name: &str,
    from_name: fn(&str) -> Option<T>,
    why: &'static str,
) -> Result<T, SubmissionError> {
    if name.is_empty() {
        return Ok(T::default());
    }
    from_name(name).map_or_else(|| refuse(field, name, why), Ok)
}

/// What all episodes of a run have in common: its settings, checked, with their defaults.
struct Settings {
    replan_period: u32,
    horizon: u32,
    history: u32,
    warm_up: u32,
    /// Ticks to drive at most; none for the scenario's length.
    ticks: Option<u32>,
    agents: AgentMode,
    tracker: TrackerKind,
    layout_backend: LayoutBackend,
    alignment: ReplanAlignment,
    scorer: ProposalScorer,
    score_profile: ScoreProfile,
    effects: Vec<SwitchedEffect>,
    vehicle_log: bool,
    wall_clock: bool,
}

impl Settings {
    fn of(asked: &pb::RunSettings) -> Result<Self, SubmissionError> {
        let or = |value: u32, default: u32| if value == 0 { default } else { value };
        let (replan_period, horizon) = (or(asked.replan_period, 5), or(asked.horizon, 80));
        let history = or(asked.history, 1);
        if asked.effects.len() > MAX_EFFECTS {
            return refuse("settings.effects", asked.effects.len(), "at most 64 effects");
        }
        for effect in &asked.effects {
            ds_effect::check(&effect.id, &effect.values)?;
        }
        if replan_period > horizon {
            return refuse("settings.replan_period", replan_period, "at most the horizon");
        }
        if horizon > 300 {
            return refuse("settings.horizon", horizon, "at most 300 ticks");
        }
        if history > 64 {
            return refuse("settings.history", history, "at most 64 frames");
        }
        let layouts = "`auto`, `cpu` or `wgpu`";
        let scorers = "`learned`, `oracle` or `oracle-navsim`";
        let profiles = "`bridgesim` or `strict`";
        Ok(Self {
            replan_period,
            horizon,
            history,
            warm_up: asked.warm_up,
            ticks: Some(asked.ticks).filter(|ticks| *ticks > 0),
            agents: pb::agents_of(asked.agents).unwrap_or_default(),
            tracker: choice("settings.tracker", &asked.tracker, TrackerKind::from_name, "`lqr` or `pure-pursuit`")?,
            layout_backend: choice(
                "settings.layout_backend",
                &asked.layout_backend,
                LayoutBackend::from_name,
                layouts,
            )?,
            alignment: match pb::ReplanAlignment::try_from(asked.alignment) {
                Ok(pb::ReplanAlignment::Exact) => ReplanAlignment::Exact,
                _ => ReplanAlignment::Rollback,
            },
            scorer: choice("settings.scorer", &asked.scorer, ProposalScorer::from_name, scorers)?,
            score_profile: choice("settings.score_profile", &asked.score_profile, ScoreProfile::from_name, profiles)?,
            effects: asked.effects.iter().map(switched).collect(),
            vehicle_log: asked.vehicle_log,
            wall_clock: asked.wall_clock,
        })
    }

    /// Returns the age of the frames that a policy sees, in ticks: the world's `obs_latency`.
    fn observation_delay(&self, dt_secs: f64) -> u32 {
        let ages = self.effects.iter().filter(|effect| effect.id == "obs_latency");
        let secs: f64 = ages.filter_map(|effect| effect.values.first()).sum();
        (secs / dt_secs).round().clamp(0.0, MAX_DELAY_TICKS) as u32
    }
}

fn observations(request: &pb::SubmitRequest) -> Result<Vec<ObservationSource>, SubmissionError> {
    let mut found = Vec::new();
    for value in &request.observations {
        match pb::observation_of(*value) {
            Some(source) => found.push(source),
            None => return refuse("observations", value, "a known source"),
        }
    }
    if found.is_empty() {
        return refuse("observations", 0, "at least one source");
    }
    Ok(found)
}

fn files(request: &pb::SubmitRequest, folder: &Path) -> Result<Vec<PathBuf>, SubmissionError> {
    if request.scenarios.is_empty() || request.scenarios.len() > 4096 {
        return refuse("scenarios", request.scenarios.len(), "1 to 4096 sources");
    }
    let mut files = Vec::new();
    for source in &request.scenarios {
        match &source.source {
            Some(pb::scenario_source::Source::Path(path)) => {
                let path = PathBuf::from(path);
                if path.is_dir() { files.extend(ds_scenario::list(&path)?) } else { files.push(path) }
            }
            Some(pb::scenario_source::Source::File(bytes)) => files.push(store(bytes, folder)?),
            None => return refuse("scenarios", "empty", "a path or a file"),
        }
    }
    if files.is_empty() {
        return refuse("scenarios", 0, "at least one scenario file");
    }
    Ok(files)
}

fn store(bytes: &[u8], folder: &Path) -> Result<PathBuf, SubmissionError> {
    if bytes.len() > 64 << 20 {
        return refuse("scenarios.file", bytes.len(), "at most 64 MiB");
    }
    let folder = folder.join("scenarios");
    let path = folder.join(format!("{}.scenario.json", Digest::of(bytes)));
    let failed = |source| SubmissionError::Store { path: path.clone(), source };
    std::fs::create_dir_all(&folder).map_err(failed)?;
    std::fs::write(&path, bytes).map_err(failed)?;
    Ok(path)
}

fn spec(
    run: &RunId,
    scene: &Scene,
    arm: &Arm<'_>,
    settings: &Settings,
    given: &Conditioning,
) -> Result<EpisodeSpec, SubmissionError> {
    let last = scene.last_tick().0;
    let ticks = settings.ticks.map_or(last, |ticks| ticks.min(last));
    let name = format!("{}.{}.{}.s{}", scene.name, arm.policy, arm.observation.name(), arm.seed);
    let name = if arm.appearance == "day" { name } else { format!("{name}.{}", arm.appearance) };
    let Ok(episode) = EpisodeId::new(&name) else {
        return refuse("policies", arm.policy, "letters, digits, '_', '-', '.'; scenario and policy at most 60 in all");
    };
    let mut spec = EpisodeSpec {
        episode,
        scenario: scene.name.clone(),
        scenario_digest: scene.digest,
        policy: arm.policy.to_owned(),
        observation: arm.observation,
        appearance: arm.appearance.to_owned(),
        seed: arm.seed,
        replan_period: settings.replan_period,
        horizon: settings.horizon,
        history: settings.history,
        warm_up: settings.warm_up,
        last_tick: Tick(ticks),
        agents: settings.agents,
        tracker: settings.tracker,
        layout_backend: settings.layout_backend,
        alignment: settings.alignment,
        chunk_ticks: 0,
        layout_memory_ticks: 0,
        layout_geometry: false,
        video_model: Digest::default(),
        policy_model: Digest::default(),
        configuration: Digest::default(),
        scorer: settings.scorer,
        score_profile: settings.score_profile,
        effects: settings.effects.clone(),
        vehicle_log: settings.vehicle_log,
        wall_clock: settings.wall_clock,
        observation_delay: settings.observation_delay(scene.dt.secs()),
        prompt: if arm.observation.is_generated() {
            given.prompt(scene, Tick(ticks), &look(arm.appearance)?)
        } else {
            String::new()
        },
    };
    let mut writer = DigestWriter::new();
    writer.text(run.as_str()).u32(spec.replan_period).u32(spec.horizon).u32(spec.history).u32(spec.warm_up);
    writer.u32(spec.scorer as u32).u32(spec.score_profile as u32).u32(spec.alignment as u32);
    writer.u32(spec.agents as u32).text(spec.tracker.name()).text(spec.layout_backend.name()).u32(spec.last_tick.0);
    for effect in &spec.effects {
        writer.text(&effect.id).f64s(&effect.values);
    }
    writer.bool(spec.vehicle_log).text(&spec.prompt);
    given.digest_into(&mut writer);
    if spec.wall_clock {
        writer.text("wall_clock");
    }
    spec.configuration = writer.finish();
    Ok(spec)
}

fn switched(effect: &pb::SwitchedEffect) -> SwitchedEffect {
    SwitchedEffect { id: effect.id.clone(), values: effect.values.clone() }
}

/// Loads the scenario of a job and makes what the stages need to begin: the scene and the first frames.
///
/// # Errors
/// If the file changed since the submission or is refused.
pub(crate) fn scene(job: &Job) -> Result<SceneMessage, SubmissionError> {
    let (mut scene, _warnings) = ds_scenario::load(&job.file)?;
    if scene.digest != job.spec.scenario_digest {
        return refuse("scenarios", job.file.display(), "the file changed since the run was submitted");
    }
    let given = job.given.pictures(&scene)?;
    let (framings, originals) = frame(&mut scene, job.frame_px);
    let first_frames = if job.spec.observation.is_generated() {
        let part = |picture: RgbImage, to: &Framing| {
            let part = picture.part([to.left_px, to.top_px], [to.width_px, to.height_px]);
            part.resized(to.to_px[0], to.to_px[1])
        };
        let given = given.into_iter().zip(&framings).map(|(given, to)| given.map(|picture| part(picture, to)));
        first_frames(&scene, given.collect(), look(&job.spec.appearance)?)?
    } else {
        Vec::new()
    };
    Ok(SceneMessage { spec: job.spec.clone(), scene: Arc::new(scene), first_frames, originals })
}

/// Brings the cameras of a scene to a size; returns how, and what they were where any of them changed.
fn frame(scene: &mut Scene, size: Option<[u32; 2]>) -> (Vec<Framing>, Vec<Intrinsics>) {
    let originals: Vec<Intrinsics> = scene.cameras.iter().map(|camera| camera.intrinsics).collect();
    let own = |lens: &Intrinsics| [lens.width_px, lens.height_px];
    let framings: Vec<Framing> = originals.iter().map(|lens| lens.framing(size.unwrap_or_else(|| own(lens)))).collect();
    for (camera, framing) in scene.cameras.iter_mut().zip(&framings) {
        camera.intrinsics = camera.intrinsics.framed(framing);
    }
    let changed = scene.cameras.iter().zip(&originals).any(|(camera, original)| camera.intrinsics != *original);
    (framings, if changed { originals } else { Vec::new() })
}

fn look(appearance: &str) -> Result<Appearance, SubmissionError> {
    Appearance::named(appearance).or_else(|_| refuse("appearances", appearance, LOOKS))
}
