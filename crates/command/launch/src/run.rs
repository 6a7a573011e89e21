//! `run`: starts a fleet, submits the scenarios, watches the drives, writes results and pictures.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};
use ds_cases::{RunConfig, logs, seal};
use ds_process::run_folder::{self, Earlier, Held};
use ds_process::runs::{self, Ended, EpisodeResults};
use ds_process::security::Dial;
use ds_process::service::InterruptedError;
use ds_process::terminal::{answer, bar};
use ds_run_report::results::hex;
use ds_run_report::write::folder;
use ds_run_report::{Episode, RESULTS, Results, Run};
use ds_space::Digest;
use ds_topic::Role;
use ds_wire::control as pb;

use crate::children;
use crate::embed::{self, Fleet};
use crate::fleet_plan::FleetPlan;
use crate::onlooker::{self, Onlooker};
use crate::pictures::Painter;
use crate::request;
use crate::run_plan::{RunPlan, SubmitArgs};
use crate::scenarios;

/// Runs the command; the exit code is 1 if any drive did not complete.
///
/// # Errors
/// If anything is refused, a service dies, or a drive fails.
pub async fn run(args: &RunPlan, log: &str) -> Result<()> {
    let results = drive_all(args, log).await?;
    conclude(&results, &args.out)
}

/// Drives everything and writes all that belongs to a run; a drive that did not complete is no error here.
///
/// # Errors
/// If anything is refused or a service dies.
pub async fn drive_all(args: &RunPlan, log: &str) -> Result<Results> {
    request::known(args)?;
    let files = shard(scenarios::files(&args.scenarios)?, args.shard.as_deref())?;
    let given = request::given(args, &files)?;
    let world = world_of(args, &files)?;
    let configuration = request::configuration(args, &world, &given)?;
    let request = request::request(args, &world, given, &configuration, sources(&files, Source::Path)?)?;
    let began = Instant::now();
    args.live.as_deref().map(onlooker::reach).transpose()?;
    let _held = hold(args)?;
    let plan = FleetPlan::of(args, files.len() * args.seed.len())?;
    let apart = args.processes || !plan.stages.is_empty();
    let simulated = !plan.stages.contains_key(&Role::Sim);
    let mut fleet =
        if apart { Fleet::of_children(children::start(&plan, log).await?) } else { embed::start(&plan).await? };
    let control = Dial::local(&fleet.control)?;
    let onlooker = match &args.live {
        Some(url) => Some(Onlooker::start(onlooker::drives(&fleet.seat()?, url, &[])).await?),
        None => None,
    };
    let mut painter = (!args.no_pictures && args.seal.is_none()).then(|| Painter::new(&args.out));
    let outcome = tokio::select! {
        outcome = drive(request, &control, painter.as_mut()) => outcome,
        error = failed(&mut fleet) => Err(error),
        _ = tokio::signal::ctrl_c() => Err(InterruptedError(
            "`--resume` goes on: finished drives stay finished, the others continue from the last commit".to_owned(),
        )
        .into()),
    };
    if let Some(onlooker) = onlooker
        && let Err(error) = onlooker.finish().await
    {
        tracing::warn!("{error:#}");
    }
    let mode = fleet.mode;
    let stopped = fleet.stop().await;
    let ended = outcome?;
    stopped?;
    let mut results = results(args, &configuration, &files, mode, ended, began.elapsed().as_secs_f64())?;
    if args.vehicle_log || args.seal.is_some() {
        extract(args, &results, simulated)?;
    }
    if args.seal.is_some() {
        withdraw(args, &mut results)?;
    }
    results.save(&args.out.join(RESULTS))?;
    if let Some(painter) = painter {
        painter.finish().await?;
    }
    folder::of_run(&args.out, &results)?;
    Ok(results)
}

/// Returns the effects of a run: named ones, or withheld ones whose answer is sealed.
fn world_of(args: &RunPlan, files: &[PathBuf]) -> Result<RunConfig> {
    let Some(answer) = &args.seal else {
        return Ok(RunConfig::gather(args.config.as_ref(), &args.effects, &args.laws)?);
    };
    let first = files.first().context("no scenario to drive")?;
    let (scene, _warnings) = ds_scenario::load(first)?;
    Ok(seal::draw_and_seal(answer, scene.vehicle.mass_kg, args.seal_seed)?)
}

/// Writes the vehicle logs of all completed drives, `simulated` by the built-in simulator or by somebody else's.
fn extract(args: &RunPlan, results: &Results, simulated: bool) -> Result<()> {
    let completed = results.episodes.iter().filter(|episode| episode.status == "completed");
    let recordings: Vec<PathBuf> = completed.map(|episode| args.out.join(&episode.recording)).collect();
    Ok(logs::extract(&recordings, simulated, &args.out.join("real"))?)
}

/// Removes all of a sealed run that tells more than a real vehicle would.
fn withdraw(args: &RunPlan, results: &mut Results) -> Result<()> {
    for name in ["recordings", "scenarios"] {
        let folder = args.out.join(name);
        if folder.exists() {
            std::fs::remove_dir_all(&folder).with_context(|| format!("remove {}", folder.display()))?;
        }
    }
    let ledger = args.out.join("ledger.redb");
    if ledger.exists() {
        std::fs::remove_file(&ledger).with_context(|| format!("remove {}", ledger.display()))?;
    }
    for episode in &mut results.episodes {
        for digest in [&mut episode.world_digest, &mut episode.layout_digest, &mut episode.frame_digest] {
            digest.clear();
        }
        episode.recording.clear();
    }
    Ok(())
}

/// Drives on a fleet that runs already; recordings stay with its orchestrator.
///
/// # Errors
/// If anything is refused or a drive fails.
pub async fn submit(args: &SubmitArgs) -> Result<()> {
    let run = &args.run;
    let files = shard(scenarios::files(&run.scenarios)?, run.shard.as_deref())?;
    let given = request::given(run, &files)?;
    let began = Instant::now();
    ensure!(run.seal.is_none(), "a sealed run keeps its answer where it drives: use `run`");
    let world = world_of(run, &files)?;
    let configuration = request::configuration(run, &world, &given)?;
    let request = request::request(run, &world, given, &configuration, sources(&files, Source::Content)?)?;
    let _held = hold(run)?;
    let ended = drive(request, &args.control.dial()?, None).await?;
    let results = results(run, &configuration, &files, "fleet", ended, began.elapsed().as_secs_f64())?;
    results.save(&run.out.join(RESULTS))?;
    folder::of_run(&run.out, &results)?;
    conclude(&results, &run.out)
}

/// Takes hold of the folder of a run, with earlier results resumed, deleted or kept as the arguments ask.
fn hold(args: &RunPlan) -> Result<Held> {
    let earlier = match (args.resume, args.overwrite) {
        (true, _) => Earlier::Resumed,
        (_, true) => Earlier::Overwritten,
        _ => Earlier::Kept,
    };
    let held = run_folder::take(&args.out, earlier)?;
    if let Some(folder) = &held.set_aside {
        answer(&format!("earlier results: {}", folder.display()));
    }
    Ok(held)
}

/// Prints the table; fails if any drive did not complete.
fn conclude(results: &Results, out: &Path) -> Result<()> {
    answer(&results.table());
    answer(&format!("results: {}", out.display()));
    let completed = results.episodes.iter().filter(|episode| episode.status == "completed").count();
    ensure!(completed == results.episodes.len(), "{} drives did not complete", results.episodes.len() - completed);
    Ok(())
}

async fn failed(fleet: &mut Fleet) -> anyhow::Error {
    fleet.failed().await.context("a service ended early")
}

fn shard(files: Vec<PathBuf>, shard: Option<&str>) -> Result<Vec<PathBuf>> {
    let Some(text) = shard else { return Ok(files) };
    let parsed = text.split_once('/').and_then(|(i, n)| Some((i.parse::<usize>().ok()?, n.parse::<usize>().ok()?)));
    let Some((index, count)) = parsed.filter(|(index, count)| index < count) else {
        bail!("--shard {text:?} is not I/N with I < N");
    };
    Ok(files.into_iter().enumerate().filter(|(i, _)| i % count == index).map(|(_, file)| file).collect())
}

async fn drive(request: pb::SubmitRequest, control: &Dial, mut painter: Option<&mut Painter>) -> Result<Ended> {
    let bar = bar(0, "ticks");
    let mut progress = |told: &EpisodeResults| {
        bar.set_length(told.values().map(|episode| u64::from(episode.ticks_due)).sum());
        bar.set_position(told.values().map(|episode| u64::from(episode.ticks)).sum());
        if let Some(painter) = &mut painter {
            painter.look(told);
        }
    };
    let ended = runs::drive(&request, control, &mut progress).await?;
    bar.finish_and_clear();
    Ok(ended)
}

/// How scenarios are handed to the orchestrator.
#[derive(Clone, Copy)]
pub enum Source {
    /// It sees the same files.
    Path,
    /// It may be elsewhere.
    Content,
}

/// Returns scenario files as a request names them.
///
/// # Errors
/// If one cannot be found or read, or its path is not UTF-8.
pub fn sources(files: &[PathBuf], how: Source) -> Result<Vec<pb::ScenarioSource>> {
    let source = |file: &PathBuf| {
        let source = match how {
            Source::Path => {
                let path = std::fs::canonicalize(file).with_context(|| format!("path of {}", file.display()))?;
                let path = path.to_str().with_context(|| format!("path {path:?} is not UTF-8"))?;
                pb::scenario_source::Source::Path(path.to_owned())
            }
            Source::Content => {
                let bytes = std::fs::read(file).with_context(|| format!("read {}", file.display()))?;
                pb::scenario_source::Source::File(bytes.into())
            }
        };
        Ok(pb::ScenarioSource { source: Some(source) })
    };
    files.iter().map(source).collect()
}

fn results(
    args: &RunPlan,
    configuration: &Digest,
    files: &[PathBuf],
    mode: &str,
    Ended { run, compute_classes }: Ended,
    wall_s: f64,
) -> Result<Results> {
    let first = run.episodes.first().context("the run has no episodes")?;
    Ok(Results {
        run: Run {
            id: run.run_id.clone(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            schema_version: ds_topic::SCHEMA_VERSION,
            seeds: args.seed.clone(),
            replan_period: args.replan,
            horizon_secs: args.horizon,
            history: args.history,
            agents: format!("{:?}", args.agents),
            tracker: args.tracker.name().to_owned(),
            appearance: args.appearance.clone(),
            mode: mode.to_owned(),
            configuration_digest: configuration.to_string(),
            video_model_digest: hex(&first.video_model),
            policy_model_digest: hex(&first.policy_model),
            compute_classes,
            insecure: run.insecure,
            wall_clock: args.wall_clock,
            wall_s,
        },
        episodes: run
            .episodes
            .iter()
            .zip(sets(files, args))
            .map(|(result, set)| Episode::driven(result, &set, &args.out))
            .collect(),
    })
}

/// Returns the scenario set of each episode: the folder that its scenario lies in, where a folder was given.
fn sets(files: &[PathBuf], args: &RunPlan) -> Vec<String> {
    let set = |file: &PathBuf| {
        let given = args.scenarios.iter().any(|path| path == file);
        let folder = file.parent().and_then(Path::file_name).filter(|_| !given);
        folder.map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
    };
    files.iter().flat_map(|file| std::iter::repeat_n(set(file), args.seed.len().max(1))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_part_the_files() {
        let files: Vec<PathBuf> = (0..7).map(|i| PathBuf::from(format!("{i}"))).collect();
        let mut all = Vec::new();
        for index in 0..3 {
            all.extend(shard(files.clone(), Some(&format!("{index}/3"))).expect("a sound shard"));
        }
        all.sort();
        assert_eq!(all, files);
        for bad in ["3/3", "x", "1", "-1/2", "0/0"] {
            assert!(shard(files.clone(), Some(bad)).is_err(), "{bad:?} was accepted");
        }
    }
}
