//! `gap watch`: diagnoses a drive while it goes on, in a sliding window, and says so on the bus and in a running viewer.
//!
//! What the car recorded is diagnosed against the nominal car of its scenario; with a reference stream it is the
//! reference's log that counts as real, and the running drive stands for the nominal simulator; with a baseline the detector
//! of recorded logs looks on, and windows are diagnosed from its first alarm on, against the baseline; its evidence goes on
//! from drive to drive where several are watched. Each window gives one message on topic `diagnosis`. A diagnosis runs beside
//! the subscription: a slow one skips windows and holds nothing up.

pub(super) mod recorded;

use std::io::Write as _;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use ds_bus::BusSession;
use ds_cases::alarms::Alarms;
use ds_cases::logs;
use ds_cases::message::{self, Against};
use ds_cases::reference::{Reference, differences};
use ds_cases::window::{self, Due, Window};
use ds_diagnosis::{CaseError, Diagnosis};
use ds_dynamics::baseline::Baseline;
use ds_dynamics::watch::Alarm;
use ds_dynamics::{Options, diagnose};
use ds_launch::onlooker::{self as viewer, Onlooker};
use ds_process::heard::HeardDrive;
use ds_process::onlooker;
use ds_process::section::ProcessSection;
use ds_process::terminal::answer;
use ds_space::{AttemptId, EpisodeId, InstanceId};
use ds_topic::{Envelope, SceneMessage, World};
use ds_wire::Body;
use ds_wire::control as pb;
use ds_world::Reading;
use pb::runs_client::RunsClient;
use tokio::task::JoinSet;

use crate::cli::WatchArgs;
use crate::tell;

/// Between two looks for a drive: a short one without frames is over in a few tenths of a second.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// Runs the command until the drive ends.
///
/// # Errors
/// If router, orchestrator or viewer cannot be reached, a drive has no vehicle log, or the reference cannot be read.
pub(crate) async fn run(args: &WatchArgs) -> Result<()> {
    let both = args.baseline.is_some() && args.reference.is_some();
    ensure!(!both, "a baseline judges the drive's own log: leave --reference out");
    let baseline = args.baseline.as_deref().map(|path| recorded::baseline(args, path)).transpose()?;
    args.connect.as_deref().map(viewer::reach).transpose()?;
    let log = args.reference.as_deref().filter(|given| Path::new(given).is_file());
    let log = log.map(|path| Reference::read(Path::new(path))).transpose()?;
    let bus = args.fleet.join().await?;
    let mut runs = args.fleet.runs().await?;
    answer(&format!("waiting for {}", if args.episode().is_empty() { "a drive" } else { args.episode() }));
    let named = args.reference.as_deref().filter(|_| log.is_none());
    let refers = |name: &str| named.is_some_and(|part| name.contains(part));
    let first = next_drive(&bus, &mut runs, |name| name.contains(args.episode()) && !refers(name)).await?;
    let other = match named {
        None => None,
        Some(_) => {
            let other = under_way(&mut runs, refers).await?;
            answer(&format!("reference {other}"));
            Some(HeardDrive::listen(&bus, &other).await?)
        }
    };
    let reference = log.or_else(|| other.as_ref().map(|other| Reference::of_drive(other.scene.spec.episode.as_str())));
    let mut watch = Watch::new(args, &bus, &first.scene, reference)?;
    if let Some(baseline) = baseline {
        watch.against(baseline)?;
    }
    watch.shown(first, other).await?;
    let mut seen = vec![watch.scene.spec.episode.to_string()];
    while seen.len() < args.drives {
        answer(&format!("waiting for drive {} of {}", seen.len() + 1, args.drives));
        let fresh = |name: &str| name.contains(args.episode()) && !seen.iter().any(|seen| seen == name);
        let drive = next_drive(&bus, &mut runs, fresh).await?;
        seen.push(drive.scene.spec.episode.to_string());
        watch.next(&drive.scene);
        watch.shown(drive, None).await?;
    }
    watch.close().await
}

/// Waits for a drive and listens to it.
async fn next_drive(
    bus: &BusSession,
    runs: &mut RunsClient<ds_process::security::Control>,
    wanted: impl Fn(&str) -> bool,
) -> Result<HeardDrive> {
    let episode = under_way(runs, wanted).await?;
    let drive = HeardDrive::listen(bus, &episode).await?;
    answer(&format!("watching {episode}"));
    Ok(drive)
}

/// Waits for a drive.
async fn under_way(
    runs: &mut RunsClient<ds_process::security::Control>,
    wanted: impl Fn(&str) -> bool,
) -> Result<EpisodeId> {
    loop {
        let driven = onlooker::under_way(runs).await?;
        if let Some(found) = driven.iter().find(|driven| wanted(&driven.episode)) {
            return EpisodeId::new(&found.episode).context("name of an episode");
        }
        tokio::time::sleep(LOOK_EVERY).await;
    }
}

/// Waits for the next state of a drive that may not be there; `None` at its end.
async fn next(drive: &mut Option<HeardDrive>) -> Option<Envelope> {
    match drive {
        Some(drive) => drive.worlds.recv().await,
        None => std::future::pending().await,
    }
}

/// What became of a window.
struct Made {
    due: Due,
    against: Against,
    result: Result<Diagnosis, CaseError>,
}

/// A drive that is watched.
struct Watch<'a> {
    args: &'a WatchArgs,
    bus: &'a BusSession,
    scene: SceneMessage,
    publisher: InstanceId,
    window: Window,
    reference: Option<Reference>,
    shown: Option<Onlooker>,
    jobs: JoinSet<Made>,
    published: u64,
    guard: Option<Guard>,
}

/// What healthy drives say of the drive: nothing is diagnosed before an alarm.
struct Guard {
    alarms: Alarms,
    baseline: Arc<Baseline>,
    raised: usize,
    attempt: Option<AttemptId>,
}

impl<'a> Watch<'a> {
    fn new(
        args: &'a WatchArgs,
        bus: &'a BusSession,
        scene: &SceneMessage,
        reference: Option<Reference>,
    ) -> Result<Self> {
        ensure!(args.window >= window::SHORTEST_SECS, "--window {} is below {}", args.window, window::SHORTEST_SECS);
        ensure!(args.every > 0.0, "--every {} is not above 0", args.every);
        let switched: Vec<String> = scene.spec.effects.iter().map(|e| format!("{} = {:?}", e.id, e.values)).collect();
        if reference.is_some() && !switched.is_empty() {
            answer(&format!("the running simulator has {}: what equals it is closed already", switched.join(", ")));
        }
        let publisher = ds_process::service::instance(&ProcessSection::default(), "gap")?;
        let window = Window::new(args.window, args.every);
        let jobs = JoinSet::new();
        let scene = scene.clone();
        Ok(Self { args, bus, scene, publisher, window, reference, shown: None, jobs, published: 0, guard: None })
    }

    /// Turns to another drive; what was seen of the one before stays evidence.
    fn next(&mut self, scene: &SceneMessage) {
        self.scene = scene.clone();
        self.window = Window::new(self.args.window, self.args.every);
        if let Some(guard) = &mut self.guard {
            guard.alarms.turn_to(logs::meta(&scene.scene.vehicle, scene.spec.episode.as_str()));
            guard.attempt = None;
        }
    }

    /// Watches for alarms against a baseline.
    fn against(&mut self, baseline: Arc<Baseline>) -> Result<()> {
        let meta = logs::meta(&self.scene.scene.vehicle, self.scene.spec.episode.as_str());
        let alarms = Alarms::new(baseline.clone(), self.args.alarms_per_hour, meta)?;
        self.guard = Some(Guard { alarms, baseline, raised: 0, attempt: None });
        Ok(())
    }

    /// Watches a drive, and shows it where a viewer was asked for.
    async fn shown(&mut self, drive: HeardDrive, other: Option<HeardDrive>) -> Result<()> {
        if let Some(last) = self.shown.take() {
            last.finish().await?;
        }
        if let Some(url) = &self.args.connect {
            let which = [self.scene.spec.episode.as_str(), "--diagnosed"];
            self.shown = Some(Onlooker::start(viewer::drives(&self.args.fleet, url, &which)).await?);
        }
        self.follow(drive, other).await
    }

    /// Watches until the drive is over and its last window diagnosed.
    async fn follow(&mut self, mut drive: HeardDrive, mut other: Option<HeardDrive>) -> Result<()> {
        let mut over = false;
        while !(over && self.jobs.is_empty()) {
            tokio::select! {
                world = drive.worlds.recv(), if !over => match world {
                    Some(world) => self.take(world)?,
                    None => over = true,
                },
                world = next(&mut other) => match world {
                    Some(world) => self.compare(&world)?,
                    None => self.end_reference(&mut other),
                },
                Some(made) = self.jobs.join_next() => {
                    self.conclude(made.context("the diagnosis panicked")?).await?;
                }
            }
            self.begin(over);
        }
        Ok(())
    }

    fn take(&mut self, world: Envelope) -> Result<()> {
        let readings = World::from_bytes(&world.body).context("world")?.readings;
        let found = match &mut self.guard {
            // a window costs more than a task may hold its thread up for
            Some(guard) => tokio::task::block_in_place(|| guard.take(world.header.attempt, &readings))?,
            None => Vec::new(),
        };
        for alarm in found {
            answer(&recorded::line(&alarm));
            let line = serde_json::json!({ "t": alarm.secs, "alarm": alarm });
            self.args.out.as_deref().map_or(Ok(()), |path| append(path, &line))?;
        }
        self.window.take(world.header, readings);
        Ok(())
    }

    fn compare(&mut self, world: &Envelope) -> Result<()> {
        let readings = World::from_bytes(&world.body).context("world of the reference")?.readings;
        if let Some(reference) = &mut self.reference {
            reference.take(world.header.tick, readings);
        }
        Ok(())
    }

    fn end_reference(&mut self, other: &mut Option<HeardDrive>) {
        *other = None;
        if let Some(reference) = &self.reference {
            answer(&format!("{} ended at {:.1} s", reference.name, reference.known_to_secs()));
        }
    }

    /// Diagnoses the window in the background where one is due and none is under way.
    fn begin(&mut self, over: bool) {
        if !self.jobs.is_empty() || self.guard.as_ref().is_some_and(|guard| guard.raised == 0) {
            return;
        }
        let known_to = self.reference.as_ref().map_or(f64::INFINITY, Reference::known_to_secs);
        let Some(due) = self.window.due(known_to, over) else { return };
        let (log, against) = match &self.reference {
            None => (due.readings.clone(), Against::default()),
            Some(reference) => {
                let Some(log) = reference.within(due.span.0, due.span.1) else { return };
                let differences = differences(&due.readings, &log);
                (log, Against { reference: reference.name.clone(), differences })
            }
        };
        let car = self.scene.scene.vehicle;
        let case =
            if against.reference.is_empty() { self.scene.spec.episode.to_string() } else { against.reference.clone() };
        let baseline = self.guard.as_ref().map(|guard| guard.baseline.clone());
        self.jobs.spawn_blocking(move || {
            let options = Options { quick: true, without: Vec::new() };
            let made = logs::window(&log, &car, &case);
            let made = made.and_then(|case| match baseline {
                Some(baseline) => case.against(baseline),
                None => Ok(case),
            });
            Made { due, against, result: made.map(|case| diagnose(&case, &options)) }
        });
    }

    /// Tells what was found: on the bus, in the viewer, on the screen and in the file.
    async fn conclude(&mut self, made: Made) -> Result<()> {
        let Made { due, against, result } = made;
        let found = match result {
            Ok(found) => found,
            Err(error) => {
                answer(&format!("{:.1} s: {error}", due.span.1));
                return Ok(());
            }
        };
        let body = message::body(&found, due.span.0, due.span.1, against);
        let envelope = message::envelope(&due.header, &self.publisher, self.published, &body);
        self.bus.publish(&envelope).await?;
        self.published += 1;
        tell(&format!("{:.1} s", due.span.1), &found);
        let line = serde_json::json!({ "t": due.span.1, "diagnosis": found });
        self.args.out.as_deref().map_or(Ok(()), |path| append(path, &line))
    }

    /// Says what was shown.
    async fn close(self) -> Result<()> {
        if let Some(Guard { alarms: Alarms { watch, .. }, raised, .. }) = &self.guard {
            recorded::strange(watch).iter().for_each(|said| answer(said));
            let (windows, hours, rate) = (watch.windows, watch.hours(), self.args.alarms_per_hour);
            answer(&format!(
                "{raised} alarms in {windows} windows judged against the baseline, {hours:.3} h; {rate} false ones an hour are allowed"
            ));
        }
        answer(&format!("{} windows diagnosed", self.published));
        // What was put last is on its way before the session closes.
        self.bus.close().await.context("leave the bus")?;
        match self.shown {
            Some(shown) => shown.finish().await,
            None => Ok(()),
        }
    }
}

impl Guard {
    /// Takes what was recorded up to a state; another attempt at the episode begins anew.
    fn take(&mut self, attempt: AttemptId, readings: &[Reading]) -> Result<Vec<Alarm>> {
        if self.attempt.replace(attempt).is_some_and(|last| last != attempt) {
            self.alarms.restart();
        }
        let found = self.alarms.take(readings)?;
        self.raised += found.len();
        Ok(found)
    }
}

/// Adds one line of JSON.
fn append(path: &Path, line: &serde_json::Value) -> Result<()> {
    let failed = || format!("write {}", path.display());
    let mut file = std::fs::OpenOptions::new().create(true).append(true).open(path).with_context(failed)?;
    writeln!(file, "{line}").with_context(failed)
}
