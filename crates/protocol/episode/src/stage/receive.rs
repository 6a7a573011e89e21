//! How a stage receives: who may say what, duplicates, divergence, the window of its inbox.

use ds_topic::{Envelope, SCHEMA_VERSION, Slot, Topic};

use super::inbox::Taken;
use super::{Action, CAPACITY_WITHOUT_SCENE, PullFrom, Stage};
use crate::clock::Millis;
use crate::due;
use crate::fault::Fault;

/// The way a message came.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Via {
    /// Pushed by its publisher.
    Push,
    /// Asked from its publisher.
    Owner,
    /// Asked from the orchestrator, who checked the epoch when it accepted the message.
    Journal,
}

impl Stage {
    pub(super) fn on_message(&mut self, now: Millis, message: Envelope, via: Via, actions: &mut Vec<Action>) {
        let header = &message.header;
        let own = &self.assignment;
        if header.episode != own.episode || header.attempt != own.attempt || header.schema_version != SCHEMA_VERSION {
            self.counters.foreign += 1;
            return;
        }
        if via == Via::Push {
            self.count_gaps(&message);
        }
        match header.slot.topic {
            Topic::Scene => self.on_scene(now, message, actions),
            Topic::Advance => self.on_advance(now, message, actions),
            _ => self.on_input(message, via, actions),
        }
    }

    pub(super) fn on_pulled(
        &mut self,
        now: Millis,
        slot: Slot,
        from: PullFrom,
        reply: Option<Envelope>,
        actions: &mut Vec<Action>,
    ) {
        let Some(message) = reply else { return };
        let came = message.header.slot;
        let later_order = came.topic == Topic::Advance && slot.topic == Topic::Advance && came.index >= slot.index;
        if came != slot && !later_order {
            self.counters.foreign += 1;
            return;
        }
        self.pulls.answered(slot);
        let via = if from == PullFrom::Journal { Via::Journal } else { Via::Owner };
        self.on_message(now, message, via, actions);
    }

    fn count_gaps(&mut self, message: &Envelope) {
        let header = &message.header;
        if let Some(last) = self.heard.get_mut(&header.publisher) {
            self.counters.gaps += header.sequence.saturating_sub(*last + 1);
            *last = header.sequence.max(*last);
        } else if self.heard.len() < 64 {
            self.heard.insert(header.publisher.clone(), header.sequence);
        }
    }

    fn on_input(&mut self, message: Envelope, via: Via, actions: &mut Vec<Action>) {
        let slot = message.header.slot;
        let Some(maker) = due::maker(slot.topic) else { return };
        if via == Via::Push {
            let wanted = match &self.scene {
                Some((_, outline)) => due::takes(self.role(), slot.topic, &outline.spec),
                None => true,
            };
            if !wanted || maker == self.role() {
                return;
            }
        }
        if via != Via::Journal {
            let header = &message.header;
            match self.owners.get(&maker) {
                Some(owner) if owner.epoch == header.epoch && owner.instance == header.publisher => {}
                Some(_) => {
                    self.counters.refused_epochs += 1;
                    return;
                }
                // No order has named the owner yet: what is not certain is pulled later.
                None => {
                    self.counters.dropped += 1;
                    return;
                }
            }
        }
        let capacity = (via == Via::Push).then(|| self.capacity());
        if via == Via::Push && !self.in_window(slot) {
            self.counters.dropped += 1;
            return;
        }
        match self.inbox.take(message.clone(), capacity) {
            Taken::New => {}
            Taken::Duplicate => self.counters.duplicates += 1,
            Taken::Full => self.counters.dropped += 1,
            Taken::Divergent => {
                let held = self.inbox.get(slot).map(|held| &held.header);
                let detail = format!("{slot}: held {held:?}, came {:?}", message.header);
                actions.push(Action::Report(Fault::deterministic(Fault::DIVERGENT_DUPLICATE, detail)));
            }
        }
    }

    /// Twice what the current order and the history need, so that the next iteration's first pushes find room.
    fn capacity(&self) -> usize {
        let Some((_, outline)) = &self.scene else { return CAPACITY_WITHOUT_SCENE };
        let ticks = 2 * (outline.spec.replan_period as usize + outline.spec.history as usize + 1);
        let restore = self.order.as_ref().map_or(0, |order| self.needed(outline, &order.advance).len());
        ticks * (2 * usize::from(outline.cameras) + 2) + restore
    }

    /// Whether a pushed message belongs to the current or the next iteration (or the history before).
    fn in_window(&self, slot: Slot) -> bool {
        let Some((_, outline)) = &self.scene else { return true };
        let next = self.orders.last_key_value().map_or(0, |(iteration, _)| iteration + 1);
        let (first, last) = outline.spec.ticks_of(next);
        let tick = due::tick_of(&outline.spec, slot);
        tick <= last && tick.0 + outline.spec.replan_period + outline.spec.history >= first.0
    }
}
