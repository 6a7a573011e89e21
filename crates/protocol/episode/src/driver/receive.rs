//! How a driver receives: epochs, duplicates, divergence, the first plan; and what it answers when asked.

use ds_space::Digest;
use ds_topic::{Envelope, SCHEMA_VERSION, Slot, Topic};

use super::{Action, Driver};
use crate::due;
use crate::fault::Fault;

impl Driver {
    pub(super) fn on_pulled(&mut self, slot: Slot, reply: Option<Envelope>, actions: &mut Vec<Action>) {
        match reply {
            Some(message) if message.header.slot == slot => {
                self.pulls.answered(slot);
                self.on_message(message, actions);
            }
            Some(_) => self.counters.foreign += 1,
            None => {}
        }
    }

    pub(super) fn on_message(&mut self, message: Envelope, actions: &mut Vec<Action>) {
        let header = &message.header;
        let own = &self.attempt;
        if header.episode != own.episode || header.attempt != own.attempt || header.schema_version != SCHEMA_VERSION {
            self.counters.foreign += 1;
            return;
        }
        if header.term > own.term {
            return self.step_down(header.term, actions);
        }
        let slot = header.slot;
        let Some(role) = due::maker(slot.topic) else { return };
        let owner = self.seats[&role].owner.as_ref();
        if owner.is_none_or(|owner| owner.epoch != header.epoch || owner.instance != header.publisher) {
            self.counters.refused_epochs += 1;
            return;
        }
        if let Some((content, epoch)) = self.held(slot) {
            return self.compare(&message, content, epoch, actions);
        }
        let Some(current) = self.current.as_mut().filter(|current| current.due.binary_search(&slot).is_ok()) else {
            self.counters.dropped += 1;
            return;
        };
        if slot.topic == Topic::Plan {
            match self.codec.decode_plan(&message.body) {
                Ok(plan) if plan.answered.is_some() && !self.outline.spec.wall_clock => {
                    let detail = format!("{slot}: tells of the wall clock in an episode that is not driven by it");
                    return self.fail(Fault::deterministic(Fault::BAD_MESSAGE, detail), actions);
                }
                Ok(plan) => self.plan = Some(plan),
                Err(error) => {
                    let fault = Fault::policy(Fault::PLAN_REFUSED, format!("{slot}: {error}"));
                    return self.fail(fault, actions);
                }
            }
        }
        current.accepted.insert(slot, message);
        self.commit_if_complete(actions);
    }

    /// Returns content and epoch of the message that was accepted for a slot.
    fn held(&self, slot: Slot) -> Option<(Digest, u64)> {
        let accepted = self.current.as_ref().and_then(|current| current.accepted.get(&slot));
        let accepted = accepted.map(|message| (message.header.content, message.header.epoch));
        accepted.or_else(|| self.committed.get(&slot).map(|committed| (committed.content, committed.epoch)))
    }

    fn compare(&mut self, message: &Envelope, content: Digest, epoch: u64, actions: &mut Vec<Action>) {
        let header = &message.header;
        if header.content == content {
            self.counters.duplicates += 1;
        } else if header.slot.topic == Topic::Plan && header.epoch > epoch {
            self.counters.superseded_plans += 1;
        } else {
            let came = (header.content, header.epoch);
            let detail = format!(
                "{}: accepted {content:?} of epoch {epoch}, came {:?} of epoch {}",
                header.slot, came.0, came.1
            );
            self.fail(Fault::deterministic(Fault::DIVERGENT_DUPLICATE, detail), actions);
        }
    }

    pub(super) fn answer(&self, query: u64, slot: Slot) -> Action {
        let current = self.current.as_ref();
        let reply = match slot.topic {
            Topic::Scene => Some(self.scene.clone()),
            Topic::Advance => current
                .filter(|current| current.advance.iteration >= slot.index)
                .and_then(|current| current.order.clone()),
            _ => {
                let accepted = current.and_then(|current| current.accepted.get(&slot));
                let found = accepted.or_else(|| self.recent.get(&slot)).cloned();
                if found.is_none() && self.committed.contains_key(&slot) {
                    return Action::Lookup { query, slot };
                }
                found
            }
        };
        Action::Answer { query, reply }
    }
}
