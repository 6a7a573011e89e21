//! The answering side of a pull: queries for the messages of a holder, through a bounded queue.

use std::sync::Arc;

use ds_space::EpisodeId;
use ds_topic::{Envelope, Slot};
use ds_wire::encode;
use zenoh::query::{Query, Queryable};

use crate::counters::{Counters, count};
use crate::error::{BusError, zenoh};
use crate::keys::{Holder, Key, pulls_at};
use crate::queue::Queue;
use crate::session::BusSession;

/// Queries to one holder about one episode; ends its declaration when dropped.
pub struct Asks {
    queue: Queue<Query>,
    counters: Arc<Counters>,
    _queryable: Queryable<()>,
}

impl std::fmt::Debug for Asks {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Asks").finish_non_exhaustive()
    }
}

/// One query; dropping it answers that there is nothing.
pub struct Ask {
    /// What is asked for.
    pub slot: Slot,
    query: Query,
}

impl std::fmt::Debug for Ask {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Ask").field("slot", &self.slot).finish_non_exhaustive()
    }
}

impl BusSession {
    /// Takes the queries to a holder about an episode. A full queue drops the newest, whose asker asks again.
    ///
    /// # Errors
    /// If the session is closed.
    pub async fn serve_pulls(&self, holder: &Holder, episode: &EpisodeId) -> Result<Asks, BusError> {
        let queue = Queue::new(1, self.shared.settings.queue);
        let counters = Arc::clone(&self.shared.counters);
        let (offered, counted) = (queue.clone(), Arc::clone(&counters));
        let enqueue = move |query: Query| {
            count(&counted.asked);
            if !offered.offer(0, query) {
                count(&counted.dropped_asks);
            }
        };
        let declared = self.zenoh.declare_queryable(pulls_at(episode, holder)).callback(enqueue);
        let queryable = declared.await.map_err(zenoh("serve pulls"))?;
        Ok(Asks { queue, counters, _queryable: queryable })
    }
}

impl Asks {
    /// Waits for the next query.
    pub async fn recv(&mut self) -> Ask {
        loop {
            let query = self.queue.wait().await;
            match Key::parse(query.key_expr().as_str()) {
                Ok(Key::Pull { slot, .. }) => return Ask { slot, query },
                _ => count(&self.counters.unreadable),
            }
        }
    }
}

impl Ask {
    /// Answers with a message, or that there is none.
    ///
    /// # Errors
    /// If the asker has gone or the session is closed.
    pub async fn answer(self, message: Option<&Envelope>) -> Result<(), BusError> {
        if let Some(message) = message {
            let bytes = encode(&message.header, &message.body);
            let key = self.query.key_expr().clone();
            self.query.reply(key, bytes).await.map_err(zenoh("answer a pull"))?;
        }
        Ok(())
    }
}
