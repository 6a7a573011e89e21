//! From arguments to the request: settings of all episodes, prompt and first frames, the digest that tells runs apart.
//!
//! Prompt and first frames are read and checked here, before anything starts, by the rules of the orchestrator.

use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use ds_camera::Appearance;
use ds_cases::RunConfig;
use ds_policy::builtin::{NAMES, is_builtin};
use ds_policy::{Learned, Own};
use ds_process::service::UsageError;
use ds_process::terminal::note;
use ds_space::{CameraId, Digest, DigestWriter};
use ds_topic::{ObservationSource, ProposalScorer};
use ds_video::ModelConfig;
use ds_wire::control as pb;
use ds_world::{Condition, Wording};
use orchestrator::Conditioning;

use crate::own;
use crate::run_plan::{Align, RunPlan};

/// Checks the names, and the policy's weights, that the orchestrator or a stage would only refuse once everything is under
/// way.
///
/// # Errors
/// If policy or look of the reference camera is none that can be meant; the error says which there are. If the weights of
/// the policy cannot be used.
pub fn known(args: &RunPlan) -> Result<()> {
    let outside = args.policy_listen.is_some() || args.stages.iter().any(|stage| stage.trim().starts_with("policy="));
    let inside = Own::named(&args.policy).is_some() || is_builtin(&args.policy);
    if args.wall_clock && (inside || args.stages.iter().any(|stage| stage.trim().starts_with("policy="))) {
        let says = "--wall-clock is for a policy that connects: name one by --policy and give --policy-listen ENDPOINT";
        return Err(UsageError(says.to_owned()).into());
    }
    // A manifest is read with the configuration, which tells runs of different networks apart.
    if !outside && Own::named(&args.policy).is_none() && !is_builtin(&args.policy) {
        let says = format!(
            "there is no policy {:?}: built in are {}; an ONNX network is named by its manifest, such as mine.toml; an \
             external policy connects with --policy-listen ENDPOINT, such as tcp/127.0.0.1:7448 (`python -m dreamstream run \
             FILE:CLASS --name {0} --connect ENDPOINT`)",
            args.policy,
            NAMES.map(|(name, _)| name).join(", ")
        );
        return Err(UsageError(says).into());
    }
    if let Some(learned) = Learned::of(&args.policy).filter(|_| !outside) {
        let loaded = learned.load(&learned.weights_file(&args.networks.policy_weights));
        loaded.map_err(|error| UsageError(format!("--policy-weights: {:#}", anyhow::Error::from(error))))?;
    }
    let video = !args.stages.iter().any(|stage| stage.trim().starts_with("video="));
    if args.observation == ObservationSource::DreamstreamNoGuidance && video {
        // Another training's transformer, which need not be there; a worker without it would only be waited for.
        args.networks
            .video()
            .model_of(args.observation)
            .map_err(|fault| UsageError(format!("--observation: {fault}")))?;
    }
    Appearance::short_name(&args.appearance).map_err(|error| UsageError(format!("--appearance: {error}")))?;
    Ok(())
}

/// Reads prompt and first frames and checks them against the scenarios.
///
/// # Errors
/// If a file cannot be read, or is refused for one of the scenarios.
pub fn given(args: &RunPlan, files: &[PathBuf]) -> Result<pb::RunSettings> {
    let first_frames = args.first_frames.iter().map(|text| first_frame(text)).collect::<Result<_>>()?;
    let settings = pb::RunSettings { prompt: heard(args), first_frames, ..pb::RunSettings::default() };
    let given = Conditioning::of(&settings, &[args.observation])?;
    for file in files.iter().filter(|_| !settings.first_frames.is_empty()) {
        let (scene, _warnings) = ds_scenario::load(file)?;
        given.pictures(&scene)?;
    }
    Ok(settings)
}

/// Returns the prompt as the video model is told it. A model that knows the words of its training alone is told the look that
/// ordinary words name in those; what of them it does not follow is said on the terminal.
fn heard(args: &RunPlan) -> Option<String> {
    let prompt = args.prompt.as_ref()?;
    let hashes_words = ModelConfig::load(&args.networks.model).is_ok_and(|preset| preset.hashes_words());
    let wording = Wording::read(prompt);
    let told = wording.condition().map(Condition::words).filter(|words| hashes_words && !prompt.contains(words));
    if hashes_words {
        let read = told.iter().map(|words| format!("read as {words:?}"));
        let shown = wording.condition().filter(|condition| args.first_frames.is_empty() && !shows(args, *condition));
        let unlike = shown.map(|_| {
            let look = &args.appearance;
            format!(
                "the first frame shows --appearance {look}, `dreamstream video first-frame` makes one of these words"
            )
        });
        let remarks = read.chain(wording.remarks()).chain(unlike);
        remarks.for_each(|remark| note(&format!("--prompt: {remark}")));
    }
    told.or_else(|| Some(prompt.clone()))
}

/// Says whether the first frame of a run is of a condition.
fn shows(args: &RunPlan, condition: Condition) -> bool {
    let appearance = Appearance::named(&args.appearance).ok();
    appearance.is_some_and(|appearance| appearance.condition.unwrap_or(Condition::DAY) == condition)
}

/// Reads `FILE` or `CAMERA=FILE`.
fn first_frame(text: &str) -> Result<pb::FirstFrame> {
    let named = text.split_once('=').filter(|(camera, _)| CameraId::new(camera).is_ok());
    let (camera, path) = named.unwrap_or(("", text));
    let image = std::fs::read(path).with_context(|| format!("--first-frame: read {path}"))?;
    Ok(pb::FirstFrame { camera: camera.to_owned(), image: image.into() })
}

/// Returns what the orchestrator is asked; `given` is what the video model starts from.
///
/// # Errors
/// If horizon or duration is out of bounds.
pub fn request(
    args: &RunPlan,
    world: &RunConfig,
    given: pb::RunSettings,
    configuration: &Digest,
    scenarios: Vec<pb::ScenarioSource>,
) -> Result<pb::SubmitRequest> {
    let dt_secs = 0.1;
    let ticks = |secs: f64| (secs / dt_secs).round().clamp(0.0, 100_000.0) as u32;
    ensure!(args.horizon > 0.0 && args.horizon <= 30.0, "--horizon {} is not in (0, 30]", args.horizon);
    ensure!(args.duration >= 0.0, "--duration {} is negative", args.duration);
    Ok(pb::SubmitRequest {
        client_id: format!("run-{}", &configuration.to_string()[..16]),
        scenarios,
        policies: vec![own::name(&args.policy)?],
        observations: vec![pb::ObservationSource::from(args.observation).into()],
        appearances: vec![args.appearance.clone()],
        seeds: args.seed.clone(),
        settings: Some(pb::RunSettings {
            replan_period: args.replan,
            horizon: ticks(args.horizon),
            history: args.history,
            warm_up: args.warm_up,
            ticks: ticks(args.duration),
            agents: pb::AgentMode::from(args.agents).into(),
            tracker: args.tracker.name().to_owned(),
            layout_backend: args.layout_backend.name().to_owned(),
            alignment: match args.align {
                Align::Rollback => pb::ReplanAlignment::Rollback as i32,
                Align::Exact => pb::ReplanAlignment::Exact as i32,
            },
            benchmark: args.benchmark,
            scorer: scorer(args).name().to_owned(),
            score_profile: args.profile.name().to_owned(),
            effects: world.switched(),
            vehicle_log: args.vehicle_log || args.seal.is_some(),
            wall_clock: args.wall_clock,
            ..given
        }),
    })
}

fn scorer(args: &RunPlan) -> ProposalScorer {
    if args.scorer == ProposalScorer::Learned { args.scorer } else { args.oracle }
}

/// Returns the digest over all settings that a result depends on, names of scenarios included, folders not.
///
/// # Errors
/// If the manifest of a policy is refused.
pub fn configuration(args: &RunPlan, world: &RunConfig, given: &pb::RunSettings) -> Result<Digest> {
    let mut writer = DigestWriter::new();
    if let Some(own) = own::asked(args)? {
        writer.digest(own.digest());
    }
    writer.text(&args.policy).u32(args.observation as u32).u32(args.replan).f64(args.horizon).u32(args.history);
    writer
        .f64(args.duration)
        .u32(args.warm_up)
        .text(&args.appearance)
        .u32(args.agents as u32)
        .text(args.tracker.name());
    writer
        .text(scorer(args).name())
        .text(args.profile.name())
        .u32(args.align as u32)
        .text(args.layout_backend.name())
        .text(args.shard.as_deref().unwrap_or_default());
    for seed in &args.seed {
        writer.u64(*seed);
    }
    for path in &args.scenarios {
        writer.text(&path.to_string_lossy());
    }
    // Withheld effects are told by nothing, their digest included.
    if let Some(seal) = &args.seal {
        writer.text(&seal.to_string_lossy());
    } else {
        for effect in &world.effects {
            writer.text(&effect.id).f64s(&effect.values);
        }
        world.laws.iter().for_each(|law| {
            writer.text(law);
        });
    }
    for stage in &args.stages {
        writer.text(stage);
    }
    writer.bool(given.prompt.is_some()).text(given.prompt());
    for frame in &given.first_frames {
        writer.text(&frame.camera).digest(&Digest::of(&frame.image));
    }
    if args.wall_clock {
        writer.text("wall_clock");
    }
    Ok(writer.bool(args.vehicle_log).finish())
}
