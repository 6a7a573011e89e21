//! A drive under way, tick by tick and without holes: pushes in order, and pulls from the journal for what was missed.

use std::time::Duration;

use anyhow::{Result, ensure};
use ds_bus::{BusSession, Holder, Subscription};
use ds_space::{AttemptId, EpisodeId};
use ds_topic::{Envelope, SceneMessage, Slot, Topic};
use tokio::sync::mpsc;
use tokio::task::JoinSet;

use crate::onlooker::{ends_drive, scene_of};

/// How long a drive may be silent before it is taken to be over.
const SILENT_FOR: Duration = Duration::from_secs(120);
/// States that wait for whoever listens; a full queue holds the listener up, not the drive.
const WAITING: usize = 256;
/// How long the journal may take to answer, and how often it is asked for a state that it does not have yet.
const PULL_WITHIN: Duration = Duration::from_millis(500);
const PULLS: u32 = 3;
const PULL_AGAIN: Duration = Duration::from_millis(100);

/// A drive that is listened to; ends when dropped.
pub struct HeardDrive {
    /// Its scene.
    pub scene: SceneMessage,
    /// Its `world` messages in order of attempt and tick; closed at the end of the drive.
    pub worlds: mpsc::Receiver<Envelope>,
    _listener: JoinSet<()>,
}

impl HeardDrive {
    /// Listens to a drive.
    ///
    /// # Errors
    /// If nobody drives it, or it has no vehicle log.
    pub async fn listen(bus: &BusSession, episode: &EpisodeId) -> Result<Self> {
        let pushes = bus.subscribe(episode, &[Topic::World, Topic::Event]).await?;
        let scene = scene_of(bus, episode).await?;
        ensure!(scene.spec.vehicle_log, "{episode} has no vehicle log to diagnose: submit it with --vehicle-log");
        let (told, worlds) = mpsc::channel(WAITING);
        let listener = Listener { bus: bus.clone(), episode: episode.clone(), told };
        let mut tasks = JoinSet::new();
        tasks.spawn(listener.hear(pushes));
        Ok(Self { scene, worlds, _listener: tasks })
    }
}

struct Listener {
    bus: BusSession,
    episode: EpisodeId,
    told: mpsc::Sender<Envelope>,
}

impl Listener {
    /// Passes states on until the drive ends, falls silent, or nobody listens any more.
    async fn hear(self, mut pushes: Subscription) {
        let (mut attempt, mut next) = (AttemptId(0), 0);
        while let Ok(envelope) = tokio::time::timeout(SILENT_FOR, pushes.recv()).await {
            if envelope.header.slot.topic == Topic::Event {
                if ends_drive(&envelope) {
                    return;
                }
                continue;
            }
            let (found, tick) = (envelope.header.attempt, envelope.header.tick.0);
            if found > attempt {
                (attempt, next) = (found, 0);
            }
            if found < attempt || tick < next {
                continue;
            }
            for missed in next..tick {
                if let Some(missed) = self.pull(missed, attempt).await
                    && self.told.send(missed).await.is_err()
                {
                    return;
                }
            }
            next = tick + 1;
            if self.told.send(envelope).await.is_err() {
                return;
            }
        }
    }

    async fn pull(&self, tick: u32, attempt: AttemptId) -> Option<Envelope> {
        for _ in 0..PULLS {
            let slot = Slot::new(Topic::World, tick);
            match self.bus.pull(&self.episode, &Holder::Journal, slot, PULL_WITHIN).await {
                Ok(Some(envelope)) => return Some(envelope).filter(|found| found.header.attempt == attempt),
                Ok(None) => tokio::time::sleep(PULL_AGAIN).await,
                Err(_closed) => return None,
            }
        }
        None
    }
}
