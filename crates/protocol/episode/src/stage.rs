//! The state machine of one assignment (episode, attempt, role, epoch): takes orders, gathers inputs, has the maker
//! restore and work, publishes, answers. Push is an optimisation, pull the guarantee.
//!
//! Held here: orders of a lower term or that do not name this owner are refused; one iteration has one order; a slot has
//! one content; work starts from the order's border state only; nothing is published while the lease has run out.
//! It does not decode inputs, read a clock, or know how messages travel.

mod event;
mod inbox;
mod orders;
mod outbox;
mod receive;
mod work;

use std::collections::BTreeMap;
use std::sync::Arc;

use ds_space::{Digest, InstanceId};
use ds_topic::{Advance, Envelope, Owner, Role, Slot, Topic};

pub use event::{Action, Assignment, Event, Output, PullFrom, StopReason};

use crate::clock::Millis;
use crate::codec::{Codec, Outline};
use crate::counters::Counters;
use crate::due;
use crate::fault::Fault;
use crate::pulls::{self, Pulls};
use crate::timing::Timing;
use inbox::Inbox;
use outbox::Outbox;

/// Inputs held before the scene says how many are due.
const CAPACITY_WITHOUT_SCENE: usize = 64;

/// An order that was accepted, with its identity.
#[derive(Debug, Clone)]
struct Order {
    advance: Advance,
    content: Digest,
}

/// What the maker is busy with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Busy {
    No,
    Restoring,
    Working,
}

/// The machine; see the module.
pub struct Stage {
    assignment: Assignment,
    timing: Timing,
    codec: Arc<dyn Codec>,
    scene: Option<(Envelope, Outline)>,
    /// The highest term seen.
    term: u64,
    owners: BTreeMap<Role, Owner>,
    /// The identity of every order seen.
    orders: BTreeMap<u32, Digest>,
    /// The order that is gathered for or worked on.
    order: Option<Order>,
    /// The order that came meanwhile.
    queued: Option<Order>,
    busy: Busy,
    /// The last iteration whose end the maker's state stands at; `Some(None)` is the state before iteration 0.
    state: Option<Option<u32>>,
    /// Content of the own `world` message at the end of that state.
    border: Digest,
    inbox: Inbox,
    outbox: Outbox,
    pulls: Pulls,
    lease_until: Millis,
    sequence: u64,
    heard: BTreeMap<InstanceId, u64>,
    next_repeat: Millis,
    draining: bool,
    broken: Option<Fault>,
    stopped: bool,
    counters: Counters,
}

impl Stage {
    /// Takes an assignment on.
    #[must_use]
    pub fn new(assignment: Assignment, timing: Timing, codec: Arc<dyn Codec>, now: Millis) -> Self {
        let owners = BTreeMap::from([(assignment.role, assignment.owner.clone())]);
        Self {
            timing,
            codec,
            scene: None,
            term: assignment.term,
            owners,
            orders: BTreeMap::new(),
            order: None,
            queued: None,
            busy: Busy::No,
            state: None,
            border: Digest::default(),
            inbox: Inbox::default(),
            outbox: Outbox::default(),
            pulls: Pulls::default(),
            lease_until: assignment.lease_until,
            sequence: 0,
            heard: BTreeMap::new(),
            next_repeat: now,
            draining: false,
            broken: None,
            stopped: false,
            counters: Counters::default(),
            assignment,
        }
    }

    /// Takes an event in at the own clock's `now` and returns what to do, in order.
    pub fn handle(&mut self, now: Millis, event: Event) -> Vec<Action> {
        let mut actions = Vec::new();
        if self.stopped {
            if let Event::Asked { query, .. } = event {
                actions.push(Action::Answer { query, reply: None });
            }
            return actions;
        }
        match event {
            Event::Message(message) => self.on_message(now, message, receive::Via::Push, &mut actions),
            Event::Pulled { slot, from, reply } => self.on_pulled(now, slot, from, reply, &mut actions),
            Event::Asked { query, slot } => {
                let reply = if self.leased(now) { self.outbox.get(slot).cloned() } else { None };
                actions.push(Action::Answer { query, reply });
            }
            Event::Restored { order, result } => self.on_restored(order, result, &mut actions),
            Event::Worked { order, result } => self.on_worked(now, order, result, &mut actions),
            Event::LeaseRenewed { until } => self.on_renewed(now, until, &mut actions),
            Event::Drain => self.draining = true,
            Event::Now => {}
        }
        self.pump(now, &mut actions);
        actions
    }

    /// Returns what was assigned.
    #[must_use]
    pub fn assignment(&self) -> &Assignment {
        &self.assignment
    }

    /// Returns the counts so far.
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// Returns the number of inputs held (the queue's depth).
    #[must_use]
    pub fn held_inputs(&self) -> usize {
        self.inbox.len()
    }

    /// Says whether the machine has ended.
    #[must_use]
    pub fn stopped(&self) -> bool {
        self.stopped
    }

    /// Lists what it waits for and for how many milliseconds.
    #[must_use]
    pub fn awaited(&self, now: Millis) -> Vec<(Slot, u64)> {
        self.pulls.awaited().map(|(slot, since)| (slot, now.since(since))).collect()
    }

    fn role(&self) -> Role {
        self.assignment.role
    }

    fn leased(&self, now: Millis) -> bool {
        now < self.lease_until
    }

    fn on_renewed(&mut self, now: Millis, until: Millis, actions: &mut Vec<Action>) {
        self.lease_until = self.lease_until.max(until);
        if self.leased(now) {
            actions.extend(self.outbox.release().into_iter().map(Action::Publish));
        }
    }

    fn stop(&mut self, reason: StopReason, actions: &mut Vec<Action>) {
        self.stopped = true;
        actions.push(Action::Stop(reason));
    }

    /// Goes on as far as what is there allows, then says what is missing.
    fn pump(&mut self, now: Millis, actions: &mut Vec<Action>) {
        if self.stopped {
            return;
        }
        self.take_order(actions);
        if !self.stopped && self.broken.is_none() && self.busy == Busy::No {
            self.begin(actions);
        }
        if self.stopped {
            return;
        }
        if self.next_repeat <= now {
            self.next_repeat = now.plus(self.timing.repeat_after_ms);
            self.repeat(actions);
        }
        let missing = self.missing();
        let worth = pulls::worthwhile(&missing, |slot, role| self.is_committed(slot) || self.begun(role));
        for (slot, tries) in self.pulls.due(now, self.timing.pull_after_ms, &missing, &worth) {
            self.counters.pulls += 1;
            actions.push(Action::Pull { slot, from: self.pull_from(slot, tries) });
        }
    }

    fn repeat(&mut self, actions: &mut Vec<Action>) {
        if let Some(fault) = &self.broken {
            actions.push(Action::Report(fault.clone()));
        } else if self.scene.is_some() && self.orders.is_empty() && !self.draining {
            actions.push(Action::Ready { epoch: self.assignment.owner.epoch });
        }
    }

    /// Returns what is awaited now; orders among it, because their owners may have changed.
    fn missing(&self) -> Vec<Slot> {
        if self.broken.is_some() || self.busy != Busy::No {
            return Vec::new();
        }
        let Some((_, outline)) = &self.scene else { return vec![Slot::new(Topic::Scene, 0)] };
        let Some(order) = &self.order else {
            let next = self.orders.last_key_value().map_or(0, |(iteration, _)| iteration + 1);
            return if next < outline.spec.iterations() { vec![Slot::new(Topic::Advance, next)] } else { Vec::new() };
        };
        let mut slots = vec![Slot::new(Topic::Advance, order.advance.iteration)];
        slots.extend(self.needed(outline, &order.advance).into_iter().filter(|slot| !self.inbox.has(*slot)));
        slots
    }

    /// Says whether a message belongs to an iteration before the current order's, and so is in the journal.
    fn is_committed(&self, slot: Slot) -> bool {
        let (Some(order), Some((_, outline))) = (&self.order, &self.scene) else { return false };
        due::tick_of(&outline.spec, slot) < order.advance.first
    }

    /// Says whether a role has published something of the current order.
    fn begun(&self, role: Role) -> bool {
        let (Some(order), Some((_, outline))) = (&self.order, &self.scene) else { return true };
        let inputs = due::inputs(outline, self.role(), &order.advance).into_iter();
        let mut of_order = inputs.filter(|slot| due::tick_of(&outline.spec, *slot) >= order.advance.first);
        of_order.any(|slot| due::maker(slot.topic) == Some(role) && self.inbox.has(slot))
    }

    /// Asks the owner first for what this iteration makes, the journal first for what is committed; then in turn.
    fn pull_from(&self, slot: Slot, tries: u32) -> PullFrom {
        let Some(role) = due::maker(slot.topic).filter(|_| self.scene.is_some()) else { return PullFrom::Journal };
        match self.owners.get(&role) {
            Some(owner) if tries.is_multiple_of(2) != self.is_committed(slot) => PullFrom::Owner(owner.clone()),
            _ => PullFrom::Journal,
        }
    }
}
