//! Feeds drives under way to a running window. Queues are bounded and drop: a viewer never holds a drive up.
//!
//! The orchestrator says which drives there are; the journal gives the scene and what was driven before, the bus the rest.

use std::collections::BTreeSet;
use std::time::Duration;

use anyhow::{Context, Result};
use ds_bus::{BusSession, Holder};
use ds_process::onlooker::{OnlookerArgs, ends_drive, scene_of, under_way};
use ds_space::EpisodeId;
use ds_topic::{Slot, Topic};
use tokio::task::JoinSet;

use crate::stream::connect;
use crate::{LiveCounts, LiveView};

/// Messages that wait for the window.
const QUEUE: usize = 1_024;
/// How often the orchestrator is asked for new drives.
const ASK_EVERY: Duration = Duration::from_millis(300);
/// How long the journal may take to give a state.
const PULL_WITHIN: Duration = Duration::from_millis(500);
/// How long a window may take to answer.
const WINDOW_WITHIN: Duration = Duration::from_secs(3);
/// How long a drive may be silent before it is taken to be over.
const SILENT_FOR: Duration = Duration::from_secs(120);
/// What is under way when the watch is told to end arrives within this time.
const LAST_WORDS: Duration = Duration::from_millis(500);

/// Which drives are shown.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Watch {
    /// Those whose name holds a text, as they begin.
    All(String),
    /// The first of them, until it ends.
    First(String),
    /// The one of this name with the diagnoses that are put beside it, also after its end.
    Diagnosed(EpisodeId),
}

/// Checks that a window listens: the stream to it would wait for one for ever.
///
/// # Errors
/// If nothing listens, or the address is none.
pub async fn reach(url: &str) -> Result<()> {
    let address = url.split_once("://").map_or(url, |(_, rest)| rest);
    let address = address.split('/').next().unwrap_or_default().to_owned();
    let connected = tokio::time::timeout(WINDOW_WITHIN, tokio::net::TcpStream::connect(&address)).await;
    let missing = || format!("no rerun viewer listens at {url}: start `rerun --bind 127.0.0.1` first");
    connected.with_context(missing)?.with_context(missing)?;
    Ok(())
}

/// Shows drives in the window at `url` until the watch is over; `ready` is called when nothing more is missed. A watch
/// that is dropped shows first what it has.
///
/// # Errors
/// If router, orchestrator or window cannot be reached.
pub async fn follow(fleet: &OnlookerArgs, url: &str, watch: Watch, ready: impl FnOnce()) -> Result<()> {
    reach(url).await?;
    let bus = fleet.join().await?;
    let mut runs = fleet.runs().await?;
    ready();
    let (part, one) = match &watch {
        Watch::Diagnosed(episode) => {
            let LiveCounts { logged, dropped, .. } = show(bus, episode.clone(), url.to_owned(), true).await?;
            tracing::info!(%episode, logged, dropped, "shown");
            return Ok(());
        }
        Watch::All(part) => (part, false),
        Watch::First(part) => (part, true),
    };
    let (mut known, mut shown) = (BTreeSet::new(), JoinSet::new());
    let mut beat = tokio::time::interval(ASK_EVERY);
    loop {
        tokio::select! {
            Some(ended) = shown.join_next() => {
                let LiveCounts { logged, dropped, .. } = ended.context("the view panicked")??;
                tracing::info!(logged, dropped, "shown");
                if one {
                    return Ok(());
                }
            }
            _ = beat.tick(), if !one || known.is_empty() => {
                for episode in under_way(&mut runs).await? {
                    let wanted = episode.episode.contains(part) && (!one || known.is_empty());
                    if wanted && known.insert(episode.episode.clone()) {
                        let named = EpisodeId::new(&episode.episode).context("name of an episode")?;
                        shown.spawn(show(bus.clone(), named, url.to_owned(), false));
                    }
                }
            }
        }
    }
}

/// Waits for what is under way when a watch is told to end.
pub async fn last_words() {
    tokio::time::sleep(LAST_WORDS).await;
}

async fn show(bus: BusSession, episode: EpisodeId, url: String, diagnosed: bool) -> Result<LiveCounts> {
    let mut pushes = bus.subscribe(&episode, &Topic::ALL).await?;
    let scene = scene_of(&bus, &episode).await?;
    let stream = connect(&scene, &url).with_context(|| format!("viewer at {url}"))?;
    let effects: Vec<String> = ds_effect::library().iter().map(|effect| effect.id.to_owned()).collect();
    let live = LiveView::start(&scene, stream, QUEUE, if diagnosed { &effects } else { &[] })?;
    let mut caught_up = false;
    while let Ok(envelope) = tokio::time::timeout(SILENT_FOR, pushes.recv()).await {
        if envelope.header.slot.topic == Topic::World && !caught_up {
            caught_up = true;
            catch_up(&bus, &episode, &live, envelope.header.tick.0).await?;
        }
        let over = ends_drive(&envelope) && !diagnosed;
        live.feed(envelope);
        if over {
            break;
        }
    }
    Ok(tokio::task::spawn_blocking(move || live.finish()).await.context("the view panicked")??)
}

/// Feeds the states of the ticks before `tick`, as far as the journal has them.
async fn catch_up(bus: &BusSession, episode: &EpisodeId, live: &LiveView, tick: u32) -> Result<()> {
    for missed in 0..tick {
        let slot = Slot::new(Topic::World, missed);
        if let Some(state) = bus.pull(episode, &Holder::Journal, slot, PULL_WITHIN).await? {
            live.feed(state);
        }
    }
    Ok(())
}
