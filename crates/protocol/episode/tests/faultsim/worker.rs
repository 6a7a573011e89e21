//! A simulated worker process: a stage, a toy maker, a clock of its own, a control stream that may break. It does what
//! the head of `ds_episode` asks of a service.

use std::collections::BTreeMap;

use bytes::Bytes;
use ds_episode::fleet::{ComputeClass, Hello};
use ds_episode::stage::{Action, Assignment, Event, PullFrom, Stage, StopReason};
use ds_episode::{Codec, Millis};
use ds_space::InstanceId;
use ds_topic::{Advance, Envelope, Role, Slot, Topic};

use super::cluster::{Cluster, Control, LEASE_MS, Made, Node, Occurrence, POLL_MS, TIMING, instance};
use super::script::{Mishap, Moment};
use super::toy::{ToyMaker, hash};

pub(crate) struct Held {
    pub stage: Stage,
    maker: ToyMaker,
    serial: u64,
    /// The lease as the process was told, kept apart from the machine to check it.
    lease_until: Millis,
    /// What the stage must know of epochs and terms from the orders that it took.
    pub known_epochs: BTreeMap<Role, u64>,
    pub known_term: u64,
}

pub(crate) struct Worker {
    pub role: Role,
    index: usize,
    pub life: u32,
    pub instance: InstanceId,
    pub up: bool,
    pub frozen_until: u64,
    offset: u64,
    pub held: Option<Held>,
    /// The orchestrator and the number of the stream to it.
    home: Option<(usize, u64)>,
    /// Set where a message was lost on the stream.
    pub broken: bool,
    next_heartbeat: u64,
    /// When a heartbeat was last answered.
    answered: u64,
    queries: BTreeMap<u64, (Node, u32, Slot, PullFrom)>,
    leaving: Option<u64>,
}

impl Worker {
    pub(crate) fn new(role: Role, index: usize, offset: u64) -> Self {
        Self {
            role,
            index,
            life: 0,
            instance: instance(role.name(), index, 0),
            up: true,
            frozen_until: 0,
            offset,
            held: None,
            home: None,
            broken: true,
            next_heartbeat: 0,
            answered: 0,
            queries: BTreeMap::new(),
            leaving: None,
        }
    }

    /// The process's own monotonic clock.
    pub(crate) fn clock(&self, now: u64) -> Millis {
        Millis(now + self.offset)
    }

    /// The number of its stream, if it has one.
    pub(crate) fn stream(&self) -> Option<u64> {
        self.home.map(|(_, stream)| stream)
    }
}

impl Cluster {
    pub(crate) fn worker_occurrence(&mut self, index: usize, occurrence: Occurrence) {
        if !self.workers[index].up {
            if matches!(occurrence, Occurrence::Restart) {
                self.restart(index);
            }
            return;
        }
        match occurrence {
            Occurrence::Poll => {
                self.heartbeat(index);
                self.tell(index, Event::Now);
                self.schedule(POLL_MS, Node::Worker(index), Occurrence::Poll);
            }
            Occurrence::Push(message) => {
                self.pushes_delivered += 1;
                self.tell(index, Event::Message(message));
            }
            Occurrence::PullRequest { asker, life, slot, from } => {
                self.serial += 1;
                let query = self.serial;
                if self.workers[index].held.is_some() {
                    self.workers[index].queries.insert(query, (asker, life, slot, from));
                    self.tell(index, Event::Asked { query, slot });
                }
            }
            Occurrence::PullReply { life, slot, from, reply } => {
                if self.workers[index].life == life {
                    self.tell(index, Event::Pulled { slot, from, reply });
                }
            }
            Occurrence::Made { stage, order, made } => {
                if self.workers[index].held.as_ref().is_none_or(|held| held.serial != stage) {
                    return;
                }
                match made {
                    Made::Restored(result) => self.tell(index, Event::Restored { order, result }),
                    Made::Worked(result) => self.tell(index, Event::Worked { order, result }),
                }
            }
            Occurrence::Control { stream, message } => {
                if self.workers[index].home.is_some_and(|(_, own)| own == stream) {
                    self.on_order(index, message);
                }
            }
            Occurrence::Append { .. } | Occurrence::Journalled { .. } | Occurrence::Mishap(_) | Occurrence::Restart => {
            }
        }
    }

    fn heartbeat(&mut self, index: usize) {
        let now = self.now;
        let newest = self.orchestrators.iter().rposition(|orchestrator| orchestrator.up);
        let worker = &mut self.workers[index];
        if now < worker.next_heartbeat {
            return;
        }
        worker.next_heartbeat = now + LEASE_MS / 4;
        let sent = worker.clock(now);
        worker.broken |= now > worker.answered + 2 * LEASE_MS;
        if worker.broken || worker.home.is_none() {
            let Some(home) = newest.filter(|home| self.reachable(Node::Worker(index), Node::Orchestrator(*home)))
            else {
                return;
            };
            self.drop_stage(index);
            self.serial += 1;
            let stream = self.serial;
            let worker = &mut self.workers[index];
            worker.home = Some((home, stream));
            worker.broken = false;
            worker.answered = now;
            let hello = Hello {
                instance: worker.instance.clone(),
                role: worker.role,
                slots: 1,
                devices: Vec::new(),
                shares_device: false,
                class: ComputeClass("toy".to_owned()),
            };
            self.control(index, Control::Hello(hello));
        }
        self.control(index, Control::Heartbeat { sent });
    }

    /// Sends on the worker's stream; a loss breaks the stream.
    pub(crate) fn control(&mut self, index: usize, message: Control) {
        let Some((home, stream)) = self.workers[index].home else { return };
        if self.orchestrators[home].up && self.reachable(Node::Worker(index), Node::Orchestrator(home)) {
            self.schedule(2, Node::Orchestrator(home), Occurrence::Control { stream, message });
        } else {
            self.workers[index].broken = true;
        }
    }

    fn on_order(&mut self, index: usize, message: Control) {
        match message {
            Control::Renewed { sent } => {
                let until = sent.plus(LEASE_MS);
                self.workers[index].answered = self.now;
                if let Some(held) = &mut self.workers[index].held {
                    held.lease_until = held.lease_until.max(until);
                }
                self.tell(index, Event::LeaseRenewed { until });
            }
            Control::MustJoin => self.workers[index].broken = true,
            Control::Assign { granted, sent } => {
                self.drop_stage(index);
                self.serial += 1;
                let worker = &mut self.workers[index];
                let lease_until = sent.plus(LEASE_MS);
                let assignment = Assignment {
                    episode: granted.request.episode,
                    attempt: granted.request.attempt,
                    role: granted.request.role,
                    owner: granted.owner,
                    term: granted.term,
                    lease_until,
                };
                let now = worker.clock(self.now);
                let stage = Stage::new(assignment, TIMING, self.codec.clone(), now);
                let maker = ToyMaker::new(worker.role, self.script.outline.clone());
                let (serial, known_term) = (self.serial, granted.term);
                let known_epochs = BTreeMap::new();
                worker.held = Some(Held { stage, maker, serial, lease_until, known_epochs, known_term });
                self.tell(index, Event::Now);
            }
            Control::Release { owner } => {
                let held = self.workers[index].held.as_ref();
                if held.is_some_and(|held| held.stage.assignment().owner == owner) {
                    self.drop_stage(index);
                }
            }
            _ => {}
        }
    }

    fn drop_stage(&mut self, index: usize) {
        if let Some(held) = self.workers[index].held.take() {
            self.totals += held.stage.counters();
        }
        self.workers[index].queries.clear();
    }

    /// Feeds the stage and carries out what it wants.
    fn tell(&mut self, index: usize, event: Event) {
        let worker = &mut self.workers[index];
        let now = worker.clock(self.now);
        let Some(held) = &mut worker.held else { return };
        let worked = matches!(event, Event::Worked { .. });
        let order = match &event {
            Event::Message(message) | Event::Pulled { reply: Some(message), .. } => {
                Some(message.clone()).filter(|message| message.header.slot.topic == Topic::Advance)
            }
            _ => None,
        };
        let actions = held.stage.handle(now, event);
        if let Some(order) = order.filter(|order| order.header.term >= held.known_term) {
            let owners = self.codec.decode_advance(&order.body).expect("orders are readable").owners;
            if owners.get(&worker.role) == Some(&held.stage.assignment().owner) {
                held.known_term = order.header.term;
                for (role, owner) in owners {
                    let known = held.known_epochs.entry(role).or_default();
                    *known = owner.epoch.max(*known);
                }
            }
        }
        let iteration = actions.iter().find_map(|action| match action {
            Action::Publish(message) if worked => Some(message.header.iteration),
            _ => None,
        });
        let node = Node::Worker(index);
        for action in actions {
            let worker = &mut self.workers[index];
            let (life, role) = (worker.life, worker.role);
            let Some(held) = &worker.held else { return };
            match action {
                Action::Publish(message) => {
                    self.checks.publish(&message, now < held.lease_until);
                    self.push(node, &message);
                }
                Action::Pull { slot, from } => {
                    if let Some(to) = self.answerer(&from) {
                        self.ask(node, to, Occurrence::PullRequest { asker: node, life, slot, from });
                    }
                }
                Action::Answer { query, reply } => {
                    if let Some((asker, life, slot, from)) = worker.queries.remove(&query) {
                        self.ask(node, asker, Occurrence::PullReply { life, slot, from, reply });
                    }
                }
                Action::Restore { inputs, advance, .. } => self.restore(index, &inputs, &advance),
                Action::Work { advance, inputs } => self.work(index, &advance, &inputs),
                Action::Ready { epoch } => self.control(index, Control::Ready { role, epoch }),
                Action::Report(fault) => {
                    let epoch = held.stage.assignment().owner.epoch;
                    self.control(index, Control::Report { role, epoch, fault });
                }
                Action::Stop(reason) => self.on_stop(index, &reason),
            }
        }
        if let Some(iteration) = iteration {
            self.strike(index, iteration, Moment::After);
        }
    }

    fn on_stop(&mut self, index: usize, reason: &StopReason) {
        self.drop_stage(index);
        if *reason == StopReason::Drained {
            self.leave(index);
        }
    }

    fn restore(&mut self, index: usize, inputs: &BTreeMap<Slot, Envelope>, advance: &Advance) {
        let Some(held) = &mut self.workers[index].held else { return };
        let result = held.maker.restore(inputs, advance);
        let occurrence =
            Occurrence::Made { stage: held.serial, order: advance.content(), made: Made::Restored(result) };
        let delay = self.dice.range(1, 30);
        self.schedule(delay, Node::Worker(index), occurrence);
    }

    fn work(&mut self, index: usize, advance: &Advance, inputs: &BTreeMap<Slot, Envelope>) {
        if self.strike(index, advance.iteration, Moment::Before) {
            return;
        }
        let Some(held) = &mut self.workers[index].held else { return };
        let owner = held.stage.assignment().owner.clone();
        self.checks.execute(&owner.instance, owner.epoch, advance.iteration);
        for input in inputs.values() {
            self.checks.accept(input);
        }
        let mut outputs = held.maker.work(advance, inputs);
        if self.script.fickle_policy && owner.instance.as_str().starts_with(Role::Policy.name()) {
            for plan in &mut outputs {
                plan.content = hash("mood", &[plan.content], &[owner.epoch as u32]);
                plan.body = Bytes::copy_from_slice(&plan.content.0);
            }
        }
        let occurrence =
            Occurrence::Made { stage: held.serial, order: advance.content(), made: Made::Worked(Ok(outputs)) };
        let delay = self.dice.range(1, 40);
        self.schedule(delay, Node::Worker(index), occurrence);
        self.strike(index, advance.iteration, Moment::Middle);
    }

    /// Lets a scripted mishap of this moment happen; says whether the worker is gone.
    fn strike(&mut self, index: usize, at: u32, when: Moment) -> bool {
        let own = self.workers[index].role;
        let mut killed = false;
        for mishap in &mut self.mishaps {
            match mishap {
                Mishap::KillAtWork { role, iteration, moment, times }
                    if *role == own && *iteration == at && *moment == when && *times > 0 =>
                {
                    *times -= 1;
                    killed = true;
                }
                Mishap::HangAtWork { role, iteration, for_ms }
                    if *role == own && *iteration == at && when == Moment::Middle && *for_ms > 0 =>
                {
                    self.workers[index].frozen_until = self.now + std::mem::take(for_ms);
                }
                _ => {}
            }
        }
        if killed {
            self.kill(index, 300);
        }
        killed
    }

    pub(crate) fn kill(&mut self, index: usize, restart_after: u64) {
        if !self.workers[index].up {
            return;
        }
        self.drop_stage(index);
        let worker = &mut self.workers[index];
        worker.up = false;
        worker.frozen_until = 0;
        self.schedule(restart_after, Node::Worker(index), Occurrence::Restart);
    }

    fn restart(&mut self, index: usize) {
        let offset = self.dice.range(0, 1_000_000);
        let worker = &mut self.workers[index];
        let life = worker.life + 1;
        let mut next = Worker::new(worker.role, worker.index, offset);
        next.life = life;
        next.instance = instance(next.role.name(), index, life);
        *worker = next;
        self.schedule(1, Node::Worker(index), Occurrence::Poll);
    }

    pub(crate) fn drain(&mut self, index: usize, restart_after: u64) {
        if !self.workers[index].up || self.now < self.workers[index].frozen_until {
            return;
        }
        self.workers[index].leaving = Some(restart_after);
        self.control(index, Control::Draining);
        if self.workers[index].held.is_some() {
            self.tell(index, Event::Drain);
        } else {
            self.leave(index);
        }
    }

    fn leave(&mut self, index: usize) {
        self.control(index, Control::Leave);
        let restart_after = self.workers[index].leaving.take().unwrap_or(300);
        self.kill(index, restart_after);
    }
}
