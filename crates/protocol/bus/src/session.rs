//! One connection to the bus: publishes, pulls and declares. Cheap to clone; embedded services share one.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use ds_space::{Draws, EpisodeId};
use ds_topic::{Envelope, Slot, Topic};
use ds_wire::{encode, split};
use zenoh::qos::CongestionControl;
use zenoh::query::ConsolidationMode;

use crate::counters::{Counters, count};
use crate::error::{BusError, zenoh};
use crate::keys::{Holder, Key};
use crate::payload::bytes_of;
use crate::settings::BusSettings;

/// Messages up to this size are sent at once, not gathered into a batch.
const EXPRESS_BYTES: usize = 16 << 10;

/// A session on the bus.
#[derive(Clone)]
pub struct BusSession {
    pub(crate) zenoh: zenoh::Session,
    pub(crate) shared: Arc<Shared>,
}

/// What all clones of a session share.
pub(crate) struct Shared {
    pub(crate) settings: BusSettings,
    pub(crate) counters: Arc<Counters>,
    losses: Draws,
    pushed: AtomicU64,
}

impl std::fmt::Debug for BusSession {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("BusSession").field("id", &self.zenoh.zid().to_string()).finish_non_exhaustive()
    }
}

impl BusSession {
    /// Opens a session.
    ///
    /// # Errors
    /// If a setting is refused, or an endpoint cannot be opened or reached.
    pub async fn open(settings: &BusSettings) -> Result<Self, BusError> {
        let settings = settings.resolved()?;
        let zenoh = zenoh::open(settings.config()?).await.map_err(zenoh("open a session"))?;
        let losses = Draws::from_seed(settings.drop_seed, "bus-losses");
        let counters = Arc::new(Counters::default());
        Ok(Self { zenoh, shared: Arc::new(Shared { settings, counters, losses, pushed: AtomicU64::new(0) }) })
    }

    /// Opens the session that all services inside one process share; nothing leaves the process.
    ///
    /// # Errors
    /// If Zenoh refuses.
    pub async fn embedded() -> Result<Self, BusError> {
        Self::open(&BusSettings::default()).await
    }

    /// Returns the endpoints that it listens on, ports filled in.
    #[must_use]
    pub fn listens(&self) -> &[String] {
        &self.shared.settings.listen
    }

    /// Returns what it has done and lost.
    #[must_use]
    pub fn counters(&self) -> &Counters {
        &self.shared.counters
    }

    /// Pushes a message to whoever subscribes. Success says nothing about arrival.
    ///
    /// # Errors
    /// If the session is closed.
    pub async fn publish(&self, message: &Envelope) -> Result<(), BusError> {
        let counters = &self.shared.counters;
        if self.withheld() {
            count(&counters.withheld_pushes);
            return Ok(());
        }
        let key = Key::push(&message.header.episode, message.header.slot).to_string();
        let bytes = encode(&message.header, &message.body);
        let express = bytes.len() <= EXPRESS_BYTES;
        let put = self.zenoh.put(key, bytes).congestion_control(CongestionControl::Drop).express(express);
        put.await.map_err(zenoh("publish"))?;
        count(&counters.pushes);
        Ok(())
    }

    fn withheld(&self) -> bool {
        let settings = &self.shared.settings;
        if settings.drop_pushes {
            return true;
        }
        let push = self.shared.pushed.fetch_add(1, Ordering::Relaxed);
        settings.drop_share > 0.0 && self.shared.losses.uniform(push) < settings.drop_share
    }

    /// Asks one holder for one message and waits at most `timeout`. `None` if it has none, is not there, or is late.
    ///
    /// A pull of `advance` may bring a later order than the one asked for.
    ///
    /// # Errors
    /// If the session is closed.
    pub async fn pull(
        &self,
        episode: &EpisodeId,
        from: &Holder,
        slot: Slot,
        timeout: Duration,
    ) -> Result<Option<Envelope>, BusError> {
        let counters = &self.shared.counters;
        count(&counters.pulls);
        let key = Key::Pull { episode: episode.clone(), holder: from.clone(), slot }.to_string();
        let get = self.zenoh.get(key).timeout(timeout).consolidation(ConsolidationMode::None);
        let replies = get.await.map_err(zenoh("pull"))?;
        let first = async {
            while let Ok(reply) = replies.recv_async().await {
                let Ok(sample) = reply.into_result() else { continue };
                match split(bytes_of(sample.payload().clone())) {
                    Ok(message) if answers(&message, episode, slot) => return Some(message),
                    _ => count(&counters.unreadable),
                }
            }
            None
        };
        // Zenoh ends the query itself; the second limit covers a link that hangs.
        let found = tokio::time::timeout(timeout.saturating_mul(2), first).await.unwrap_or(None);
        if found.is_none() {
            count(&counters.empty_pulls);
        }
        Ok(found)
    }

    /// Leaves the bus; clones cannot be used any more.
    ///
    /// # Errors
    /// If Zenoh does not close in order.
    pub async fn close(&self) -> Result<(), BusError> {
        self.zenoh.close().await.map_err(zenoh("close"))
    }
}

/// Says whether a message is what was asked for.
fn answers(message: &Envelope, episode: &EpisodeId, asked: Slot) -> bool {
    let found = message.header.slot;
    let later = asked.topic == Topic::Advance && found.topic == Topic::Advance && found.index >= asked.index;
    message.header.episode == *episode && (found == asked || later)
}
