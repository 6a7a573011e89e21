//! Liveliness of instances: a reason to suspect, never a proof.

use ds_space::InstanceId;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Subscriber;
use zenoh::sample::SampleKind;

use crate::error::{BusError, zenoh};
use crate::keys::{Key, all_alive};
use crate::queue::Queue;
use crate::session::BusSession;

/// Shows that an instance lives, until dropped.
#[derive(Debug)]
pub struct AliveToken {
    _token: LivelinessToken,
}

/// Comings and goings of instances.
pub struct AliveWatch {
    queue: Queue<(InstanceId, bool)>,
    _subscriber: Subscriber<()>,
}

impl std::fmt::Debug for AliveWatch {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("AliveWatch").finish_non_exhaustive()
    }
}

impl BusSession {
    /// Shows that an instance lives.
    ///
    /// # Errors
    /// If the session is closed.
    pub async fn declare_alive(&self, instance: &InstanceId) -> Result<AliveToken, BusError> {
        let key = Key::Alive { instance: instance.clone() }.to_string();
        let token = self.zenoh.liveliness().declare_token(key).await.map_err(zenoh("show that it lives"))?;
        Ok(AliveToken { _token: token })
    }

    /// Watches all instances, those that are there already included.
    ///
    /// # Errors
    /// If the session is closed.
    pub async fn watch_alive(&self) -> Result<AliveWatch, BusError> {
        let queue = Queue::new(1, self.shared.settings.queue);
        let offered = queue.clone();
        let enqueue = move |sample: zenoh::sample::Sample| {
            if let Ok(Key::Alive { instance }) = Key::parse(sample.key_expr().as_str()) {
                offered.offer(0, (instance, sample.kind() == SampleKind::Put));
            }
        };
        let liveliness = self.zenoh.liveliness();
        let declared = liveliness.declare_subscriber(all_alive()).history(true).callback(enqueue);
        Ok(AliveWatch { queue, _subscriber: declared.await.map_err(zenoh("watch the living"))? })
    }
}

impl AliveWatch {
    /// Waits for the next coming (`true`) or going (`false`).
    pub async fn recv(&mut self) -> (InstanceId, bool) {
        self.queue.wait().await
    }
}
