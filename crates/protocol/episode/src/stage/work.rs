//! How a stage works: what an order needs, when to restore, what to make of the maker's answers.

use ds_space::{Digest, SimTime};
use ds_topic::{Advance, Envelope, Header, Role, SCHEMA_VERSION, Slot, Topic};

use super::{Action, Busy, Output, Stage};
use crate::clock::Millis;
use crate::codec::Outline;
use crate::due;
use crate::fault::Fault;

impl Stage {
    /// Whether the maker's state is the one that an order starts from.
    fn stands_before(&self, advance: &Advance) -> bool {
        self.state == Some(advance.iteration.checked_sub(1))
    }

    pub(super) fn needed(&self, outline: &Outline, advance: &Advance) -> Vec<Slot> {
        let mut slots = due::inputs(outline, self.role(), advance);
        if !self.stands_before(advance) {
            slots.extend(due::restore_inputs(outline, self.role(), advance));
        }
        slots
    }

    /// Starts to restore or to work if everything for it is there.
    pub(super) fn begin(&mut self, actions: &mut Vec<Action>) {
        let (Some((scene, outline)), Some(order)) = (&self.scene, &self.order) else { return };
        let advance = &order.advance;
        if !self.stands_before(advance) {
            let slots = due::restore_inputs(outline, self.role(), advance);
            if !slots.iter().all(|slot| self.inbox.has(*slot)) {
                return;
            }
            if self.role() == Role::Sim {
                let border = slots.first().and_then(|slot| self.inbox.get(*slot)).map(|world| world.header.content);
                if border.unwrap_or_default() != advance.border {
                    let fault = self.wrong_border(advance, border.unwrap_or_default());
                    return self.fail(fault, actions);
                }
            }
            self.busy = Busy::Restoring;
            let inputs = self.inbox.select(&slots);
            actions.push(Action::Restore { scene: scene.clone(), inputs, advance: advance.clone() });
            return;
        }
        if self.role() == Role::Sim && self.border != advance.border {
            let fault = self.wrong_border(advance, self.border);
            return self.fail(fault, actions);
        }
        let slots = due::inputs(outline, self.role(), advance);
        if slots.iter().all(|slot| self.inbox.has(*slot)) {
            self.busy = Busy::Working;
            actions.push(Action::Work { advance: advance.clone(), inputs: self.inbox.select(&slots) });
        }
    }

    fn wrong_border(&self, advance: &Advance, own: Digest) -> Fault {
        let detail =
            format!("advance[{}] starts from {:?}, the own state is {own:?}", advance.iteration, advance.border);
        Fault::deterministic(Fault::WRONG_BORDER, detail)
    }

    pub(super) fn on_restored(&mut self, order: Digest, result: Result<(), Fault>, actions: &mut Vec<Action>) {
        let Some(current) = self.order.as_ref().filter(|held| held.content == order) else { return };
        if self.busy != Busy::Restoring {
            return;
        }
        self.busy = Busy::No;
        match result {
            Ok(()) => {
                self.state = Some(current.advance.iteration.checked_sub(1));
                self.border = current.advance.border;
            }
            Err(fault) => self.fail(fault, actions),
        }
    }

    pub(super) fn on_worked(
        &mut self,
        now: Millis,
        order: Digest,
        result: Result<Vec<Output>, Fault>,
        actions: &mut Vec<Action>,
    ) {
        if self.busy != Busy::Working || self.order.as_ref().is_none_or(|held| held.content != order) {
            return;
        }
        self.busy = Busy::No;
        let (Some(order), Some((_, outline))) = (self.order.take(), self.scene.as_ref()) else { return };
        let outputs = match result {
            Ok(outputs) => outputs,
            Err(fault) => return self.fail(fault, actions),
        };
        if let Err(fault) = self.check_outputs(outline, &order.advance, &outputs) {
            return self.fail(fault, actions);
        }
        let (spec, dt) = (outline.spec.clone(), outline.dt);
        for output in outputs {
            if output.slot == Slot::new(Topic::World, order.advance.last.0) {
                self.border = output.content;
            }
            let slot = output.slot;
            let message = self.envelope(order.advance.iteration, output, dt);
            self.outbox.store(message);
            if self.leased(now) {
                actions.extend(self.outbox.get(slot).cloned().map(Action::Publish));
            } else {
                self.counters.withheld += 1;
                self.outbox.withhold(slot);
            }
        }
        let iteration = order.advance.iteration;
        self.state = Some(Some(iteration));
        self.outbox.forget_before(iteration.saturating_sub(1));
        let oldest = due::remembered_from(&spec, order.advance.last).0;
        self.inbox.retain(|message| due::tick_of(&spec, message.header.slot).0 >= oldest);
    }

    /// Checks that exactly the due slots came, each with the content that it had before, if any.
    fn check_outputs(&self, outline: &Outline, advance: &Advance, outputs: &[Output]) -> Result<(), Fault> {
        let mut due = due::outputs(outline, self.role(), advance);
        let mut made: Vec<Slot> = outputs.iter().map(|output| output.slot).collect();
        due.sort_unstable();
        made.sort_unstable();
        if due != made {
            let wrong: Vec<String> = due
                .iter()
                .filter(|slot| !made.contains(slot))
                .map(|slot| format!("{slot} is missing"))
                .chain(made.iter().filter(|slot| !due.contains(slot)).map(|slot| format!("{slot} is not due")))
                .collect();
            let detail =
                format!("advance[{}]: {} made of {}; {}", advance.iteration, made.len(), due.len(), wrong.join(", "));
            return Err(Fault::deterministic(Fault::WRONG_OUTPUTS, detail));
        }
        for output in outputs {
            if let Some(before) = self.outbox.content(output.slot).filter(|before| *before != output.content) {
                let detail = format!("{}: made {before:?} before, {:?} now", output.slot, output.content);
                return Err(Fault::deterministic(Fault::DIVERGENT_DUPLICATE, detail));
            }
        }
        Ok(())
    }

    fn envelope(&mut self, iteration: u32, output: Output, dt: SimTime) -> Envelope {
        let sequence = self.sequence;
        self.sequence += 1;
        let header = Header {
            episode: self.assignment.episode.clone(),
            attempt: self.assignment.attempt,
            term: self.term,
            epoch: self.assignment.owner.epoch,
            iteration,
            tick: output.tick,
            time: SimTime::at(output.tick, dt),
            sequence,
            publisher: self.assignment.owner.instance.clone(),
            schema_version: SCHEMA_VERSION,
            trace: String::new(),
            slot: output.slot,
            content: output.content,
        };
        Envelope { header, body: output.body }
    }
}
