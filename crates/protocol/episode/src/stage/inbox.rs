//! Accepted input messages of a stage, by slot: joins by tick, never by arrival. Bounded: beyond its window or when full
//! the newest is dropped and pulled later.

use std::collections::BTreeMap;

use ds_topic::{Envelope, Slot};

/// What became of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Taken {
    New,
    Duplicate,
    Divergent,
    Full,
}

/// The accepted inputs.
#[derive(Debug, Default)]
pub(crate) struct Inbox {
    messages: BTreeMap<Slot, Envelope>,
}

impl Inbox {
    /// Takes a message in unless there are `capacity` already; a pulled one is always wanted and has no capacity.
    pub(crate) fn take(&mut self, message: Envelope, capacity: Option<usize>) -> Taken {
        let slot = message.header.slot;
        if let Some(held) = self.messages.get(&slot) {
            return if held.header.content == message.header.content { Taken::Duplicate } else { Taken::Divergent };
        }
        if capacity.is_some_and(|capacity| self.messages.len() >= capacity) {
            return Taken::Full;
        }
        self.messages.insert(slot, message);
        Taken::New
    }

    pub(crate) fn has(&self, slot: Slot) -> bool {
        self.messages.contains_key(&slot)
    }

    pub(crate) fn get(&self, slot: Slot) -> Option<&Envelope> {
        self.messages.get(&slot)
    }

    /// Copies the messages of some slots, of which all are there.
    pub(crate) fn select(&self, slots: &[Slot]) -> BTreeMap<Slot, Envelope> {
        slots.iter().filter_map(|slot| self.messages.get(slot).map(|message| (*slot, message.clone()))).collect()
    }

    pub(crate) fn retain(&mut self, keep: impl Fn(&Envelope) -> bool) {
        self.messages.retain(|_, message| keep(message));
    }

    pub(crate) fn len(&self) -> usize {
        self.messages.len()
    }
}
