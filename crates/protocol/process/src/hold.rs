//! Holds one role of one episode: the stage's state machine between bus, control plane and maker.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use ds_bus::{Ask, BusSession, Holder as PullHolder, topics_of};
use ds_episode::stage::{Action, Assignment, Event, PullFrom, StopReason};
use ds_episode::{Codec, Fault, Millis, Stage, Timing, due};
use ds_space::EpisodeId;
use ds_topic::{Envelope, Slot, Topic};
use tokio::sync::mpsc;
use tokio::task::JoinSet;

use crate::clock::millis;
use crate::maker::MakerFactory;
use crate::tally::{Follower, Tally};
use crate::workbench::{self, Job};

/// What an instance brings to every role that it holds.
#[derive(Clone)]
pub(crate) struct Tools {
    /// The data plane.
    pub(crate) bus: BusSession,
    /// Opens makers.
    pub(crate) factory: Arc<dyn MakerFactory>,
    /// Reads orders.
    pub(crate) codec: Arc<dyn Codec>,
    /// Delays.
    pub(crate) timing: Timing,
    /// What all holders count.
    pub(crate) tally: Tally,
}

/// What a holder tells the fleet.
pub(crate) enum Report {
    /// Orders may come.
    Ready {
        /// The episode.
        episode: EpisodeId,
        /// The epoch of the assignment.
        epoch: u64,
    },
    /// Something went wrong.
    Fault {
        /// The episode.
        episode: EpisodeId,
        /// The epoch of the assignment.
        epoch: u64,
        /// What.
        fault: Fault,
    },
    /// The maker worked.
    Worked {
        /// The episode.
        episode: EpisodeId,
        /// For how long.
        micros: u64,
    },
}

/// Holds a role until the stage stops or `orders` closes (a release).
///
/// # Errors
/// If the bus refuses a subscription.
pub(crate) async fn hold(
    tools: Tools,
    assignment: Assignment,
    mut orders: mpsc::Receiver<Event>,
    reports: mpsc::Sender<Report>,
) -> Result<(), ds_bus::BusError> {
    let episode = assignment.episode.clone();
    // What the role does not take in this episode, the stage ignores.
    let topics = topics_of(assignment.role);
    let made = |topic: &Topic| matches!(topic, Topic::Scene | Topic::Advance) || due::maker(*topic).is_some();
    debug_assert!(topics.iter().all(made), "inputs are made by roles");
    let mut pushes = tools.bus.subscribe(&episode, topics).await?;
    let own = PullHolder::Instance(assignment.owner.instance.clone());
    let mut questions = tools.bus.serve_pulls(&own, &episode).await?;
    let (done_sender, mut done) = mpsc::channel(4);
    let jobs = workbench::start(Arc::clone(&tools.factory), done_sender);
    let (pulled_sender, mut pulled) = mpsc::channel(256);
    let mut beat = tokio::time::interval(Duration::from_millis((tools.timing.pull_after_ms / 2).max(5)));
    let epoch = assignment.owner.epoch;
    let stage = Stage::new(assignment, tools.timing, Arc::clone(&tools.codec), Millis(millis()));
    let mut holder = Holder {
        follower: tools.tally.follow(),
        tools,
        episode,
        epoch,
        stage,
        jobs,
        reports,
        pulled: pulled_sender,
        pulls: JoinSet::new(),
        questions: BTreeMap::new(),
        next_query: 0,
    };
    loop {
        let event = tokio::select! {
            envelope = pushes.recv() => Event::Message(envelope),
            question = questions.recv() => holder.asked(question),
            Some(event) = pulled.recv() => event,
            Some(done) = done.recv() => {
                holder.follower.done(&done);
                holder.report(Report::Worked { episode: holder.episode.clone(), micros: done.micros }).await;
                done.event
            }
            order = orders.recv() => match order {
                Some(event) => event,
                None => return Ok(()),
            },
            _ = beat.tick() => Event::Now,
        };
        if holder.handle(event).await.is_some() {
            return Ok(());
        }
    }
}

struct Holder {
    follower: Follower,
    tools: Tools,
    episode: EpisodeId,
    epoch: u64,
    stage: Stage,
    jobs: std::sync::mpsc::SyncSender<Job>,
    reports: mpsc::Sender<Report>,
    pulled: mpsc::Sender<Event>,
    pulls: JoinSet<()>,
    questions: BTreeMap<u64, Ask>,
    next_query: u64,
}

impl Holder {
    fn asked(&mut self, question: Ask) -> Event {
        self.next_query += 1;
        let slot = question.slot;
        self.questions.insert(self.next_query, question);
        Event::Asked { query: self.next_query, slot }
    }

    async fn report(&self, report: Report) {
        if self.reports.send(report).await.is_err() {
            tracing::debug!(episode = %self.episode, "the fleet is gone");
        }
    }

    async fn handle(&mut self, event: Event) -> Option<StopReason> {
        while self.pulls.try_join_next().is_some() {}
        let actions = self.stage.handle(Millis(millis()), event);
        self.follower.look(&self.stage);
        for action in actions {
            if let Action::Stop(reason) = action {
                tracing::debug!(episode = %self.episode, ?reason, "role ended");
                return Some(reason);
            }
            self.carry_out(action).await;
        }
        None
    }

    async fn carry_out(&mut self, action: Action) {
        match action {
            Action::Publish(envelope) => publish(&self.tools.bus, &envelope).await,
            Action::Pull { slot, from } => self.pull(slot, from),
            Action::Answer { query, reply } => {
                if let Some(question) = self.questions.remove(&query) {
                    answer(question, reply.as_ref()).await;
                }
            }
            Action::Restore { scene, inputs, advance } => self.job(Job::Restore { scene, inputs, advance }),
            Action::Work { advance, inputs } => self.job(Job::Work { inputs, advance }),
            Action::Ready { epoch } => self.report(Report::Ready { episode: self.episode.clone(), epoch }).await,
            Action::Report(fault) => {
                tracing::warn!(episode = %self.episode, %fault, "fault");
                self.report(Report::Fault { episode: self.episode.clone(), epoch: self.epoch, fault }).await;
            }
            Action::Stop(_) => {}
        }
    }

    fn job(&self, job: Job) {
        if self.jobs.try_send(job).is_err() {
            tracing::error!(episode = %self.episode, "the maker's thread is gone");
        }
    }

    fn pull(&mut self, slot: Slot, from: PullFrom) {
        let (bus, episode, pulled) = (self.tools.bus.clone(), self.episode.clone(), self.pulled.clone());
        let limit = Duration::from_millis(self.tools.timing.pull_after_ms.max(100) * 5);
        self.pulls.spawn(async move {
            let asked = match &from {
                PullFrom::Owner(owner) => PullHolder::Instance(owner.instance.clone()),
                PullFrom::Journal => PullHolder::Journal,
            };
            let reply = pull(&bus, &episode, &asked, slot, limit).await;
            if pulled.send(Event::Pulled { slot, from, reply }).await.is_err() {
                tracing::trace!(%slot, "the role ended before its pull");
            }
        });
    }
}

/// Asks for a message; a failed pull is only logged, the machine asks again.
pub async fn pull(
    bus: &BusSession,
    episode: &EpisodeId,
    from: &PullHolder,
    slot: Slot,
    limit: Duration,
) -> Option<Envelope> {
    bus.pull(episode, from, slot, limit).await.unwrap_or_else(|error| {
        tracing::debug!(%slot, %error, "pull failed");
        None
    })
}

/// Answers a question; a failed answer is only logged, the asker asks again.
pub async fn answer(question: Ask, reply: Option<&Envelope>) {
    if let Err(error) = question.answer(reply).await {
        tracing::debug!(%error, "answer failed");
    }
}

/// Pushes a message; a failed push is only logged, the receivers pull.
pub async fn publish(bus: &BusSession, envelope: &Envelope) {
    if let Err(error) = bus.publish(envelope).await {
        tracing::debug!(slot = %envelope.header.slot, %error, "push failed");
    }
}
