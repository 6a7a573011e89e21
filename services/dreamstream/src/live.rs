//! Feeds drives under way to a running rerun viewer. Queues are bounded and drop: a viewer never holds a drive up.
//!
//! The orchestrator says which drives there are; the journal gives the scene, the bus the rest.

use std::collections::BTreeSet;
use std::time::Duration;

use anyhow::{Context, Result};
use ds_bus::{BusSession, Holder};
use ds_process::security::{Control, Dial};
use ds_record::view::{self, LiveView, Shown};
use ds_space::EpisodeId;
use ds_topic::{EventKind, SceneMessage, Slot, Topic};
use ds_wire::Body;
use ds_wire::control as pb;
use pb::runs_client::RunsClient;
use tokio::task::JoinSet;

/// Messages that wait for the viewer.
const QUEUE: usize = 1_024;
/// How often the orchestrator is asked for new drives.
const ASK_EVERY: Duration = Duration::from_millis(300);
/// How often a journal is asked for its scene.
const SCENE_TRIES: u32 = 20;
/// How long a viewer may take to answer.
const VIEWER_WITHIN: Duration = Duration::from_secs(3);
/// How long a drive may be silent before it is taken to be over.
const SILENT_FOR: Duration = Duration::from_secs(120);

/// Which drives to show, and where.
#[derive(Debug, Clone)]
pub(crate) struct Watch {
    /// A part of the episode's name; empty for any.
    pub episode: String,
    /// The viewer; empty for the default one of this host.
    pub url: String,
    /// Whether to end after one drive.
    pub one: bool,
}

impl Watch {
    /// Returns the viewer's address.
    pub(crate) fn url(&self) -> &str {
        if self.url.is_empty() { view::DEFAULT_URL } else { &self.url }
    }

    /// Checks that a viewer listens: the stream to it would wait for one for ever.
    ///
    /// # Errors
    /// If nothing listens, or the address is none.
    pub(crate) async fn reach(&self) -> Result<()> {
        let url = self.url();
        let address = url.split_once("://").map_or(url, |(_, rest)| rest);
        let address = address.split('/').next().unwrap_or_default().to_owned();
        let connected = tokio::time::timeout(VIEWER_WITHIN, tokio::net::TcpStream::connect(&address)).await;
        connected
            .map_err(anyhow::Error::new)
            .and_then(|connected| {
                let _: () = drop(connected?);
                Ok(())
            })
            .with_context(|| format!("no rerun viewer listens at {url}: start `rerun --bind 127.0.0.1` first"))
    }
}

/// Shows drives as they begin, until the first ended or for ever.
///
/// # Errors
/// If the orchestrator or the viewer cannot be reached.
pub(crate) async fn follow(bus: BusSession, control: Dial, watch: Watch) -> Result<()> {
    watch.reach().await?;
    let channel = control.connect(Duration::from_secs(5)).await.context("orchestrator does not answer")?;
    let mut runs = RunsClient::new(channel);
    let mut known = BTreeSet::new();
    let mut shown = JoinSet::new();
    let mut beat = tokio::time::interval(ASK_EVERY);
    loop {
        tokio::select! {
            Some(ended) = shown.join_next() => {
                let (episode, Shown { logged, dropped, .. }) = ended.context("the view panicked")??;
                tracing::info!(%episode, logged, dropped, "shown");
                if watch.one {
                    return Ok(());
                }
            }
            _ = beat.tick(), if !watch.one || known.is_empty() => {
                for episode in under_way(&mut runs).await? {
                    let wanted = episode.episode.contains(&watch.episode) && (!watch.one || known.is_empty());
                    if wanted && known.insert(episode.episode.clone()) {
                        let named = EpisodeId::new(&episode.episode).context("name of an episode")?;
                        shown.spawn(show(bus.clone(), named, watch.url().to_owned()));
                    }
                }
            }
        }
    }
}

/// Returns the episodes that are being driven.
///
/// # Errors
/// If the orchestrator refuses.
pub(crate) async fn under_way(runs: &mut RunsClient<Control>) -> Result<Vec<pb::EpisodeResult>> {
    let mut found = Vec::new();
    for run in runs.list(pb::ListRequest { limit: 0 }).await.context("orchestrator")?.into_inner().runs {
        if run.status != i32::from(pb::Status::Running) {
            continue;
        }
        let run = runs.get(pb::GetRequest { run_id: run.run_id }).await.context("orchestrator")?.into_inner();
        let driven = |episode: &pb::EpisodeResult| episode.status == i32::from(pb::Status::Running);
        found.extend(run.episodes.into_iter().filter(driven));
    }
    Ok(found)
}

/// Returns the scene of a drive under way.
///
/// # Errors
/// If no journal gives it.
pub(crate) async fn scene_of(bus: &BusSession, episode: &EpisodeId) -> Result<SceneMessage> {
    for _ in 0..SCENE_TRIES {
        let asked = bus.pull(episode, &Holder::Journal, Slot::new(Topic::Scene, 0), Duration::from_secs(1)).await?;
        if let Some(envelope) = asked {
            return SceneMessage::from_bytes(&envelope.body).context("scene");
        }
        tokio::time::sleep(ASK_EVERY).await;
    }
    anyhow::bail!("nobody gives the scene of {episode}: is it still being driven, and may this certificate ask?")
}

async fn show(bus: BusSession, episode: EpisodeId, url: String) -> Result<(EpisodeId, Shown)> {
    let mut pushes = bus.subscribe(&episode, &Topic::ALL).await?;
    let scene = scene_of(&bus, &episode).await?;
    let stream = view::connect(&scene, &url).with_context(|| format!("viewer at {url}"))?;
    let live = LiveView::start(&scene, stream, QUEUE, &[])?;
    while let Ok(envelope) = tokio::time::timeout(SILENT_FOR, pushes.recv()).await {
        let over = envelope.header.slot.topic == Topic::Event && ends(&envelope.body);
        live.feed(envelope);
        if over {
            break;
        }
    }
    let shown = tokio::task::spawn_blocking(move || live.finish()).await.context("the view panicked")??;
    Ok((episode, shown))
}

fn ends(body: &[u8]) -> bool {
    let event = ds_topic::Event::from_bytes(body);
    event.is_ok_and(|event| matches!(event.kind, EventKind::Completed | EventKind::Failed | EventKind::Aborted))
}
