//! Drives the cells of a shard: each is one episode on the embedded fleet of `run`, recorded when it ends.
//!
//! A cell is submitted under its key, so that after a kill the same fleet folder goes on with it from its last commit, in
//! whatever shard it is then. Cells whose episodes bear one name (other agents, other scorer, a scenario of the same name)
//! never share a folder.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, Result, bail, ensure};
use ds_benchmark::session::{self, Event};
use ds_benchmark::sheet::{At, FILE};
use ds_benchmark::source::DT_SECS;
use ds_benchmark::{Cell, Keep, Manifest, Record, Sheet, Torn, Writer, record};
use ds_cases::RunConfig;
use ds_launch::embed::{self, Fleet};
use ds_launch::fleet_plan::workers;
use ds_launch::run::{Source, sources};
use ds_launch::{FleetPlan, Networks, RunPlan, request};
use ds_perception::look::LookReader;
use ds_process::drain::on_signals;
use ds_process::metrics::Metrics;
use ds_process::run_folder::{self, Earlier, Held};
use ds_process::runs::{self, Ended as Run};
use ds_process::section::{MetricsSection, SecuritySection};
use ds_process::security::Dial;
use ds_process::terminal::{answer, bar};
use ds_process::{Drain, service, shipped};
use ds_space::Digest;
use ds_topic::{ObservationSource, ProposalScorer};
use ds_video::Backend;
use indicatif::ProgressBar;
use rayon::prelude::*;
use tokio::task::JoinSet;

use crate::cli::RunArgs;
use crate::overall::Overall;
use crate::{Ended, FleetLost, ask, ended, shown};

/// How long the services of a fleet may take to end.
const DRAIN_WITHIN: Duration = Duration::from_secs(5);

/// A cell to drive, with its scenario file.
#[derive(Clone)]
struct Due {
    cell: Cell,
    round: u32,
    file: PathBuf,
}

/// What holds for this process alone and is no part of the benchmark.
#[derive(Debug, Default)]
pub(crate) struct Now<'a> {
    /// Folders of cells that ended elsewhere.
    pub done: &'a [PathBuf],
    /// Where Prometheus asks.
    pub metrics: Option<SocketAddr>,
    /// What goes on with it; `benchmark resume` without it.
    pub again: Option<&'a str>,
}

/// Runs `run`.
///
/// # Errors
/// If anything is refused, or the fleet is lost.
pub(crate) fn run(args: &RunArgs) -> Result<Ended> {
    let (sheet, sets) = asked(args)?;
    begin(&args.out, &sheet, &sets, &Now { done: &args.done, metrics: args.metrics, again: None })
}

/// Drives every so many-th entry of each set, or goes on with them where the folder holds just these cells.
///
/// # Errors
/// As for [`run`], and if the folder holds other cells.
pub(crate) fn part(args: &RunArgs, every: usize) -> Result<Ended> {
    let (mut sheet, mut sets) = asked(args)?;
    if every > 1 {
        for (set, named) in sets.iter_mut().zip(&mut sheet.sets) {
            let entries = set.entries.iter().step_by(every).cloned().collect();
            *set = Manifest::new(&format!("{}-every-{every}", set.name), set.kind, set.recipe.clone(), entries);
            (named.name, named.digest) = (set.name.clone(), set.digest.clone());
        }
    }
    if !args.out.join(FILE).exists() {
        return begin(&args.out, &sheet, &sets, &Now::default());
    }
    let (held, held_sets) = Sheet::load(&args.out)?;
    let cells = |sheet: &Sheet, sets: &[Manifest]| anyhow::Ok(sheet.cells(sets)?.into_keys().collect::<Vec<_>>());
    ensure!(
        cells(&held, &held_sets)? == cells(&sheet, &sets)?,
        "{} holds drives of another configuration: remove it or name another folder",
        args.out.display()
    );
    resume(&args.out, None, args.workers, &Now::default())
}

fn asked(args: &RunArgs) -> Result<(Sheet, Vec<Manifest>)> {
    let (mut sheet, sets) = ask::sheet(&args.what)?;
    sheet.shard = ask::shard(&args.shard)?;
    sheet.endpoints = args.endpoints.as_deref().map_or(Ok(Vec::new()), ds_benchmark::endpoint::load)?;
    for endpoint in &sheet.endpoints {
        if let Some(what) = sheet.undriven(&endpoint.claim, &sets) {
            bail!("endpoint {:?} is about {what}, which is not driven", endpoint.name);
        }
    }
    sheet.place.workers = workers(args.workers, usize::MAX);
    sheet.place.keep = args.keep.into();
    sheet.place.policy_listen.clone_from(&args.policy_listen);
    Ok((sheet, sets))
}

/// Drives a sheet in a folder that holds no results yet.
///
/// # Errors
/// If anything is refused, or the fleet is lost.
pub(crate) fn begin(out: &Path, sheet: &Sheet, sets: &[Manifest], now: &Now<'_>) -> Result<Ended> {
    ask::check(sheet)?;
    ready(sheet, now)?;
    let held = run_folder::take(out, Earlier::Resumed)?;
    ensure!(
        !out.join(FILE).exists(),
        "{} holds a benchmark: `benchmark resume` goes on with it; nothing was touched",
        out.display()
    );
    sheet.save(sets, out)?;
    go_on(&held, out, sheet, sets, now)
}

/// Runs `resume`.
///
/// # Errors
/// As for [`run`], and if the folder holds no benchmark.
pub(crate) fn resume(out: &Path, shard: Option<&str>, by: Option<u32>, now: &Now<'_>) -> Result<Ended> {
    ensure!(out.join(FILE).exists(), "{} holds no benchmark: there is no {FILE}", out.display());
    let held = run_folder::take(out, Earlier::Resumed)?;
    let (mut sheet, sets) = Sheet::load(out)?;
    sheet.shard = shard.map_or(Ok(sheet.shard), ask::shard)?;
    sheet.place.workers = by.map_or(sheet.place.workers, |by| workers(Some(by), usize::MAX));
    ask::check(&sheet)?;
    ask::unchanged(&sheet)?;
    sheet.save(&sets, out)?;
    go_on(&held, out, &sheet, &sets, now)
}

/// Refuses what a fleet could not be started with: a video model that cannot be loaded, an address that is taken.
fn ready(sheet: &Sheet, now: &Now<'_>) -> Result<()> {
    let networks = networks(sheet)?;
    networks.video().model().with_context(|| format!("the video model {}", shipped::describe(&networks.model)))?;
    let listen = now.metrics.map(|address| address.to_string()).unwrap_or_default();
    let open = async { Metrics::default().open(&MetricsSection { listen }, &SecuritySection::default(), Drain::new()) };
    ds_launch::runtime()?.block_on(open).map(drop)
}

fn networks(sheet: &Sheet) -> Result<Networks> {
    let (place, backend) = (&sheet.place, &sheet.settings.video_backend);
    Ok(Networks {
        model: place.model.clone(),
        video_backend: backend.parse::<Backend>().ok().with_context(|| format!("video back end {backend:?}"))?,
        policy_weights: place.policy_weights.clone(),
    })
}

/// Drives what is left; the folder is held.
fn go_on(_held: &Held, out: &Path, sheet: &Sheet, sets: &[Manifest], now: &Now<'_>) -> Result<Ended> {
    let mut seen: BTreeMap<String, (bool, u32)> = BTreeMap::new();
    let mut note = |record: &Record| {
        let (ended, rounds) = seen.entry(record.key.clone()).or_default();
        *ended |= record.ended();
        *rounds = (*rounds).max(record.round + u32::from(!record.ended()));
    };
    let (mut writer, torn) = Writer::open(out, |record| note(&record))?;
    session::note(out, Event::Begun { torn: torn.is_some() })?;
    if let Some(Torn { path, from }) = torn {
        answer(&format!("torn last line cut off at byte {from}: {}", path.display()));
    }
    for folder in now.done {
        record::read(folder, |_, record| {
            if record.ended() {
                note(&record);
            }
        })?;
    }
    let cells = sheet.cells(sets)?;
    let mine: Vec<(&Digest, &(Cell, At))> = sheet.shard.part(&cells).collect();
    let ended = |key: &Digest| seen.get(&key.to_string()).is_some_and(|(ended, _)| *ended);
    let left: Vec<_> = mine.iter().filter(|(key, _)| !ended(key)).copied().collect();
    answer(&format!("shard {}: {} of {} cells are left", sheet.shard, left.len(), mine.len()));
    let overall = (!now.done.is_empty()).then(|| Arc::new(Overall::new(sheet, &cells, out, now.done, left.len())));
    if let Some(overall) = &overall {
        answer(&overall.told()?);
    }
    if left.is_empty() {
        session::note(out, Event::Ended)?;
        return Ok(Ended::Complete);
    }
    let files = files(&left, sheet, sets, out)?;
    let alike = alike(sets);
    let mut groups: BTreeMap<String, Vec<Due>> = BTreeMap::new();
    for ((key, (cell, _)), file) in left.iter().zip(files) {
        let round = seen.get(&key.to_string()).map_or(0, |(_, rounds)| *rounds);
        let mut folder = format!("{}.{}.{round}", cell.agents.name(), cell.scorer);
        let digests = &alike[cell.scenario.as_str()];
        match digests.iter().position(|digest| *digest == cell.scenario_digest) {
            None | Some(0) => {}
            Some(other) => folder += &format!(".{other}"),
        }
        groups.entry(folder).or_default().push(Due { cell: cell.clone(), round, file });
    }
    let look = left.iter().any(|(_, (cell, _))| shown::concerns(cell)).then(shown::reader).transpose()?.map(Arc::new);
    let bar = bar(mine.len() as u64, "cells");
    bar.set_position((mine.len() - left.len()) as u64);
    bar.reset_eta();
    let runtime = ds_launch::runtime()?;
    let outcome = runtime.block_on(async {
        let drain = on_signals()?;
        let mut aborted = 0;
        for (name, due) in groups {
            let (folder, look, overall) = (out.join("work").join(name), look.clone(), overall.clone());
            let group = Group { sheet, out, folder, look, overall, metrics: now.metrics, bar: &bar, drain: &drain };
            match group.drive(due, &mut writer).await? {
                Some(more) => aborted += more,
                None => return Ok(None),
            }
        }
        anyhow::Ok(Some(aborted))
    });
    runtime.shutdown_timeout(Duration::from_secs(2));
    bar.finish_and_clear();
    let outcome = outcome?;
    if let Some(told) = overall.as_ref().and_then(|overall| overall.seen()) {
        answer(&told);
    }
    close(out, outcome, now)
}

/// Notes how a session ended and says it; `aborted` is nothing after a signal.
fn close(out: &Path, aborted: Option<usize>, now: &Now<'_>) -> Result<Ended> {
    session::note(out, if aborted.is_some() { Event::Ended } else { Event::Interrupted })?;
    let again = now.again.map_or_else(|| format!("`dreamstream benchmark resume {}`", out.display()), str::to_owned);
    Ok(match aborted {
        None => {
            answer(&format!("interrupted: {again} goes on"));
            Ended::Interrupted
        }
        Some(0) => {
            answer(&format!("all cells of the shard have ended: {}", out.display()));
            Ended::Complete
        }
        Some(count) => {
            answer(&format!("{count} cells were aborted: {again} tries again"));
            Ended::Left
        }
    })
}

/// Returns the digests of the scenarios of each name, such as of one variant in two modes, in the order of the sets.
fn alike(sets: &[Manifest]) -> BTreeMap<&str, Vec<&str>> {
    let mut alike: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for entry in sets.iter().flat_map(|set| &set.entries) {
        let digests = alike.entry(&entry.scenario).or_default();
        if !digests.contains(&entry.scenario_digest.as_str()) {
            digests.push(&entry.scenario_digest);
        }
    }
    alike
}

/// Returns what tells the scenario of a cell.
fn scenario(cell: &Cell) -> (&str, &str) {
    (&cell.scenario, &cell.scenario_digest)
}

/// Returns the scenario file of each cell; each scenario is read or made and compared with its digest once.
fn files(left: &[(&Digest, &(Cell, At))], sheet: &Sheet, sets: &[Manifest], out: &Path) -> Result<Vec<PathBuf>> {
    let mut wanted: BTreeMap<(&str, &str), At> = BTreeMap::new();
    for (_, (cell, at)) in left {
        wanted.entry(scenario(cell)).or_insert(*at);
    }
    let bar = bar(wanted.len() as u64, "scenarios");
    let wanted: Vec<_> = wanted.into_iter().collect();
    let found: Result<BTreeMap<(&str, &str), PathBuf>> = wanted
        .into_par_iter()
        .map(|(name, (set, entry))| {
            let manifest = &sets[set];
            let file = manifest.entries[entry].scenario_file(&sheet.place.folders[set], &out.join("scenarios"));
            bar.inc(1);
            Ok((name, file.with_context(|| format!("set {:?}", manifest.name))?))
        })
        .collect();
    bar.finish_and_clear();
    let found = found?;
    Ok(left.iter().map(|(_, (cell, _))| found[&scenario(cell)].clone()).collect())
}

/// Cells that one fleet drives.
struct Group<'a> {
    sheet: &'a Sheet,
    out: &'a Path,
    folder: PathBuf,
    /// Says whether conditions are on generated frames, where some are to be.
    look: Option<Arc<LookReader>>,
    /// How far all shards are, where the others are named.
    overall: Option<Arc<Overall>>,
    metrics: Option<SocketAddr>,
    bar: &'a ProgressBar,
    drain: &'a Drain,
}

/// A cell whose drive ended.
type Driven = (Due, Result<Run>);

impl Group<'_> {
    /// Drives the cells and returns how many were aborted; nothing after a signal.
    async fn drive(&self, due: Vec<Due>, writer: &mut Writer) -> Result<Option<usize>> {
        let Some(first) = due.first() else { return Ok(Some(0)) };
        let mut whole = self.plan(first)?;
        if let Some(name) = ask::outside(self.sheet).next() {
            name.clone_into(&mut whole.policy);
        }
        let manifests = self.sheet.place.manifests.values().cloned().collect();
        let mut fleet = embed::start(&FleetPlan { manifests, ..FleetPlan::of(&whole, due.len())? }).await?;
        let control = Dial::local(&fleet.control)?;
        let outcome = tokio::select! {
            outcome = self.feed(due, &control, writer) => outcome.map(Some),
            error = lost(&mut fleet) => Err(error),
            () = self.drain.cancelled() => Ok(None),
        };
        // What counts is on disk: cells as they ended, half-driven episodes as of their last commit.
        match tokio::time::timeout(DRAIN_WITHIN, fleet.stop()).await {
            Ok(Ok(())) => {}
            Ok(Err(error)) => tracing::warn!("{error:#}"),
            Err(_elapsed) => tracing::warn!("services were cut off while they drained"),
        }
        outcome
    }

    /// Keeps the fleet supplied with cells and writes down what ends.
    async fn feed(&self, due: Vec<Due>, control: &Dial, writer: &mut Writer) -> Result<usize> {
        let ahead = self.sheet.place.workers as usize + 1;
        let (mut waiting, mut under_way, mut aborted) = (due.into_iter(), JoinSet::<Driven>::new(), 0);
        loop {
            while under_way.len() < ahead
                && let Some(due) = waiting.next()
            {
                let (request, control) = (self.request(&due)?, control.clone());
                under_way.spawn(async move {
                    let run = runs::drive(&request, &control, &mut |_| ()).await;
                    (due, run)
                });
            }
            let Some(next) = under_way.join_next().await else { return Ok(aborted) };
            let (due, run) = next.context("a drive panicked")?;
            let told = due.cell.told();
            let run = run.with_context(|| format!("cell {told}"))?.run;
            let result = run.episodes.into_iter().next().context("a run without episodes")?;
            let result = Arc::new(result);
            let (made, out, keep) = (Arc::clone(&result), self.out.to_path_buf(), self.sheet.place.keep);
            let (cell, look) = ((due.cell, due.round), self.look.clone());
            let record =
                tokio::task::spawn_blocking(move || ended::record(cell.0, cell.1, &made, &out, keep, look.as_deref()));
            let record = record.await.context("judging a drive")?.with_context(|| format!("cell {told}"))?;
            writer.append(&record)?;
            if record.episode.recording.is_empty() {
                ended::delete(&result)?;
            } else if keep == Keep::States {
                tokio::task::spawn_blocking(move || ended::thin(&result)).await.context("thinning a recording")??;
            }
            if !record.ended() {
                aborted += 1;
                tracing::warn!(cell = %told, reason = %record.episode.reason, "aborted");
            }
            self.bar.inc(u64::from(record.ended()));
            self.look_around().await?;
        }
    }

    /// Tells beside the bar how far all shards are, now and then.
    async fn look_around(&self) -> Result<()> {
        let due = |overall: &&Arc<Overall>| self.bar.position().is_multiple_of(overall.every as u64);
        let Some(overall) = self.overall.as_ref().filter(due).cloned() else { return Ok(()) };
        let told = tokio::task::spawn_blocking(move || overall.seen()).await.context("looking at other shards")?;
        if let Some(told) = told {
            self.bar.set_message(format!("cells; {told}"));
        }
        Ok(())
    }

    fn request(&self, due: &Due) -> Result<ds_wire::control::SubmitRequest> {
        let plan = self.plan(due)?;
        let given = request::given(&plan, &[])?;
        let scenario = sources(std::slice::from_ref(&due.file), Source::Path)?;
        request::request(&plan, &RunConfig::default(), given, &due.cell.key(), scenario)
    }

    /// Returns the run that a cell is.
    fn plan(&self, due: &Due) -> Result<RunPlan> {
        let (cell, place, settings) = (&due.cell, &self.sheet.place, &self.sheet.settings);
        let scorer = ProposalScorer::from_name(&cell.scorer).with_context(|| format!("scorer {:?}", cell.scorer))?;
        Ok(RunPlan {
            scenarios: vec![due.file.clone()],
            policy: cell.policy.name.clone(),
            observation: ObservationSource::from_name(&cell.observation.name)
                .with_context(|| format!("observation {:?}", cell.observation.name))?,
            replan: settings.replan,
            horizon: DT_SECS * f64::from(settings.horizon),
            history: settings.history,
            scorer: if scorer == ProposalScorer::Learned { scorer } else { ProposalScorer::Oracle },
            oracle: if scorer == ProposalScorer::Learned { ProposalScorer::Oracle } else { scorer },
            duration: DT_SECS * f64::from(cell.last),
            warm_up: cell.hand_over / settings.replan,
            seed: vec![cell.seed],
            appearance: cell.appearance.clone(),
            agents: cell.agents,
            tracker: settings.tracker,
            networks: networks(self.sheet)?,
            workers: Some(place.workers),
            policy_listen: place.policy_listen.clone(),
            metrics: self.metrics,
            out: self.folder.clone(),
            ..RunPlan::default()
        })
    }
}

/// Waits for a service that ends early; where nothing more can be stored, that is the error.
async fn lost(fleet: &mut Fleet) -> anyhow::Error {
    let error = fleet.failed().await;
    if service::exit_code(&error) == service::EXIT_STORAGE { error } else { error.context(FleetLost) }
}
