//! Who holds the roles of an attempt, and what follows when a holder comes, goes or fails.

use ds_space::InstanceId;
use ds_topic::{EventKind, Owner, Role};

use super::{Action, Driver};
use crate::clock::Millis;
use crate::due;
use crate::fault::{Fault, FaultClass};

/// A role's holder.
#[derive(Debug, Clone, Default)]
pub(super) struct Seat {
    pub(super) owner: Option<Owner>,
    pub(super) ready: bool,
    /// Since when nobody was ready.
    pub(super) vacant_since: Millis,
    /// Who failed here last.
    pub(super) exclude: Option<InstanceId>,
    /// The highest epoch that ever held it.
    pub(super) epoch: u64,
}

/// A time in which somebody holds a role.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tenure {
    pub(super) role: Role,
    pub(super) epoch: u64,
}

impl Driver {
    pub(super) fn on_assigned(&mut self, now: Millis, role: Role, owner: Owner, actions: &mut Vec<Action>) {
        let Some(seat) = self.seats.get_mut(&role) else { return };
        if owner.epoch <= seat.epoch {
            self.counters.refused_epochs += 1;
            return;
        }
        if seat.ready {
            seat.vacant_since = now;
        }
        let reason = format!("{role} to {} epoch {}", owner.instance, owner.epoch);
        let again = seat.epoch > 0;
        seat.epoch = owner.epoch;
        seat.owner = Some(owner);
        seat.ready = false;
        if again {
            self.event(EventKind::Reassigned, &reason, actions);
        }
        actions.push(Action::Publish(self.scene.clone()));
    }

    pub(super) fn on_ready(&mut self, now: Millis, role: Role, epoch: u64, actions: &mut Vec<Action>) {
        let Some(seat) = self.seats.get_mut(&role) else { return };
        if seat.ready || seat.owner.as_ref().is_none_or(|owner| owner.epoch != epoch) {
            return;
        }
        seat.ready = true;
        if !self.seats.values().all(|seat| seat.ready) {
            return;
        }
        self.pulls.restart(now.plus(self.timing.pull_after_ms), |slot| due::maker(slot.topic) == Some(role));
        if let Some(current) = &mut self.current {
            (current.since, current.patience) = (now, 0);
        } else {
            self.begin_iteration(now);
        }
        if self.current.as_ref().is_some_and(|current| !current.committing) {
            self.send_order(actions);
        }
    }

    pub(super) fn on_lost(&mut self, now: Millis, tenure: Tenure, why: &str, actions: &mut Vec<Action>) {
        let Some(owner) = self.owner(tenure) else { return };
        let Tenure { role, epoch } = tenure;
        self.event(EventKind::Fault, &format!("{role} lost {} epoch {epoch}: {why}", owner.instance), actions);
        self.vacate(now, role, None, actions);
    }

    /// Returns who holds a role still.
    fn owner(&self, tenure: Tenure) -> Option<Owner> {
        let held = self.seats.get(&tenure.role).and_then(|seat| seat.owner.clone());
        held.filter(|owner| owner.epoch == tenure.epoch)
    }

    pub(super) fn on_fault(&mut self, now: Millis, tenure: Tenure, fault: Fault, actions: &mut Vec<Action>) {
        let Some(owner) = self.owner(tenure) else { return };
        let Tenure { role, epoch } = tenure;
        let text = format!("{role} of {} epoch {epoch}: {}", owner.instance, fault.detail);
        if fault.class != FaultClass::Infrastructure {
            return self.fail(Fault { detail: text, ..fault }, actions);
        }
        self.event(EventKind::Fault, &format!("{}: {text}", fault.name), actions);
        actions.push(Action::Dismiss { role, owner: owner.clone(), fault });
        self.vacate(now, role, Some(owner.instance), actions);
    }

    fn vacate(&mut self, now: Millis, role: Role, exclude: Option<InstanceId>, actions: &mut Vec<Action>) {
        self.counters.reassignments += 1;
        if self.counters.reassignments > self.timing.max_reassignments {
            let detail = format!("{} roles changed hands, last {role}", self.counters.reassignments);
            return self.fail(Fault::infrastructure("too_many_reassignments", detail), actions);
        }
        if let Some(seat) = self.seats.get_mut(&role) {
            if seat.ready {
                seat.vacant_since = now;
            }
            seat.owner = None;
            seat.ready = false;
            seat.exclude.clone_from(&exclude);
        }
        actions.push(Action::Want { role, exclude });
    }
}
