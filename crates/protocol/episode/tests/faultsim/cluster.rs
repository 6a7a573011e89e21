//! The simulated cluster: virtual time, an event queue, a bus that loses, repeats, delays and partitions, and control
//! streams that break. Everything follows from the script's seed.

use std::collections::BTreeMap;
use std::sync::Arc;

use ds_episode::driver::Ending;
use ds_episode::fleet::{Granted, Hello};
use ds_episode::stage::{Output, PullFrom};
use ds_episode::{Codec, Counters, Fault, Millis, Timing, due};
use ds_space::{Digest, InstanceId};
use ds_topic::{Envelope, Owner, Role, Slot, Topic};

use super::orchestrator::Orchestrator;
use super::script::{Dice, Mishap, Script};
use super::store::{Checks, SharedStore};
use super::toy::{ToyCodec, hash};
use super::worker::Worker;

pub(crate) const TIMING: Timing = Timing {
    pull_after_ms: 20,
    repeat_after_ms: 100,
    iteration_deadline_ms: 20_000,
    vacancy_deadline_ms: 20_000,
    max_reassignments: 40,
};
pub(crate) const LEASE_MS: u64 = 400;
pub(crate) const MARGIN_MS: u64 = 100;
pub(crate) const POLL_MS: u64 = 10;
const LIMIT_MS: u64 = 120_000;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Node {
    Orchestrator(usize),
    Worker(usize),
}

/// What a maker answers.
pub(crate) enum Made {
    Restored(Result<(), Fault>),
    Worked(Result<Vec<Output>, Fault>),
}

/// What travels on control streams.
pub(crate) enum Control {
    Hello(Hello),
    Heartbeat { sent: Millis },
    Ready { role: Role, epoch: u64 },
    Report { role: Role, epoch: u64, fault: Fault },
    Draining,
    Leave,
    Joined,
    Renewed { sent: Millis },
    MustJoin,
    Assign { granted: Granted, sent: Millis },
    Release { owner: Owner },
}

pub(crate) enum Occurrence {
    Poll,
    Push(Envelope),
    PullRequest { asker: Node, life: u32, slot: Slot, from: PullFrom },
    PullReply { life: u32, slot: Slot, from: PullFrom, reply: Option<Envelope> },
    Made { stage: u64, order: Digest, made: Made },
    Control { stream: u64, message: Control },
    Append { iteration: u32, messages: Vec<Envelope> },
    Journalled { iteration: u32 },
    Mishap(Mishap),
    Restart,
}

pub(crate) struct Cluster {
    pub now: u64,
    pub script: Script,
    pub codec: Arc<ToyCodec>,
    pub dice: Dice,
    pub store: SharedStore,
    pub checks: Checks,
    pub workers: Vec<Worker>,
    pub orchestrators: Vec<Orchestrator>,
    pub mishaps: Vec<Mishap>,
    pub ending: Option<Ending>,
    pub pushes_delivered: u64,
    ghosts: u64,
    /// Counts of ended stages.
    pub totals: Counters,
    pub serial: u64,
    queue: BTreeMap<(u64, u64), (Node, Occurrence)>,
    partitions: Vec<(u32, u64)>,
}

/// What a run came to.
pub(crate) struct Outcome {
    pub ending: Ending,
    pub contents: BTreeMap<Slot, Digest>,
    pub journal: Vec<Envelope>,
    pub totals: Counters,
    pub driver: Counters,
    pub pushes_delivered: u64,
    pub ghosts: u64,
}

impl Cluster {
    pub(crate) fn new(script: Script) -> Self {
        let codec = Arc::new(ToyCodec::new(script.outline.clone()));
        let mut cluster = Self {
            now: 0,
            dice: Dice::new(script.seed),
            codec,
            store: SharedStore::default(),
            checks: Checks::default(),
            workers: Vec::new(),
            orchestrators: Vec::new(),
            mishaps: script.mishaps.clone(),
            ending: None,
            pushes_delivered: 0,
            ghosts: 0,
            totals: Counters::default(),
            serial: 0,
            queue: BTreeMap::new(),
            partitions: Vec::new(),
            script,
        };
        cluster.start_orchestrator(false);
        for role in Role::ALL {
            for _ in 0..cluster.script.workers_per_role {
                let worker = cluster.workers.len();
                let offset = cluster.dice.range(0, 1_000_000);
                cluster.workers.push(Worker::new(role, worker, offset));
                cluster.schedule(1, Node::Worker(worker), Occurrence::Poll);
            }
        }
        for mishap in cluster.mishaps.clone() {
            if let Some(at) = time_of(mishap) {
                cluster.schedule(at, Node::Orchestrator(0), Occurrence::Mishap(mishap));
            }
        }
        cluster
    }

    /// Runs until the orchestrator in charge ends the attempt.
    pub(crate) fn run(mut self) -> Outcome {
        while self.ending.is_none() {
            let Some(((at, _), (node, occurrence))) = self.queue.pop_first() else {
                panic!("nothing happens any more")
            };
            self.now = at;
            assert!(at < LIMIT_MS, "stuck after {at} virtual ms: {}", self.describe());
            self.occur(node, occurrence);
        }
        for worker in &mut self.workers {
            if let Some(held) = worker.held.take() {
                self.totals += held.stage.counters();
            }
        }
        let term = ds_episode::fleet::Ledger::term(&self.store).expect("the store cannot fail");
        let in_charge = self.orchestrators.iter().find(|orchestrator| orchestrator.term == term);
        let contents = self.store.0.borrow().contents();
        let journal = self.store.0.borrow().journal.clone();
        Outcome {
            ending: self.ending.expect("the loop ended"),
            contents,
            journal,
            totals: self.totals,
            driver: in_charge.map(|orchestrator| orchestrator.driver.counters()).unwrap_or_default(),
            pushes_delivered: self.pushes_delivered,
            ghosts: self.ghosts,
        }
    }

    fn describe(&self) -> String {
        let now = Millis(self.now);
        let lacking = self.orchestrators.iter().map(|orchestrator| {
            let awaited = orchestrator.driver.awaited(now);
            format!("term {} up {} awaits {awaited:?}", orchestrator.term, orchestrator.up)
        });
        let stages = self.workers.iter().filter_map(|worker| {
            let held = worker.held.as_ref()?;
            Some(format!(
                "{} up {} awaits {:?}",
                worker.instance,
                worker.up,
                held.stage.awaited(worker.clock(self.now))
            ))
        });
        lacking.chain(stages).collect::<Vec<_>>().join("; ")
    }

    pub(crate) fn schedule(&mut self, after: u64, node: Node, occurrence: Occurrence) {
        self.serial += 1;
        self.queue.insert((self.now + after, self.serial), (node, occurrence));
    }

    pub(crate) fn reachable(&self, one: Node, other: Node) -> bool {
        let bit = |node: Node| match node {
            Node::Orchestrator(index) => index % 2,
            Node::Worker(index) => 2 + index,
        };
        let side = |mask: u32, node: Node| mask >> bit(node) & 1;
        !self.partitions.iter().any(|(mask, until)| self.now < *until && side(*mask, one) != side(*mask, other))
    }

    /// Pushes a message to every other process that listens.
    pub(crate) fn push(&mut self, from: Node, message: &Envelope) {
        let workers = (0..self.workers.len()).map(Node::Worker);
        let nodes: Vec<Node> = (0..self.orchestrators.len()).map(Node::Orchestrator).chain(workers).collect();
        for node in nodes {
            let listens = match node {
                Node::Orchestrator(index) => self.orchestrators[index].up,
                Node::Worker(index) => self.workers[index].held.is_some(),
            };
            if node == from || !listens || !self.reachable(from, node) {
                continue;
            }
            if self.dice.chance(self.script.network.ghosts) {
                self.haunt(node, message);
            }
            let copies = if self.dice.chance(self.script.network.duplicate) { 2 } else { 1 };
            for _ in 0..copies {
                if self.dice.chance(self.script.network.drop_pushes) {
                    continue;
                }
                let delay = self.delay();
                self.schedule(delay, node, Occurrence::Push(message.clone()));
            }
        }
    }

    /// Sends what a predecessor might still say to a receiver that knows of its successor.
    fn haunt(&mut self, node: Node, message: &Envelope) {
        let mut ghost = message.clone();
        ghost.header.content = hash("ghost", &[message.header.content], &[]);
        if message.header.slot.topic == Topic::Advance {
            let Node::Worker(index) = node else { return };
            if self.workers[index].held.as_ref().is_none_or(|held| held.known_term < message.header.term) {
                return;
            }
            let Ok(mut order) = self.codec.decode_advance(&message.body) else { return };
            order.border = hash("ghost", &[order.border], &[]);
            ghost.header.content = order.content();
            ghost.header.term = ghost.header.term.saturating_sub(1);
            ghost.body = self.codec.encode_advance(&order);
        } else {
            let Some(role) = due::maker(message.header.slot.topic) else { return };
            let knows = match node {
                Node::Orchestrator(_) => true,
                Node::Worker(index) => {
                    let held = self.workers[index].held.as_ref();
                    held.is_some_and(|held| held.known_epochs.get(&role) >= Some(&message.header.epoch))
                }
            };
            let Some(predecessor) = self.checks.holder(role, message.header.epoch - 1).filter(|_| knows) else {
                return;
            };
            ghost.header.epoch -= 1;
            ghost.header.publisher = predecessor;
        }
        self.ghosts += 1;
        self.schedule(0, node, Occurrence::Push(ghost));
    }

    pub(crate) fn delay(&mut self) -> u64 {
        self.dice.range(0, self.script.network.delay_ms)
    }

    /// Sends part of a pull, unless it is lost on the way.
    pub(crate) fn ask(&mut self, from: Node, to: Node, occurrence: Occurrence) {
        if self.reachable(from, to) && !self.dice.chance(self.script.network.drop_pulls) {
            let delay = self.delay();
            self.schedule(delay, to, occurrence);
        }
    }

    /// Finds who answers a pull; of two orchestrators either may.
    pub(crate) fn answerer(&mut self, from: &PullFrom) -> Option<Node> {
        match from {
            PullFrom::Owner(owner) => {
                let index = self.workers.iter().position(|worker| worker.up && worker.instance == owner.instance)?;
                Some(Node::Worker(index))
            }
            PullFrom::Journal => {
                let up: Vec<usize> =
                    (0..self.orchestrators.len()).filter(|index| self.orchestrators[*index].up).collect();
                if up.is_empty() { None } else { Some(Node::Orchestrator(self.dice.pick(&up))) }
            }
        }
    }

    fn occur(&mut self, node: Node, occurrence: Occurrence) {
        if let Occurrence::Mishap(mishap) = occurrence {
            return self.mishap(mishap);
        }
        match node {
            Node::Worker(index) => {
                let frozen_until = self.workers[index].frozen_until;
                if self.now < frozen_until {
                    return self.schedule(frozen_until - self.now, node, occurrence);
                }
                self.worker_occurrence(index, occurrence);
            }
            Node::Orchestrator(index) => self.orchestrator_occurrence(index, occurrence),
        }
    }

    fn mishap(&mut self, mishap: Mishap) {
        match mishap {
            Mishap::Kill { worker, restart_after, .. } => self.kill(worker, restart_after),
            Mishap::Hang { worker, for_ms, .. } => self.workers[worker].frozen_until = self.now + for_ms,
            Mishap::Partition { mask, for_ms, .. } => self.partitions.push((mask, self.now + for_ms)),
            Mishap::KillOrchestrator { restart_after, .. } => {
                for orchestrator in &mut self.orchestrators {
                    orchestrator.up = false;
                }
                self.schedule(restart_after, Node::Orchestrator(0), Occurrence::Restart);
            }
            Mishap::SecondOrchestrator { deaf, .. } => {
                if let Some(first) = self.orchestrators.last_mut().filter(|orchestrator| orchestrator.up) {
                    first.deaf = deaf;
                    self.start_orchestrator(true);
                }
            }
            Mishap::Drain { worker, restart_after, .. } => self.drain(worker, restart_after),
            Mishap::KillAtWork { .. } | Mishap::HangAtWork { .. } => {}
        }
    }
}

fn time_of(mishap: Mishap) -> Option<u64> {
    match mishap {
        Mishap::Kill { at, .. }
        | Mishap::Hang { at, .. }
        | Mishap::Partition { at, .. }
        | Mishap::KillOrchestrator { at, .. }
        | Mishap::SecondOrchestrator { at, .. }
        | Mishap::Drain { at, .. } => Some(at),
        Mishap::KillAtWork { .. } | Mishap::HangAtWork { .. } => None,
    }
}

/// Names an instance of a worker's life or of an orchestrator's start.
pub(crate) fn instance(kind: &str, index: usize, life: u32) -> InstanceId {
    InstanceId::new(&format!("{kind}-{index}.{life}")).expect("letters, digits, '-' and '.'")
}
