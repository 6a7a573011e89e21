//! How a driver moves time: the order of each iteration, its commit, the next.

use ds_topic::{Advance, Envelope, Motion, Plan, ProposalScorer, Slot, Topic};
use ds_world::Proposal;

use super::{Action, Committed, Current, Driver, Status};
use crate::clock::Millis;
use crate::due;

/// Returns what a plan moves the ego by: the policy's answer, or whatever the simulator finds best of its proposals.
fn moved_by(plan: Plan, scorer: ProposalScorer) -> Motion {
    if scorer == ProposalScorer::Learned {
        return Motion::Plan(plan.trajectory);
    }
    if plan.proposals.is_empty() {
        return Motion::Choice(vec![Proposal { trajectory: plan.trajectory, score: 0.0 }]);
    }
    Motion::Choice(plan.proposals)
}

impl Driver {
    /// Makes the order of the next iteration current; it is sent when all seats are ready.
    pub(super) fn begin_iteration(&mut self, now: Millis) {
        let iteration = self.committed_iterations;
        let spec = &self.outline.spec;
        let (first, last) = spec.ticks_of(iteration);
        let motion = match self.plan.take() {
            _ if iteration == 0 => Motion::Initial,
            Some(plan) if iteration > spec.warm_up => moved_by(plan, spec.scorer),
            _ => Motion::Log,
        };
        let plan_due = due::plan_due(spec, iteration);
        let owners = std::collections::BTreeMap::new();
        let advance = Advance { iteration, first, last, motion, border: self.border, plan_due, owners };
        let mut due = due::all_outputs(&self.outline, &advance);
        due.sort_unstable();
        let accepted = std::collections::BTreeMap::new();
        self.current =
            Some(Current { advance, order: None, due, accepted, since: now, patience: 0, committing: false });
    }

    /// Sends the current order, with the seated owners, once all seats are ready.
    pub(super) fn send_order(&mut self, actions: &mut Vec<Action>) {
        if !self.seats.values().all(|seat| seat.ready) {
            // Stages that go on while a role is vacant still need the order as it was.
            let sent = self.current.as_ref().and_then(|current| current.order.clone());
            actions.extend(sent.map(Action::Publish));
            return;
        }
        let Some(current) = &self.current else { return };
        let mut advance = current.advance.clone();
        advance.owners =
            self.seats.iter().filter_map(|(role, seat)| seat.owner.clone().map(|owner| (*role, owner))).collect();
        let body = self.codec.encode_advance(&advance);
        let message = self.envelope(Slot::new(Topic::Advance, advance.iteration), advance.content(), body);
        if let Some(current) = &mut self.current {
            current.order = Some(message.clone());
        }
        actions.push(Action::Publish(message));
    }

    /// Hands a complete iteration to the journal.
    pub(super) fn commit_if_complete(&mut self, actions: &mut Vec<Action>) {
        let Some(current) = &mut self.current else { return };
        if current.committing || current.accepted.len() < current.due.len() {
            return;
        }
        current.committing = true;
        let iteration = current.advance.iteration;
        let scene = (iteration == 0).then(|| self.scene.clone());
        let outputs = current.accepted.values().cloned();
        let messages: Vec<Envelope> = scene.into_iter().chain(current.order.clone()).chain(outputs).collect();
        actions.push(Action::Commit { iteration, messages });
    }

    pub(super) fn on_journalled(&mut self, now: Millis, iteration: u32, actions: &mut Vec<Action>) {
        let held = self.current.take_if(|current| current.committing && current.advance.iteration == iteration);
        let Some(current) = held else { return };
        for (slot, message) in &current.accepted {
            let header = &message.header;
            self.committed.insert(*slot, Committed { content: header.content, epoch: header.epoch });
            if slot.topic == Topic::World {
                actions.push(Action::Observe(message.clone()));
            }
            if *slot == Slot::new(Topic::World, current.advance.last.0) {
                self.border = header.content;
            }
        }
        self.recent = current.accepted;
        self.committed_iterations = iteration + 1;
        if self.committed_iterations == self.outline.spec.iterations() {
            return self.finish(Status::Completed, None, actions);
        }
        self.begin_iteration(now);
        self.send_order(actions);
    }
}
