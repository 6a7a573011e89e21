//! `scale`: the same drives on fleets of more and more video workers, each fleet of processes of its own; table and page.
//!
//! Recordings go as soon as their drives have ended: what is compared are the digests that the orchestrator tells.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use ds_benchmark::scale::{Completed, Row};
use ds_benchmark::{Scaling, page, sheet};
use ds_cases::RunConfig;
use ds_launch::embed::Fleet;
use ds_launch::run::{Source, sources};
use ds_launch::{FleetPlan, RunPlan, children, request, scenarios};
use ds_process::Drain;
use ds_process::drain::on_signals;
use ds_process::run_folder::{self, Earlier};
use ds_process::runs::{self, EpisodeResults};
use ds_process::security::{Control, Dial};
use ds_process::terminal::{answer, bar};
use ds_run_report::results::hex;
use ds_topic::Role;
use ds_wire::control as pb;
use indicatif::ProgressBar;
use pb::fleet_client::FleetClient;

use crate::Ended;
use crate::cli::ScaleArgs;

/// Where the fleets of the rows work; what they leave goes with the row.
const WORK: &str = "fleets";
/// Episodes of each worker, if nothing else is asked for.
const EACH: u32 = 8;
/// How long the members of a fleet may take to join.
const JOIN_WITHIN: Duration = Duration::from_secs(300);
/// How often progress is shown.
const SHOW_EVERY: Duration = Duration::from_millis(200);
/// Ticks of a second.
const TICKS_PER_SEC: f64 = 10.0;
/// Units of processor time in a second, as Linux tells them to programs.
const UNITS_PER_SEC: f64 = 100.0;

/// Runs `scale`.
///
/// # Errors
/// If anything is refused, or a service of a fleet is lost.
pub(crate) fn run(args: &ScaleArgs, log: &str) -> Result<Ended> {
    let files = scenarios::files(&args.scenarios)?;
    let plan = RunPlan {
        scenarios: files.clone(),
        policy: args.policy.clone(),
        duration: args.duration,
        networks: args.networks.clone(),
        ..RunPlan::default()
    };
    request::known(&plan)?;
    let repeated = args.workers.iter().enumerate().find(|(index, count)| args.workers[..*index].contains(count));
    if let Some((_, count)) = repeated {
        bail!("--workers names {count} twice");
    }
    ensure!(!args.out.join(sheet::FILE).exists(), "{} holds a benchmark: give another --out", args.out.display());
    let held = run_folder::take(&args.out, Earlier::Kept)?;
    held.set_aside.iter().for_each(|folder| answer(&format!("earlier measurement: {}", folder.display())));
    clear(&args.out.join(WORK))?;
    let runtime = ds_launch::runtime()?;
    let outcome = runtime.block_on(async {
        let measure = Measure { args, log, files, plan, bar: bar(0, "ticks"), drain: on_signals()? };
        measure.all().await
    });
    runtime.shutdown_timeout(Duration::from_secs(2));
    let scaling = outcome?;
    let report = scaling.report();
    page::write(&report, &args.out)?;
    report.warnings.iter().for_each(|warning| answer(warning));
    report.facts.iter().for_each(|(name, value)| answer(&format!("{name}: {value}")));
    report.tables.iter().for_each(|table| answer(&table.markdown()));
    answer(&format!("report: {}", args.out.join("report.html").display()));
    Ok(match scaling {
        scaling if scaling.missing > 0 => Ended::Interrupted,
        scaling if scaling.sound() => Ended::Complete,
        _ => Ended::Left,
    })
}

/// Deletes a folder, if it is there.
fn clear(folder: &Path) -> Result<()> {
    if folder.exists() {
        std::fs::remove_dir_all(folder).with_context(|| format!("remove {}", folder.display()))?;
    }
    Ok(())
}

/// A measurement under way.
struct Measure<'a> {
    args: &'a ScaleArgs,
    log: &'a str,
    files: Vec<PathBuf>,
    plan: RunPlan,
    bar: ProgressBar,
    drain: Drain,
}

/// What was used by a moment.
#[derive(Default)]
struct Used {
    processor_secs: [Option<f64>; 2],
    ledger_commits: u64,
    devices: usize,
}

impl Measure<'_> {
    /// Drives all rows; those that a signal kept from being driven are missing.
    async fn all(&self) -> Result<Scaling> {
        let ticks = |workers: u32| self.seeds(workers) * self.files.len() as u64 * self.ticks();
        self.bar.set_length(self.args.workers.iter().map(|workers| ticks(*workers)).sum());
        let (mut rows, mut done) = (Vec::new(), 0);
        for workers in &self.args.workers {
            let Some(row) = self.row(*workers, done).await.with_context(|| format!("{workers} workers"))? else {
                break;
            };
            rows.push(row);
            done += ticks(*workers);
            self.bar.set_position(done);
        }
        self.bar.finish_and_clear();
        let args = self.args;
        let kills = args.kill_every.map_or("none".to_owned(), |secs| format!("one worker each {secs} s"));
        Ok(Scaling {
            simulated_secs: args.simulated,
            cores: std::thread::available_parallelism()
                .map_or(1, |cores| u32::try_from(cores.get()).unwrap_or(u32::MAX)),
            facts: vec![
                ("program", env!("CARGO_PKG_VERSION").to_owned()),
                ("scenarios", self.files.len().to_string()),
                ("length of a drive", format!("{} s", args.duration)),
                ("policy", args.policy.clone()),
                ("kills", kills),
            ],
            missing: args.workers.len() - rows.len(),
            rows,
        })
    }

    fn ticks(&self) -> u64 {
        (self.args.duration * TICKS_PER_SEC).round() as u64
    }

    /// Returns on how many seeds a row drives each scenario: as many episodes for each worker in all rows, rounded up.
    fn seeds(&self, workers: u32) -> u64 {
        let most = self.args.workers.iter().copied().max().unwrap_or(1);
        seeds(self.args.episodes.unwrap_or(EACH * most), most, workers, self.files.len())
    }

    /// Drives one row; nothing after a signal.
    async fn row(&self, workers: u32, done: u64) -> Result<Option<Row>> {
        let folder = self.args.out.join(WORK).join(workers.to_string());
        let seed = (0..self.seeds(workers)).collect();
        let plan = RunPlan { seed, out: folder.clone(), ..self.plan.clone() };
        let given = request::given(&plan, &self.files)?;
        let configuration = request::configuration(&plan, &RunConfig::default(), &given)?;
        let sources = sources(&self.files, Source::Path)?;
        let request = request::request(&plan, &RunConfig::default(), given, &configuration, sources)?;
        let simulated_secs = self.args.simulated.unwrap_or_default();
        let fleet = FleetPlan { workers, simulated_secs, ..FleetPlan::of(&plan, 1)? };
        self.bar.set_message(format!("ticks, {workers} workers"));
        let mut fleet = Fleet::of_children(children::start(&fleet, self.log).await?);
        let row = self.measured(&mut fleet, workers, done, &request).await;
        let stopped = fleet.stop().await;
        let row = row?;
        stopped?;
        clear(&folder)?;
        Ok(row)
    }

    /// Drives on a fleet, with a worker killed now and then.
    async fn measured(
        &self,
        fleet: &mut Fleet,
        workers: u32,
        done: u64,
        request: &pb::SubmitRequest,
    ) -> Result<Option<Row>> {
        let control = Dial::local(&fleet.control)?;
        let channel = tokio::select! {
            channel = joined(&control, workers) => channel?,
            error = fleet.failed() => return Err(error),
            () = self.drain.cancelled() => return Ok(None),
        };
        let before = used(fleet, &channel).await?;
        let (began, mut killed) = (Instant::now(), 0);
        let mut shown = Progress { bar: &self.bar, done, last: began, ended: BTreeSet::new() };
        let mut show = |told: &EpisodeResults| shown.look(told);
        let drive = runs::drive(request, &control, &mut show);
        tokio::pin!(drive);
        // Without the only worker nothing is driven until its leases have run out: others are compared with an undisturbed one.
        let every = self.args.kill_every.filter(|_| workers > 1).map(Duration::from_secs_f64);
        let mut next = every.map(|every| tokio::time::Instant::now() + every);
        let run = loop {
            let kill = async move { tokio::time::sleep_until(next.unwrap_or_else(tokio::time::Instant::now)).await };
            tokio::select! {
                ended = &mut drive => break ended?.run,
                error = fleet.failed() => return Err(error),
                () = self.drain.cancelled() => return Ok(None),
                () = kill, if next.is_some() => {
                    fleet.children().context("the fleet has no processes")?.kill("vdm-worker", killed)?;
                    killed += 1;
                    next = next.zip(every).map(|(now, every)| now + every);
                }
            }
        };
        let wall_secs = began.elapsed().as_secs_f64();
        let after = used(fleet, &channel).await?;
        let spent = |role: usize| Some(after.processor_secs[role]? - before.processor_secs[role]?);
        let row = Row {
            workers,
            devices: after.devices,
            wall_secs,
            processor_secs: [spent(0), spent(1)],
            ledger_commits: after.ledger_commits.saturating_sub(before.ledger_commits),
            killed,
            ..Row::default()
        };
        Ok(Some(filled(row, &run, self.args.simulated.is_some())))
    }
}

/// Returns on how many seeds each of some scenarios is driven, so that each worker has as many episodes as those of the
/// largest row have.
fn seeds(episodes: u32, most: u32, workers: u32, scenarios: usize) -> u64 {
    let mine = (u64::from(episodes) * u64::from(workers)).div_ceil(u64::from(most.max(1)));
    mine.div_ceil(scenarios.max(1) as u64)
}

/// Adds what the episodes of a run say. Nothing in a simulated drive is drawn, so its seeds are repetitions.
fn filled(row: Row, run: &pb::Run, simulated: bool) -> Row {
    let all = &run.episodes;
    for episode in all.iter().filter(|episode| episode.status != i32::from(pb::Status::Completed)) {
        tracing::warn!(episode = episode.episode, reason = episode.reason, "did not complete");
    }
    let completed = all.iter().filter(|episode| episode.status == i32::from(pb::Status::Completed));
    let completed = completed.map(|episode| Completed {
        name: if simulated { &episode.scenario } else { &episode.episode }.clone(),
        digests: [&episode.world_digest, &episode.layout_digest, &episode.frame_digest].map(|digest| hex(digest)),
    });
    let video_secs =
        |episode: &pb::EpisodeResult| episode.time_share.get("video").copied().unwrap_or_default() * episode.wall_secs;
    Row {
        episodes: all.len(),
        ticks: all.iter().map(|episode| u64::from(episode.ticks)).sum(),
        overhead_secs: all
            .iter()
            .flat_map(|e| e.overhead_micros.iter().map(|micros| f64::from(*micros) * 1e-6))
            .collect(),
        generation_secs: all.iter().map(video_secs).sum(),
        completed: completed.collect(),
        ..row
    }
}

/// Waits until all members of a fleet have joined.
async fn joined(control: &Dial, workers: u32) -> Result<Control> {
    let all = async {
        let channel = loop {
            match control.connect(Duration::from_secs(5)).await {
                Ok(channel) => break channel,
                Err(_early) => tokio::time::sleep(Duration::from_millis(100)).await,
            }
        };
        let there = |members: &pb::ListInstancesResponse, role: Role| {
            let one = |member: &&pb::Instance| member.hello.as_ref().is_some_and(|hello| hello.role == pb::role(role));
            members.instances.iter().filter(one).count()
        };
        loop {
            let members = listed(&channel).await?;
            let due = |role: Role| if role == Role::Video { workers as usize } else { 1 };
            if Role::ALL.into_iter().all(|role| there(&members, role) >= due(role)) {
                return anyhow::Ok(channel);
            }
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    };
    let late = || format!("the members did not join in {} s", JOIN_WITHIN.as_secs());
    tokio::time::timeout(JOIN_WITHIN, all).await.with_context(late)?
}

async fn listed(channel: &Control) -> Result<pb::ListInstancesResponse> {
    let members = FleetClient::new(channel.clone()).list(pb::ListInstancesRequest {}).await;
    Ok(members.context("orchestrator")?.into_inner())
}

/// Looks at what was used so far.
async fn used(fleet: &mut Fleet, channel: &Control) -> Result<Used> {
    let members = listed(channel).await?;
    let devices: BTreeSet<&str> = members.instances.iter().map(|member| member.device.as_str()).collect();
    let children = fleet.children().context("the fleet has no processes")?;
    let processor_secs = ["orchestrator", "sim-server"].map(|name| processor_secs(children.pid(name)?));
    let devices = devices.iter().filter(|device| !device.is_empty()).count();
    Ok(Used { processor_secs, ledger_commits: members.ledger_commits, devices })
}

/// Returns the processor time of a process in seconds, where the system tells it in `/proc`.
fn processor_secs(pid: u32) -> Option<f64> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    let (_, after_name) = stat.rsplit_once(')')?;
    // Of all fields the fourteenth and fifteenth, `utime` and `stime`; the name was the second.
    let units: Vec<f64> =
        after_name.split_whitespace().skip(11).take(2).map(str::parse).collect::<Result<_, _>>().ok()?;
    (units.len() == 2).then(|| units.iter().sum::<f64>() / UNITS_PER_SEC)
}

/// What the bar shows of a row, and whose recordings are gone.
struct Progress<'a> {
    bar: &'a ProgressBar,
    done: u64,
    last: Instant,
    ended: BTreeSet<String>,
}

impl Progress<'_> {
    fn look(&mut self, told: &EpisodeResults) {
        if self.last.elapsed() < SHOW_EVERY {
            return;
        }
        self.last = Instant::now();
        self.bar.set_position(self.done + told.values().map(|episode| u64::from(episode.ticks)).sum::<u64>());
        for episode in told.values().filter(|episode| pb::has_ended(episode.status)) {
            if self.ended.insert(episode.episode.clone())
                && let Err(error) = std::fs::remove_file(&episode.recording)
            {
                tracing::debug!(recording = episode.recording, %error, "not removed");
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_worker_has_as_many_episodes() {
        assert_eq!([1, 64, 200].map(|workers| 8 * seeds(10_000, 200, workers, 8)), [56, 3_200, 10_000]);
        assert_eq!([1, 2].map(|workers| seeds(3, 2, workers, 1)), [2, 3]);
    }

    #[test]
    fn the_own_processor_time_can_be_read() {
        let own = processor_secs(std::process::id());
        assert!(!Path::new("/proc/self/stat").exists() || own.is_some_and(|secs| secs >= 0.0), "{own:?}");
        assert_eq!(processor_secs(u32::MAX), None);
    }
}
