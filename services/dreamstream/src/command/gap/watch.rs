//! `gap watch`: diagnoses a drive while it goes on, from what the car recorded in a sliding window.
//!
//! The bus carries the vehicle log of a drive that was submitted with one; the nominal car is that of the scenario. The
//! diagnosis runs beside the subscription, so a slow one skips windows instead of holding anything up.

use std::collections::VecDeque;
use std::io::Write as _;
use std::path::Path;
use std::time::Duration;

use anyhow::{Context, Result};
use ds_bus::{BusSession, Holder};
use ds_gap::{Diagnosis, GapError, Options, diagnose};
use ds_space::EpisodeId;
use ds_topic::{Event, EventKind, SceneMessage, Slot, Topic, World};
use ds_wire::Body;
use ds_wire::control as pb;
use ds_world::Reading;
use pb::runs_client::RunsClient;

use super::{logs, tell};
use crate::cli::WatchArgs;
use crate::command::{answer, view};
use crate::live;

/// Shorter windows tell nothing.
const SHORTEST_SECS: f64 = 6.5;
const ASK_EVERY: Duration = Duration::from_millis(300);
/// How long a drive may be silent before it is taken to be over.
const SILENT_FOR: Duration = Duration::from_secs(120);

/// Runs the command until the drive ends.
///
/// # Errors
/// If router or orchestrator cannot be reached, or the drive has no vehicle log.
pub(crate) async fn run(args: &WatchArgs) -> Result<()> {
    let bus = view::join(&args.bus, args.certificate.as_deref(), &args.control).await?;
    let control = args.control.dial()?.connect(Duration::from_secs(5)).await.context("orchestrator does not answer")?;
    let mut runs = RunsClient::new(control);
    let episode = loop {
        let driven = live::under_way(&mut runs).await?;
        if let Some(found) = driven.iter().find(|driven| driven.episode.contains(&args.episode)) {
            break EpisodeId::new(&found.episode).context("name of an episode")?;
        }
        tokio::time::sleep(ASK_EVERY).await;
    };
    answer(&format!("watching {episode}"));
    follow(args, &bus, &episode).await
}

async fn follow(args: &WatchArgs, bus: &BusSession, episode: &EpisodeId) -> Result<()> {
    let mut pushes = bus.subscribe(episode, &[Topic::World, Topic::Event]).await?;
    let scene = loop {
        let asked = bus.pull(episode, &Holder::Journal, Slot::new(Topic::Scene, 0), Duration::from_secs(1)).await?;
        if let Some(envelope) = asked {
            break SceneMessage::from_bytes(&envelope.body).context("scene")?;
        }
    };
    anyhow::ensure!(scene.spec.vehicle_log, "{episode} has no vehicle log: drive with --vehicle-log");
    let folder = std::env::temp_dir().join(format!("dreamstream-watch-{}", std::process::id()));
    let mut window = Window { readings: VecDeque::new(), secs: args.window, next_secs: SHORTEST_SECS };
    while let Ok(envelope) = tokio::time::timeout(SILENT_FOR, pushes.recv()).await {
        if envelope.header.slot.topic == Topic::Event {
            let event = Event::from_bytes(&envelope.body);
            if event.is_ok_and(|e| matches!(e.kind, EventKind::Completed | EventKind::Failed | EventKind::Aborted)) {
                break;
            }
            continue;
        }
        window.take(World::from_bytes(&envelope.body).context("world")?.readings);
        if let Some((now, readings)) = window.due(args.every) {
            logs::window(&readings, &scene.scene.vehicle, &folder)?;
            let case = folder.clone();
            let made = tokio::task::spawn_blocking(move || diagnose(&case, &quick()))
                .await
                .context("the diagnosis panicked")?;
            report(args, now, made)?;
        }
    }
    if folder.exists() {
        std::fs::remove_dir_all(&folder).with_context(|| format!("remove {}", folder.display()))?;
    }
    Ok(())
}

fn quick() -> Options {
    Options { quick: true, without: Vec::new() }
}

fn report(args: &WatchArgs, now_secs: f64, made: Result<Diagnosis, GapError>) -> Result<()> {
    match made {
        Ok(diagnosis) => {
            tell(&format!("{now_secs:.1} s"), &diagnosis);
            args.out.as_deref().map_or(Ok(()), |path| append(path, now_secs, &diagnosis))
        }
        Err(error) => {
            answer(&format!("{now_secs:.1} s: {error}"));
            Ok(())
        }
    }
}

/// Adds one line of JSON.
fn append(path: &Path, now_secs: f64, diagnosis: &Diagnosis) -> Result<()> {
    let failed = || format!("write {}", path.display());
    let mut file = std::fs::OpenOptions::new().create(true).append(true).open(path).with_context(failed)?;
    let line = serde_json::json!({ "t": now_secs, "diagnosis": diagnosis });
    writeln!(file, "{line}").with_context(failed)
}

/// The last seconds of a drive.
struct Window {
    readings: VecDeque<Reading>,
    secs: f64,
    next_secs: f64,
}

impl Window {
    fn take(&mut self, readings: Vec<Reading>) {
        // A push that comes twice, or late, is left out.
        let newest = self.readings.back().map_or(f64::NEG_INFINITY, |reading| reading.secs);
        self.readings.extend(readings.into_iter().filter(|reading| reading.secs > newest));
        while self.readings.front().is_some_and(|first| newest - first.secs > self.secs) {
            self.readings.pop_front();
        }
    }

    /// Returns the window where a diagnosis is due, with the time of its end.
    fn due(&mut self, every_secs: f64) -> Option<(f64, Vec<Reading>)> {
        let (first, last) = (self.readings.front()?.secs, self.readings.back()?.secs);
        if last < self.next_secs || last - first < SHORTEST_SECS - 0.5 {
            return None;
        }
        self.next_secs = last + every_secs;
        Some((last, self.readings.iter().copied().collect()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_window_slides_and_ignores_repeats() {
        let mut window = Window { readings: VecDeque::new(), secs: 8.0, next_secs: SHORTEST_SECS };
        let tick = |k: u32| vec![Reading { secs: f64::from(k) * 0.1, ..Reading::default() }];
        let mut due = Vec::new();
        for k in (0..200).flat_map(|k| [k, k / 2]) {
            window.take(tick(k));
            due.extend(window.due(2.0).map(|(now, readings)| (now, readings.len())));
        }
        assert!(due.len() >= 6 && due.windows(2).all(|pair| pair[1].0 >= pair[0].0 + 2.0), "{due:?}");
        assert!(due.iter().all(|(_, count)| *count <= 83), "{due:?}");
    }
}
