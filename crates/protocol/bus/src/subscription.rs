//! Pushes of an episode, in order of arrival, through bounded queues: one per topic.

use std::sync::Arc;

use ds_space::EpisodeId;
use ds_topic::{Envelope, Role, Topic};
use ds_wire::split;
use zenoh::bytes::ZBytes;
use zenoh::pubsub::Subscriber;

use crate::counters::{Counters, count};
use crate::error::{BusError, zenoh};
use crate::keys::pushes_of;
use crate::payload::bytes_of;
use crate::queue::Queue;
use crate::session::BusSession;

/// Returns the topics that a stage listens to.
#[must_use]
pub fn topics_of(role: Role) -> &'static [Topic] {
    match role {
        Role::Sim => &[Topic::Scene, Topic::Advance],
        Role::Layout => &[Topic::Scene, Topic::Advance, Topic::World],
        Role::Video => &[Topic::Scene, Topic::Advance, Topic::World, Topic::Layout],
        Role::Policy => &[Topic::Scene, Topic::Advance, Topic::World, Topic::Ego, Topic::Frame],
    }
}

/// The pushes of some topics of an episode; ends its subscriptions when dropped.
pub struct Subscription {
    episode: EpisodeId,
    queue: Queue<(Topic, ZBytes)>,
    counters: Arc<Counters>,
    _subscribers: Vec<Subscriber<()>>,
}

impl std::fmt::Debug for Subscription {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Subscription").field("episode", &self.episode).finish_non_exhaustive()
    }
}

impl BusSession {
    /// Subscribes to topics of an episode. A full queue drops the newest and counts it.
    ///
    /// # Errors
    /// If the session is closed.
    pub async fn subscribe(&self, episode: &EpisodeId, topics: &[Topic]) -> Result<Subscription, BusError> {
        let queue = Queue::new(topics.len(), self.shared.settings.queue);
        let counters = Arc::clone(&self.shared.counters);
        let mut subscribers = Vec::with_capacity(topics.len());
        for (lane, topic) in topics.iter().copied().enumerate() {
            let (queue, counters) = (queue.clone(), Arc::clone(&counters));
            // Runs on the link's receiving thread: it must not wait or decode.
            let enqueue = move |sample: zenoh::sample::Sample| {
                count(&counters.received);
                if !queue.offer(lane, (topic, sample.payload().clone())) {
                    count(&counters.dropped);
                }
            };
            let declared = self.zenoh.declare_subscriber(pushes_of(episode, topic)).callback(enqueue);
            subscribers.push(declared.await.map_err(zenoh("subscribe"))?);
        }
        Ok(Subscription { episode: episode.clone(), queue, counters, _subscribers: subscribers })
    }
}

impl Subscription {
    /// Waits for the next message. What cannot be read, or belongs elsewhere, is counted and left out.
    pub async fn recv(&mut self) -> Envelope {
        loop {
            let (topic, payload) = self.queue.wait().await;
            if let Some(message) = self.read(topic, payload) {
                return message;
            }
        }
    }

    /// Returns the next message, if one has come.
    pub fn try_recv(&mut self) -> Option<Envelope> {
        while let Some((topic, payload)) = self.queue.take() {
            if let Some(message) = self.read(topic, payload) {
                return Some(message);
            }
        }
        None
    }

    fn read(&self, topic: Topic, payload: ZBytes) -> Option<Envelope> {
        let fits = |message: &Envelope| message.header.slot.topic == topic && message.header.episode == self.episode;
        let message = split(bytes_of(payload)).ok().filter(fits);
        if message.is_none() {
            count(&self.counters.unreadable);
        }
        message
    }
}
