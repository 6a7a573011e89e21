//! The orchestrator's state machine of one attempt: seats the roles, sends work orders, collects and commits, and decides
//! what follows from a fault. It is the only one that moves time.
//!
//! Held here: iteration i+1 is ordered only after the journal holds all messages of i; the first accepted plan is final;
//! messages of another epoch than the seated one are refused; two contents of one slot end the attempt; a deadline
//! changes the status, never the data. It does not score, store, or hold leases (see [`crate::fleet`]).

mod event;
mod orders;
mod receive;
mod resume;
mod seats;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use bytes::Bytes;
use ds_space::{AttemptId, Digest, EpisodeId, InstanceId, SimTime, Tick};
use ds_topic::{Advance, Envelope, EventKind, Header, Owner, Role, SCHEMA_VERSION, Slot, Topic};

pub use event::{Action, Awaited, Ending, Event, Status};
pub use resume::{Journal, ResumeError};

use crate::clock::Millis;
use crate::codec::{Codec, CodecError, Outline};
use crate::counters::Counters;
use crate::due;
use crate::fault::{Fault, FaultClass};
use crate::pulls::{self, Pulls};
use crate::timing::Timing;
use seats::{Seat, Tenure};

/// What is driven, and by whom.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Attempt {
    /// The episode.
    pub episode: EpisodeId,
    /// The attempt at it.
    pub attempt: AttemptId,
    /// This orchestrator.
    pub instance: InstanceId,
    /// Its term.
    pub term: u64,
}

/// The body of the `scene` topic, encoded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EncodedScene {
    /// Digest over its decoded fields.
    pub content: Digest,
    /// The encoded body.
    pub body: Bytes,
}

/// The iteration under way.
struct Current {
    /// Without owners; they are filled in when it is sent.
    advance: Advance,
    /// As it was last sent.
    order: Option<Envelope>,
    /// All slots that it makes due, sorted.
    due: Vec<Slot>,
    accepted: BTreeMap<Slot, Envelope>,
    /// When it was ordered, or when all seats were last taken.
    since: Millis,
    /// How often its order might have been repeated.
    patience: u32,
    committing: bool,
}

/// What is known of a committed message.
#[derive(Debug, Clone, Copy)]
struct Committed {
    content: Digest,
    epoch: u64,
}

/// The machine; see the module.
pub struct Driver {
    attempt: Attempt,
    timing: Timing,
    codec: Arc<dyn Codec>,
    outline: Outline,
    scene: Envelope,
    seats: BTreeMap<Role, Seat>,
    started: bool,
    current: Option<Current>,
    committed: BTreeMap<Slot, Committed>,
    committed_iterations: u32,
    /// The messages of the last committed iteration.
    recent: BTreeMap<Slot, Envelope>,
    /// Content of the last committed `world`.
    border: Digest,
    /// The accepted plan of the iteration before the next.
    plan: Option<ds_topic::Plan>,
    /// Committed states that were not observed yet.
    unobserved: Vec<Envelope>,
    sequence: u64,
    events: u32,
    pulls: Pulls,
    next_repeat: Millis,
    ending: Option<Ending>,
    stepped_down: bool,
    counters: Counters,
}

impl Driver {
    /// Prepares an attempt from its first tick.
    ///
    /// # Errors
    /// [`CodecError`] if the scene cannot be read.
    pub fn new(
        attempt: Attempt,
        timing: Timing,
        codec: Arc<dyn Codec>,
        scene: EncodedScene,
    ) -> Result<Self, CodecError> {
        let outline = codec.outline(&scene.body)?;
        let header = header_of(&attempt, Slot::new(Topic::Scene, 0), scene.content);
        Ok(Self {
            attempt,
            timing,
            codec,
            outline,
            scene: Envelope { header, body: scene.body },
            seats: Role::ALL.into_iter().map(|role| (role, Seat::default())).collect(),
            started: false,
            current: None,
            committed: BTreeMap::new(),
            committed_iterations: 0,
            recent: BTreeMap::new(),
            border: Digest::default(),
            plan: None,
            unobserved: Vec::new(),
            sequence: 1,
            events: 0,
            pulls: Pulls::default(),
            next_repeat: Millis::default(),
            ending: None,
            stepped_down: false,
            counters: Counters::default(),
        })
    }

    /// Takes an event in at the own clock's `now` and returns what to do, in order.
    pub fn handle(&mut self, now: Millis, event: Event) -> Vec<Action> {
        let mut actions = Vec::new();
        if self.stepped_down {
            if let Event::Asked { query, .. } = event {
                actions.push(Action::Answer { query, reply: None });
            }
            return actions;
        }
        if let Event::Asked { query, slot } = event {
            actions.push(self.answer(query, slot));
            return actions;
        }
        if let Event::Fenced { term } = event {
            self.step_down(term, &mut actions);
            return actions;
        }
        if self.ending.is_some() {
            return actions;
        }
        match event {
            Event::Start => self.start(now, &mut actions),
            Event::Assigned { role, owner } => self.on_assigned(now, role, owner, &mut actions),
            Event::Unassignable { role, fault } => {
                let fault = Fault { detail: format!("{role}: {}", fault.detail), ..fault };
                self.finish(Status::Aborted, Some(fault), &mut actions);
            }
            Event::ReadyBy { role, epoch } => self.on_ready(now, role, epoch, &mut actions),
            Event::Lost { role, epoch, reason } => self.on_lost(now, Tenure { role, epoch }, &reason, &mut actions),
            Event::Faulted { role, epoch, fault } => self.on_fault(now, Tenure { role, epoch }, fault, &mut actions),
            Event::Message(message) => self.on_message(message, &mut actions),
            Event::Pulled { slot, reply } => self.on_pulled(slot, reply, &mut actions),
            Event::Journalled { iteration } => self.on_journalled(now, iteration, &mut actions),
            Event::Scored { tick, content, body } => {
                let message = self.envelope(Slot::new(Topic::Score, tick.0), content, body);
                actions.push(Action::Publish(message));
            }
            Event::Cancel => {
                let fault = Fault::infrastructure("cancelled", "on request");
                self.finish(Status::Aborted, Some(fault), &mut actions);
            }
            Event::Now | Event::Asked { .. } | Event::Fenced { .. } => {}
        }
        self.pump(now, &mut actions);
        actions
    }

    /// Returns how the attempt ended, once it did.
    #[must_use]
    pub fn ending(&self) -> Option<&Ending> {
        self.ending.as_ref()
    }

    /// Returns the `scene` message, the first of the journal.
    #[must_use]
    pub fn scene(&self) -> &Envelope {
        &self.scene
    }

    /// Returns the outline of the scene.
    #[must_use]
    pub fn outline(&self) -> &Outline {
        &self.outline
    }

    /// Returns the number of committed iterations.
    #[must_use]
    pub fn committed_iterations(&self) -> u32 {
        self.committed_iterations
    }

    /// Returns the counts so far.
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// Lists which messages the iteration lacks, from whom, since when.
    #[must_use]
    pub fn awaited(&self, now: Millis) -> Vec<Awaited> {
        let Some(current) = &self.current else { return Vec::new() };
        let lacking = current.due.iter().filter(|slot| !current.accepted.contains_key(slot));
        let owner = |slot: &Slot| due::maker(slot.topic).and_then(|role| self.seats[&role].owner.clone());
        lacking.map(|slot| Awaited { slot: *slot, owner: owner(slot), for_ms: now.since(current.since) }).collect()
    }

    /// Lists the roles that nobody is ready to play, who was asked to, and for how many milliseconds.
    #[must_use]
    pub fn vacant(&self, now: Millis) -> Vec<(Role, Option<Owner>, u64)> {
        let vacant = self.seats.iter().filter(|(_, seat)| !seat.ready);
        vacant.map(|(role, seat)| (*role, seat.owner.clone(), now.since(seat.vacant_since))).collect()
    }

    fn start(&mut self, now: Millis, actions: &mut Vec<Action>) {
        if self.started {
            return;
        }
        self.started = true;
        self.next_repeat = now.plus(self.timing.repeat_after_ms);
        actions.extend(std::mem::take(&mut self.unobserved).into_iter().map(Action::Observe));
        if self.committed_iterations >= self.outline.spec.iterations() {
            return self.finish(Status::Completed, None, actions);
        }
        self.event(EventKind::Started, &format!("iteration {}", self.committed_iterations), actions);
        for (role, seat) in &mut self.seats {
            seat.vacant_since = now;
            actions.push(Action::Want { role: *role, exclude: None });
        }
    }

    fn pump(&mut self, now: Millis, actions: &mut Vec<Action>) {
        if !self.started || self.ending.is_some() || self.stepped_down {
            return;
        }
        self.check_deadlines(now, actions);
        if self.ending.is_some() {
            return;
        }
        if self.next_repeat <= now {
            self.next_repeat = now.plus(self.timing.repeat_after_ms);
            self.repeat(now, actions);
        }
        let missing: Vec<Slot> = match &self.current {
            Some(current) if current.order.is_some() => {
                current.due.iter().filter(|slot| !current.accepted.contains_key(slot)).copied().collect()
            }
            _ => Vec::new(),
        };
        let worth = self.worthwhile(&missing);
        for (slot, _) in self.pulls.due(now, self.timing.pull_after_ms, &missing, &worth) {
            let seat = due::maker(slot.topic).map(|role| &self.seats[&role]);
            if let Some(owner) = seat.filter(|seat| seat.ready).and_then(|seat| seat.owner.clone()) {
                self.counters.pulls += 1;
                actions.push(Action::Pull { slot, owner });
            }
        }
    }

    /// Returns what is worth asking for: what the first role lacks, for those behind it may not have begun.
    fn worthwhile(&self, missing: &[Slot]) -> BTreeSet<Slot> {
        let maker = |slot: &Slot| due::maker(slot.topic);
        let Some(first) = missing.iter().filter_map(maker).min() else { return BTreeSet::new() };
        let of_first: Vec<Slot> = missing.iter().filter(|slot| maker(slot) == Some(first)).copied().collect();
        let accepted = self.current.as_ref().map(|current| &current.accepted);
        let begun = accepted.is_some_and(|accepted| accepted.keys().any(|slot| maker(slot) == Some(first)));
        pulls::worthwhile(&of_first, |_, _| begun)
    }

    fn repeat(&mut self, now: Millis, actions: &mut Vec<Action>) {
        let patience_ms = self.timing.vacancy_deadline_ms / 2;
        for (role, seat) in &self.seats {
            if seat.owner.is_none() {
                let exclude = seat.exclude.clone().filter(|_| now.since(seat.vacant_since) < patience_ms);
                actions.push(Action::Want { role: *role, exclude });
            }
        }
        if self.seats.values().any(|seat| seat.owner.is_some() && !seat.ready) {
            actions.push(Action::Publish(self.scene.clone()));
        }
        // Each repeat has all stages publish again what they made: in an iteration that takes long they become rare.
        let sent = self.current.as_mut().filter(|current| current.order.is_some() && !current.committing);
        let again = sent.is_some_and(|current| {
            current.patience += 1;
            current.patience.is_power_of_two() || current.patience.is_multiple_of(8)
        });
        if again {
            self.counters.repeats += 1;
            self.send_order(actions);
        }
    }

    fn check_deadlines(&mut self, now: Millis, actions: &mut Vec<Action>) {
        let vacant = |seat: &Seat| !seat.ready && now.since(seat.vacant_since) > self.timing.vacancy_deadline_ms;
        if let Some((role, seat)) = self.seats.iter().find(|(_, seat)| vacant(seat)) {
            let (waited, owner) = (now.since(seat.vacant_since), &seat.owner);
            let detail = format!("{role} has no ready holder for {waited} ms, assigned {owner:?}");
            let fault = Fault::infrastructure("no_instance", detail);
            return self.finish(Status::Aborted, Some(fault), actions);
        }
        let Some(current) = &self.current else { return };
        let all_ready = self.seats.values().all(|seat| seat.ready);
        if all_ready && now.since(current.since) > self.timing.iteration_deadline_ms {
            let lacking = self.awaited(now);
            let first = lacking.first().map_or("the journal".to_owned(), |awaited| format!("{}", awaited.slot));
            let detail =
                format!("advance[{}] awaits {} messages, first {first}", current.advance.iteration, lacking.len());
            self.finish(Status::Aborted, Some(Fault::infrastructure("iteration_deadline", detail)), actions);
        }
    }

    fn finish(&mut self, status: Status, fault: Option<Fault>, actions: &mut Vec<Action>) {
        if self.ending.is_some() {
            return;
        }
        let kind = match status {
            Status::Completed => EventKind::Completed,
            Status::Failed => EventKind::Failed,
            Status::Aborted => EventKind::Aborted,
        };
        let reason = fault.as_ref().map(Fault::to_string).unwrap_or_default();
        self.event(kind, &reason, actions);
        let class = fault.map(|fault| fault.class);
        let ending = Ending { status, reason, class, committed: self.committed_iterations };
        self.ending = Some(ending.clone());
        actions.push(Action::Finish(ending));
    }

    /// Ends the attempt by the rule of a fault's class.
    fn fail(&mut self, fault: Fault, actions: &mut Vec<Action>) {
        let status = if fault.class == FaultClass::Infrastructure { Status::Aborted } else { Status::Failed };
        self.finish(status, Some(fault), actions);
    }

    fn step_down(&mut self, term: u64, actions: &mut Vec<Action>) {
        self.stepped_down = true;
        actions.push(Action::StepDown { term });
    }

    fn event(&mut self, kind: EventKind, reason: &str, actions: &mut Vec<Action>) {
        let event = ds_topic::Event { kind, reason: reason.to_owned() };
        let mut writer = ds_space::DigestWriter::new();
        event.digest_into(&mut writer);
        let slot = Slot::new(Topic::Event, self.events);
        self.events += 1;
        let body = self.codec.encode_event(&event);
        let message = self.envelope(slot, writer.finish(), body);
        actions.push(Action::Publish(message));
    }

    fn envelope(&mut self, slot: Slot, content: Digest, body: Bytes) -> Envelope {
        let mut header = header_of(&self.attempt, slot, content);
        header.sequence = self.sequence;
        header.tick = due::tick_of(&self.outline.spec, slot);
        header.time = SimTime::at(header.tick, self.outline.dt);
        header.iteration = self.current.as_ref().map_or(0, |current| current.advance.iteration);
        self.sequence += 1;
        Envelope { header, body }
    }
}

fn header_of(attempt: &Attempt, slot: Slot, content: Digest) -> Header {
    Header {
        episode: attempt.episode.clone(),
        attempt: attempt.attempt,
        term: attempt.term,
        epoch: 0,
        iteration: 0,
        tick: Tick(0),
        time: SimTime(0),
        sequence: 0,
        publisher: attempt.instance.clone(),
        schema_version: SCHEMA_VERSION,
        trace: String::new(),
        slot,
        content,
    }
}
