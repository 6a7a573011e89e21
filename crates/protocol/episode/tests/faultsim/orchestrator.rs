//! A simulated orchestrator process: a fleet and a driver over the shared ledger and journal. A deaf one is a zombie: it
//! goes on sending although ledger and journal refuse it, and hears nothing that would tell it so.

use std::collections::BTreeMap;

use bytes::Bytes;
use ds_episode::driver::{Action, Attempt, Driver, EncodedScene, Event, Journal};
use ds_episode::fleet::{AssignError, Fleet, FleetSettings, LedgerError, Lost, Request};
use ds_episode::stage::PullFrom;
use ds_episode::{Fault, Millis};
use ds_space::{AttemptId, EpisodeId, InstanceId};
use ds_topic::{Envelope, Owner, Role, Slot, Topic};

use super::cluster::{Cluster, Control, LEASE_MS, MARGIN_MS, Node, Occurrence, POLL_MS, TIMING, instance};
use super::store::SharedStore;
use super::toy::{SCENE, hash};

pub(crate) struct Orchestrator {
    pub up: bool,
    pub deaf: bool,
    pub term: u64,
    pub driver: Driver,
    fleet: Fleet<SharedStore>,
    /// The stream and the latest heartbeat of each worker.
    streams: BTreeMap<usize, (u64, Millis)>,
    queries: BTreeMap<u64, (Node, u32, Slot, PullFrom)>,
    observed: u32,
}

fn episode() -> EpisodeId {
    EpisodeId::new("toy").expect("a valid id")
}

impl Cluster {
    /// Starts an orchestrator over the shared store; it resumes what is committed.
    pub(crate) fn start_orchestrator(&mut self, workers_move: bool) {
        let index = self.orchestrators.len();
        let settings = FleetSettings {
            lease_ms: LEASE_MS,
            margin_ms: MARGIN_MS,
            deaths_to_quarantine: self.script.deaths_to_quarantine,
            failures_to_cordon: 2,
        };
        let fleet = Fleet::open(self.store.clone(), settings, Millis(self.now)).expect("the store cannot fail");
        let term = fleet.term();
        let attempt =
            Attempt { episode: episode(), attempt: AttemptId(1), instance: instance("orchestrator", index, 0), term };
        let scene = EncodedScene { content: hash("scene", &[], &[]), body: Bytes::from_static(SCENE) };
        let driver = {
            let store = self.store.0.borrow();
            let journal = Journal { iterations: store.iterations, messages: &store.journal };
            Driver::resume(attempt, TIMING, self.codec.clone(), scene, &journal).expect("the journal is whole")
        };
        let (streams, queries) = (BTreeMap::new(), BTreeMap::new());
        let fresh = Orchestrator { up: true, deaf: false, term, driver, fleet, streams, queries, observed: 0 };
        self.orchestrators.push(fresh);
        self.direct(index, Event::Start);
        self.schedule(1, Node::Orchestrator(index), Occurrence::Poll);
        if workers_move {
            for worker in 0..self.workers.len() {
                self.workers[worker].broken = self.dice.chance(0.7);
            }
        }
    }

    pub(crate) fn orchestrator_occurrence(&mut self, index: usize, occurrence: Occurrence) {
        if matches!(occurrence, Occurrence::Restart) {
            return self.start_orchestrator(false);
        }
        if !self.orchestrators[index].up {
            return;
        }
        match occurrence {
            Occurrence::Poll => {
                let lost = self.orchestrators[index].fleet.expire(Millis(self.now));
                self.lose(index, lost);
                self.check_charge(index);
                self.direct(index, Event::Now);
                self.schedule(POLL_MS, Node::Orchestrator(index), Occurrence::Poll);
            }
            Occurrence::Push(_) | Occurrence::PullReply { .. } if self.orchestrators[index].deaf => {}
            Occurrence::Push(message) => {
                self.pushes_delivered += 1;
                self.direct(index, Event::Message(message));
            }
            Occurrence::PullRequest { asker, life, slot, from } => {
                self.serial += 1;
                let query = self.serial;
                self.orchestrators[index].queries.insert(query, (asker, life, slot, from));
                self.direct(index, Event::Asked { query, slot });
            }
            Occurrence::PullReply { slot, reply, .. } => self.direct(index, Event::Pulled { slot, reply }),
            Occurrence::Append { iteration, messages } => self.append(index, iteration, messages),
            Occurrence::Journalled { iteration } => self.direct(index, Event::Journalled { iteration }),
            Occurrence::Control { stream, message } => self.on_call(index, stream, message),
            Occurrence::Made { .. } | Occurrence::Mishap(_) | Occurrence::Restart => {}
        }
    }

    /// Steps down when the ledger has a later term, unless deaf.
    fn check_charge(&mut self, index: usize) {
        let term = ds_episode::fleet::Ledger::term(&self.store).expect("the store cannot fail");
        if term != self.orchestrators[index].term && !self.orchestrators[index].deaf {
            self.direct(index, Event::Fenced { term });
        }
    }

    fn lose(&mut self, index: usize, lost: Result<Vec<Lost>, LedgerError>) {
        for loss in lost.unwrap_or_default() {
            let reason = loss.cause.name().to_owned();
            self.direct(index, Event::Lost { role: loss.role, epoch: loss.owner.epoch, reason });
        }
    }

    fn on_call(&mut self, index: usize, stream: u64, message: Control) {
        let Some(worker) = self.workers.iter().position(|worker| worker.stream() == Some(stream)) else { return };
        let instance = self.workers[worker].instance.clone();
        let now = Millis(self.now);
        let orchestrator = &mut self.orchestrators[index];
        if let Control::Hello(hello) = message {
            orchestrator.streams.insert(worker, (stream, Millis(0)));
            match orchestrator.fleet.join(now, hello) {
                Ok(joined) => {
                    self.lose(index, Ok(joined.lost));
                    self.order(index, &instance, Control::Joined);
                }
                Err(_) => self.order(index, &instance, Control::MustJoin),
            }
            return;
        }
        if orchestrator.streams.get(&worker).is_none_or(|(own, _)| *own != stream) {
            return;
        }
        match message {
            Control::Heartbeat { sent } => {
                orchestrator.streams.insert(worker, (stream, sent));
                match orchestrator.fleet.renew(now, &instance) {
                    Ok(Some(_)) => self.order(index, &instance, Control::Renewed { sent }),
                    Ok(None) => self.order(index, &instance, Control::MustJoin),
                    Err(_) => {}
                }
            }
            Control::Ready { role, epoch } => self.direct(index, Event::ReadyBy { role, epoch }),
            Control::Report { role, epoch, fault } => self.direct(index, Event::Faulted { role, epoch, fault }),
            Control::Draining => orchestrator.fleet.drain(&instance),
            Control::Leave => {
                let lost = orchestrator.fleet.leave(&instance);
                self.lose(index, lost);
            }
            _ => {}
        }
    }

    /// Sends on a worker's stream to this orchestrator; a loss breaks the stream.
    fn order(&mut self, index: usize, instance: &InstanceId, message: Control) {
        let Some(worker) = self.workers.iter().position(|worker| worker.instance == *instance) else { return };
        let Some((stream, _)) = self.orchestrators[index].streams.get(&worker).copied() else { return };
        if !self.workers[worker].up || self.workers[worker].stream() != Some(stream) {
            return;
        }
        if self.reachable(Node::Orchestrator(index), Node::Worker(worker)) {
            self.schedule(2, Node::Worker(worker), Occurrence::Control { stream, message });
        } else {
            self.workers[worker].broken = true;
        }
    }

    fn assign(&mut self, index: usize, role: Role, exclude: Option<InstanceId>) {
        let request = Request { episode: episode(), attempt: AttemptId(1), role, exclude };
        let orchestrator = &mut self.orchestrators[index];
        match orchestrator.fleet.assign(Millis(self.now), request) {
            Ok(granted) => {
                self.checks.grant(role, granted.owner.epoch, &granted.owner.instance);
                let owner = granted.owner.clone();
                let worker = self.workers.iter().position(|worker| worker.instance == owner.instance);
                let stream = worker.and_then(|worker| orchestrator.streams.get(&worker));
                let sent = stream.map_or(Millis(0), |(_, sent)| *sent);
                self.order(index, &owner.instance, Control::Assign { granted, sent });
                self.direct(index, Event::Assigned { role, owner });
            }
            Err(AssignError::Ledger(_)) => self.check_charge(index),
            Err(refusal) if refusal.lasting() => {
                let fault = Fault::infrastructure("quarantined", refusal);
                self.direct(index, Event::Unassignable { role, fault });
            }
            Err(_) => {}
        }
    }

    /// Feeds the driver and carries out what it wants.
    fn direct(&mut self, index: usize, event: Event) {
        let actions = self.orchestrators[index].driver.handle(Millis(self.now), event);
        let node = Node::Orchestrator(index);
        for action in actions {
            let orchestrator = &mut self.orchestrators[index];
            match action {
                Action::Publish(message) => {
                    let slot = message.header.slot;
                    let committed = self.store.0.borrow().iterations;
                    assert!(
                        slot.topic != Topic::Advance || slot.index <= committed,
                        "{slot} after {committed} commits"
                    );
                    self.push(node, &message);
                }
                Action::Pull { slot, owner } => {
                    let from = PullFrom::Owner(owner);
                    if let Some(to) = self.answerer(&from) {
                        self.ask(node, to, Occurrence::PullRequest { asker: node, life: 0, slot, from });
                    }
                }
                Action::Answer { query, reply } => {
                    if let Some((asker, life, slot, from)) = orchestrator.queries.remove(&query) {
                        self.ask(node, asker, Occurrence::PullReply { life, slot, from, reply });
                    }
                }
                Action::Lookup { query, slot } => {
                    if let Some((asker, life, asked, from)) = orchestrator.queries.remove(&query) {
                        let reply = self.store.0.borrow().find(slot);
                        self.ask(node, asker, Occurrence::PullReply { life, slot: asked, from, reply });
                    }
                }
                Action::Commit { iteration, messages } => {
                    for message in &messages {
                        self.checks.accept(message);
                    }
                    let delay = self.dice.range(0, 10);
                    self.schedule(delay, node, Occurrence::Append { iteration, messages });
                }
                Action::Want { role, exclude } => self.assign(index, role, exclude),
                Action::Dismiss { role, owner, .. } => self.dismiss(index, role, owner),
                Action::Observe(message) => {
                    assert_eq!(message.header.tick.0, orchestrator.observed, "states are observed in tick order, once");
                    orchestrator.observed += 1;
                }
                Action::Finish(ending) => self.on_finish(index, ending),
                Action::StepDown { .. } => orchestrator.up = false,
            }
        }
    }

    fn append(&mut self, index: usize, iteration: u32, messages: Vec<Envelope>) {
        let term = self.orchestrators[index].term;
        let appended = self.store.0.borrow_mut().append(term, iteration, messages);
        match appended {
            Ok(()) => {
                let delay = self.dice.range(0, 10);
                self.schedule(delay, Node::Orchestrator(index), Occurrence::Journalled { iteration });
            }
            Err(_) => self.check_charge(index),
        }
    }

    fn dismiss(&mut self, index: usize, role: Role, owner: Owner) {
        // A zombie's ledger refuses it, and then nothing was taken away.
        if self.orchestrators[index].fleet.dismiss(&episode(), role, &owner).is_ok() {
            let instance = owner.instance.clone();
            self.order(index, &instance, Control::Release { owner });
        }
    }

    fn on_finish(&mut self, index: usize, ending: ds_episode::driver::Ending) {
        let term = ds_episode::fleet::Ledger::term(&self.store).expect("the store cannot fail");
        if self.orchestrators[index].term == term {
            if ending.status == ds_episode::driver::Status::Completed {
                let last = self.script.outline.spec.last_tick.0;
                assert_eq!(self.orchestrators[index].observed, last + 1, "every state was observed");
            }
            self.ending = Some(ending);
        }
    }
}
