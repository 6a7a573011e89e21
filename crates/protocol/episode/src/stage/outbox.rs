//! What a stage has made: digests of everything, envelopes of the last iterations. A slot never gets other content.

use std::collections::BTreeMap;

use ds_space::Digest;
use ds_topic::{Envelope, Slot};

/// The stored answers of a stage.
#[derive(Debug, Default)]
pub(crate) struct Outbox {
    contents: BTreeMap<Slot, Digest>,
    messages: BTreeMap<Slot, Envelope>,
    withheld: Vec<Slot>,
}

impl Outbox {
    /// Returns the content that was made for a slot before.
    pub(crate) fn content(&self, slot: Slot) -> Option<Digest> {
        self.contents.get(&slot).copied()
    }

    /// Stores a message for a slot that has no other content; the first envelope stays.
    pub(crate) fn store(&mut self, message: Envelope) {
        let slot = message.header.slot;
        self.contents.insert(slot, message.header.content);
        self.messages.entry(slot).or_insert(message);
    }

    pub(crate) fn get(&self, slot: Slot) -> Option<&Envelope> {
        self.messages.get(&slot)
    }

    /// Returns the stored messages of an iteration, in slot order.
    pub(crate) fn of_iteration(&self, iteration: u32) -> impl Iterator<Item = &Envelope> {
        self.messages.values().filter(move |message| message.header.iteration == iteration)
    }

    /// Notes outputs that may not be published yet.
    pub(crate) fn withhold(&mut self, slot: Slot) {
        self.withheld.push(slot);
    }

    /// Returns what was withheld, once.
    pub(crate) fn release(&mut self) -> Vec<Envelope> {
        let slots = std::mem::take(&mut self.withheld);
        slots.iter().filter_map(|slot| self.messages.get(slot).cloned()).collect()
    }

    /// Drops the bodies of iterations before `iteration`: the journal holds them.
    pub(crate) fn forget_before(&mut self, iteration: u32) {
        self.messages.retain(|_, message| message.header.iteration >= iteration);
    }
}
