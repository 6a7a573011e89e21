//! How a stage takes scenes and orders: terms, epochs, one order per iteration, stored answers for repeated ones.

use ds_space::Digest;
use ds_topic::{Advance, Envelope};

use super::{Action, Busy, Order, Stage, StopReason};
use crate::clock::Millis;
use crate::due;
use crate::fault::Fault;

impl Stage {
    pub(super) fn on_scene(&mut self, now: Millis, message: Envelope, actions: &mut Vec<Action>) {
        if message.header.term < self.term {
            self.counters.refused_terms += 1;
            return;
        }
        if let Some((held, _)) = &self.scene {
            if held.header.content == message.header.content {
                self.counters.duplicates += 1;
            } else {
                let detail = format!("scene: held {:?}, came {:?}", held.header.content, message.header.content);
                actions.push(Action::Report(Fault::deterministic(Fault::DIVERGENT_DUPLICATE, detail)));
            }
            return;
        }
        match self.codec.outline(&message.body) {
            Ok(outline) => {
                self.scene = Some((message, outline));
                self.next_repeat = now;
            }
            Err(error) => self.fail(Fault::deterministic(Fault::BAD_MESSAGE, format!("scene: {error}")), actions),
        }
    }

    pub(super) fn on_advance(&mut self, now: Millis, message: Envelope, actions: &mut Vec<Action>) {
        let header = &message.header;
        if header.term < self.term {
            self.counters.refused_terms += 1;
            return;
        }
        let advance = match self.codec.decode_advance(&message.body) {
            Ok(advance) if advance.content() == header.content && advance.iteration == header.slot.index => advance,
            Ok(_) => {
                return self.refuse_order(&message, "content digest or iteration differs from the header", actions);
            }
            Err(error) => return self.refuse_order(&message, &error.to_string(), actions),
        };
        let own = &self.assignment.owner;
        match advance.owners.get(&self.assignment.role) {
            Some(owner) if owner == own => {}
            Some(owner) if owner.epoch >= own.epoch => {
                let later = owner.clone();
                return self.stop(StopReason::Superseded(later), actions);
            }
            _ => {
                self.counters.refused_epochs += 1;
                return;
            }
        }
        self.term = header.term;
        self.learn_owners(now, &advance);
        self.accept_order(now, Order { content: header.content, advance }, actions);
    }

    fn refuse_order(&self, message: &Envelope, why: &str, actions: &mut Vec<Action>) {
        let detail = format!("{}: {why}", message.header.slot);
        actions.push(Action::Report(Fault::deterministic(Fault::BAD_MESSAGE, detail)));
    }

    /// Epochs only grow, so the highest known is the latest, whatever order messages come in.
    fn learn_owners(&mut self, now: Millis, advance: &Advance) {
        for (role, owner) in &advance.owners {
            if self.owners.get(role).is_none_or(|known| known.epoch < owner.epoch) {
                self.owners.insert(*role, owner.clone());
                self.pulls.restart(now, |slot| due::maker(slot.topic) == Some(*role));
            }
        }
    }

    fn accept_order(&mut self, now: Millis, order: Order, actions: &mut Vec<Action>) {
        let iteration = order.advance.iteration;
        match self.orders.get(&iteration) {
            Some(seen) if *seen == order.content => {
                self.counters.repeats += 1;
                if self.leased(now) {
                    actions.extend(self.outbox.of_iteration(iteration).cloned().map(Action::Publish));
                }
            }
            Some(seen) => {
                let detail = format!("advance[{iteration}]: seen {seen:?}, came {:?}", order.content);
                actions.push(Action::Report(Fault::deterministic(Fault::CONFLICTING_ADVANCE, detail)));
            }
            None if self.orders.last_key_value().is_some_and(|(latest, _)| *latest > iteration) => {
                self.counters.repeats += 1;
            }
            None => {
                self.orders.insert(iteration, order.content);
                self.queued = Some(order);
            }
        }
    }

    /// Makes the queued order the current one when the maker is free and the scene is there.
    pub(super) fn take_order(&mut self, actions: &mut Vec<Action>) {
        if self.busy != Busy::No || self.broken.is_some() {
            return;
        }
        if self.draining && self.order.is_none() && (self.queued.is_some() || self.orders.is_empty()) {
            return self.stop(StopReason::Drained, actions);
        }
        let Some((_, outline)) = &self.scene else { return };
        let Some(order) = self.queued.take() else { return };
        let advance = &order.advance;
        let spec = &outline.spec;
        let in_range = advance.iteration < spec.iterations();
        if !in_range
            || (advance.first, advance.last) != spec.ticks_of(advance.iteration)
            || advance.plan_due != due::plan_due(spec, advance.iteration)
            || (advance.iteration == 0 && advance.border != Digest::default())
        {
            let detail = format!(
                "advance[{}]: ticks {}..={}, plan_due {}, border {:?} contradict the scene",
                advance.iteration, advance.first, advance.last, advance.plan_due, advance.border
            );
            return self.fail(Fault::deterministic(Fault::BAD_MESSAGE, detail), actions);
        }
        self.order = Some(order);
    }

    pub(super) fn fail(&mut self, fault: Fault, actions: &mut Vec<Action>) {
        actions.push(Action::Report(fault.clone()));
        self.broken = Some(fault);
        self.order = None;
        self.queued = None;
        self.busy = Busy::No;
    }
}
