//! Conducts one attempt at an episode: the driver's state machine between bus, fleet, journal and score.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

use ds_bus::{Ask, BusSession, Holder};
use ds_episode::driver::{Action, Attempt, EncodedScene, Ending, Event, Status};
use ds_episode::fleet::Request;
use ds_episode::{Counters, Driver, Fault, Millis, Timing};
use ds_process::clock::millis;
use ds_process::hold::{answer, publish, pull};
use ds_score::DriveScore;
use ds_space::{AttemptId, Digest, EpisodeId, InstanceId, Tick};
use ds_topic::{Envelope, Owner, Plan, Role, SceneMessage, Slot, Topic};
use ds_wire::control as pb;
use ds_wire::{Body, WireCodec};
use tokio::sync::mpsc;
use tokio::task::JoinSet;

use crate::hub::Hub;
use crate::journal::{Journal, JournalError};
use crate::metrics::{Follower, Tally};
use crate::pace::Pace;
use crate::scorer::{Proposals, Scorer};
use crate::storage::Storage;
use crate::submission::{self, Job};

/// How often watchers are told what is awaited, and how late it must be, in milliseconds.
const TELL_EVERY_MS: u64 = 1_000;

/// What all conductors share.
#[derive(Clone)]
pub(crate) struct Stand {
    pub(crate) bus: BusSession,
    pub(crate) hub: Arc<Hub>,
    pub(crate) instance: InstanceId,
    pub(crate) term: u64,
    pub(crate) timing: Timing,
    pub(crate) folder: std::path::PathBuf,
    pub(crate) storage: Storage,
    pub(crate) tally: Tally,
}

/// What became of an attempt.
#[derive(Debug, Clone)]
pub(crate) struct Outcome {
    pub(crate) ending: Ending,
    pub(crate) ticks: u32,
    pub(crate) scores: (DriveScore, Proposals),
    pub(crate) digests: [Digest; 3],
    pub(crate) recording: std::path::PathBuf,
    pub(crate) wall: Duration,
    pub(crate) work_secs: [f64; 4],
    pub(crate) journal_secs: f64,
    pub(crate) overhead_micros: Vec<u32>,
    pub(crate) counts: Counters,
    /// How the plans came about, in wall-clock mode.
    pub(crate) wall_clock: Option<pb::WallClock>,
}

/// What a watcher may know of a drive under way.
#[derive(Debug, Clone, Default)]
pub(crate) struct Progress {
    /// Ticks committed, where that changed.
    pub(crate) ticks: Option<u32>,
    /// What is awaited, from whom, since when; empty if nothing is.
    pub(crate) awaits: String,
}

/// An attempt that could not begin or go on.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ConductError {
    #[error(transparent)]
    Submission(#[from] submission::SubmissionError),
    #[error(transparent)]
    Journal(#[from] JournalError),
    #[error("scene cannot be read")]
    Scene(#[from] ds_episode::CodecError),
    #[error("journal cannot be gone on from")]
    Resume(#[from] ds_episode::driver::ResumeError),
    #[error("bus")]
    Bus(#[from] ds_bus::BusError),
    #[error("a background task panicked")]
    Task(#[from] tokio::task::JoinError),
}

/// Drives an episode to its end.
pub(crate) async fn conduct(
    stand: &Stand,
    job: &Job,
    attempt: AttemptId,
    progress: mpsc::Sender<Progress>,
    mut cancel: tokio::sync::watch::Receiver<bool>,
) -> Result<Outcome, ConductError> {
    let began = Instant::now();
    let (message, encoded) = prepare(job.clone()).await?;
    let episode = job.spec.episode.clone();
    let named = Attempt { episode: episode.clone(), attempt, instance: stand.instance.clone(), term: stand.term };
    let (driver, journal, scorer) = open(stand, named, encoded, &message).await?;
    let due = |topic: &Topic| ds_episode::due::maker(*topic).is_some() || *topic == Topic::Diagnosis;
    let topics: Vec<Topic> = Topic::ALL.into_iter().filter(due).collect();
    let mut pushes = stand.bus.subscribe(&episode, &topics).await?;
    let mut questions = stand.bus.serve_pulls(&Holder::Journal, &episode).await?;
    let (news, mut told) = mpsc::channel(1_024);
    stand.hub.drive(&episode, news.clone());
    let mut beat = tokio::time::interval(Duration::from_millis((stand.timing.pull_after_ms / 2).max(5)));
    let mut conductor = Conductor {
        follower: stand.tally.follow(),
        stand: stand.clone(),
        episode: episode.clone(),
        attempt,
        driver,
        journal,
        scorer,
        news,
        tasks: JoinSet::new(),
        questions: BTreeMap::new(),
        next_query: 0,
        journal_time: Duration::ZERO,
        pace: Pace::default(),
        told: None,
    };
    let mut next = Some(Event::Start);
    let ending = loop {
        let event = match next.take() {
            Some(event) => event,
            None => tokio::select! {
                envelope = pushes.recv() => conductor.heard(envelope),
                question = questions.recv() => conductor.asked(question),
                Some(event) = told.recv() => event,
                _ = beat.tick() => Event::Now,
                changed = cancel.changed() => {
                    if changed.is_err() || *cancel.borrow() { Event::Cancel } else { Event::Now }
                }
            },
        };
        if let Some(ending) = conductor.handle(event, &progress).await? {
            break ending;
        }
        conductor.tell_awaited(&progress);
    };
    conductor.finish(ending, began).await
}

async fn prepare(job: Job) -> Result<(SceneMessage, EncodedScene), ConductError> {
    let made = tokio::task::spawn_blocking(move || {
        let message = submission::scene(&job)?;
        let encoded = EncodedScene { content: message.content(), body: message.to_bytes() };
        Ok::<_, submission::SubmissionError>((message, encoded))
    });
    Ok(made.await??)
}

async fn open(
    stand: &Stand,
    attempt: Attempt,
    encoded: EncodedScene,
    message: &SceneMessage,
) -> Result<(Driver, Journal, Scorer), ConductError> {
    let path = stand.folder.join("recordings").join(format!("{}.a{}.mcap", attempt.episode, attempt.attempt));
    let scorer = Scorer::new(message);
    let codec = Arc::new(WireCodec);
    if let Some(resumed) = Journal::resume(&path, encoded.content, message.spec.layout_memory_ticks).await? {
        let journal = ds_episode::driver::Journal { iterations: resumed.iterations, messages: &resumed.messages };
        let driver = Driver::resume(attempt, stand.timing, codec, encoded, &journal)?;
        tracing::info!(iterations = resumed.iterations, "an interrupted attempt goes on");
        return Ok((driver, resumed.journal, scorer));
    }
    let driver = Driver::new(attempt, stand.timing, codec, encoded)?;
    let journal = Journal::create(&path, driver.scene().clone(), message.spec.layout_memory_ticks).await?;
    Ok((driver, journal, scorer))
}

struct Conductor {
    follower: Follower,
    stand: Stand,
    episode: EpisodeId,
    attempt: AttemptId,
    driver: Driver,
    journal: Journal,
    scorer: Scorer,
    news: mpsc::Sender<Event>,
    tasks: JoinSet<()>,
    questions: BTreeMap<u64, Ask>,
    next_query: u64,
    journal_time: Duration,
    pace: Pace,
    /// When the watchers were last told what is awaited.
    told: Option<Millis>,
}

impl Conductor {
    fn asked(&mut self, question: Ask) -> Event {
        self.next_query += 1;
        let slot = question.slot;
        self.questions.insert(self.next_query, question);
        Event::Asked { query: self.next_query, slot }
    }

    /// Tells what belongs to the drive from what is said beside it.
    fn heard(&mut self, envelope: Envelope) -> Event {
        let header = &envelope.header;
        if header.slot.topic != Topic::Diagnosis {
            return Event::Message(envelope);
        }
        let last = self.driver.outline().spec.last_tick;
        if header.attempt == self.attempt && header.term <= self.stand.term && header.tick <= last {
            self.journal.hear(envelope);
        }
        Event::Now
    }

    async fn handle(
        &mut self,
        event: Event,
        progress: &mpsc::Sender<Progress>,
    ) -> Result<Option<Ending>, ConductError> {
        while self.tasks.try_join_next().is_some() {}
        let mut events = VecDeque::from([event]);
        while let Some(event) = events.pop_front() {
            let mut wanted = Vec::new();
            let actions = self.driver.handle(Millis(millis()), event);
            self.follower.look(&self.driver);
            for action in actions {
                match action {
                    Action::Finish(ending) => return Ok(Some(ending)),
                    Action::StepDown { term } => return Ok(Some(stepped_down(term, &self.driver))),
                    Action::Want { role, exclude } => wanted.push((role, exclude)),
                    action => events.extend(self.carry_out(action, progress).await?),
                }
            }
            events.extend(self.want(wanted));
        }
        Ok(None)
    }

    async fn carry_out(
        &mut self,
        action: Action,
        progress: &mpsc::Sender<Progress>,
    ) -> Result<Option<Event>, ConductError> {
        match action {
            Action::Publish(envelope) => {
                publish(&self.stand.bus, &envelope).await;
                if envelope.header.slot.topic == Topic::Advance {
                    self.follower.ordered();
                }
                if matches!(envelope.header.slot.topic, Topic::Event | Topic::Score) {
                    self.journal.note(envelope);
                }
            }
            Action::Pull { slot, owner } => self.pull(slot, owner),
            Action::Answer { query, reply } => self.answer(query, reply).await,
            Action::Lookup { query, slot } => {
                let reply = self.journal.lookup(slot);
                self.answer(query, reply).await;
            }
            Action::Commit { iteration, messages } => {
                let began = Instant::now();
                self.note_answers(&messages);
                self.journal.commit(iteration, messages).await?;
                let took = began.elapsed();
                self.journal_time += took;
                let work = self.stand.hub.work_secs(&self.episode);
                let [_, _, video_secs, _] = work;
                self.pace.committed(Instant::now(), video_secs);
                let (first, Tick(ticks)) = self.driver.outline().spec.ticks_of(iteration);
                let driven = if iteration == 0 { 0 } else { ticks + 1 - first.0 };
                self.follower.committed(driven, took.as_secs_f64(), work.iter().sum());
                let _full = progress.try_send(Progress { ticks: Some(ticks), awaits: String::new() });
                return Ok(Some(Event::Journalled { iteration }));
            }
            Action::Dismiss { role, owner, fault } => {
                tracing::warn!(episode = %self.episode, %role, instance = %owner.instance, %fault, "dismissed");
                if let Err(error) = self.stand.hub.dismiss(&self.episode, role, &owner) {
                    tracing::error!(%error, "dismissal cannot be recorded");
                }
            }
            Action::Observe(envelope) => return Ok(self.observe(&envelope)),
            Action::Want { .. } | Action::Finish(_) | Action::StepDown { .. } => {}
        }
        Ok(None)
    }

    /// Counts plans for which no answer came in time.
    fn note_answers(&self, messages: &[Envelope]) {
        if self.driver.outline().spec.wall_clock {
            self.follower.late(kept_time(messages.iter()).late);
        }
    }

    /// Tells the watchers now and then what a slow iteration waits for.
    fn tell_awaited(&mut self, progress: &mpsc::Sender<Progress>) {
        let now = Millis(millis());
        if self.told.is_some_and(|told| now.since(told) < TELL_EVERY_MS) {
            return;
        }
        self.told = Some(now);
        let awaits = awaits(&self.driver, now);
        if !awaits.is_empty() {
            let _full = progress.try_send(Progress { ticks: None, awaits });
        }
    }

    async fn answer(&mut self, query: u64, reply: Option<Envelope>) {
        if let Some(question) = self.questions.remove(&query) {
            answer(question, reply.as_ref()).await;
        }
    }

    fn observe(&mut self, envelope: &Envelope) -> Option<Event> {
        match self.scorer.observe(envelope) {
            Ok((tick, score)) => Some(Event::Scored { tick, content: score.content(), body: score.to_bytes() }),
            Err(error) => {
                tracing::error!(episode = %self.episode, %error, "state cannot be scored");
                None
            }
        }
    }

    /// Asks the fleet for holders of all wanted roles at once.
    fn want(&self, wanted: Vec<(Role, Option<InstanceId>)>) -> Vec<Event> {
        if wanted.is_empty() {
            return Vec::new();
        }
        let roles: Vec<Role> = wanted.iter().map(|(role, _)| *role).collect();
        let (episode, attempt) = (&self.episode, self.attempt);
        let request = |(role, exclude)| Request { episode: episode.clone(), attempt, role, exclude };
        let unassignable = |role, why: &dyn std::fmt::Display| Event::Unassignable {
            role,
            fault: Fault::infrastructure("unassignable", why),
        };
        let answers = match self.stand.hub.assign(wanted.into_iter().map(request).collect()) {
            Ok(answers) => answers,
            Err(error) => return roles.into_iter().map(|role| unassignable(role, &error)).collect(),
        };
        let told = roles.into_iter().zip(answers).filter_map(|(role, answer)| match answer {
            Ok(granted) => Some(Event::Assigned { role, owner: granted.owner }),
            Err(error) if error.lasting() => Some(unassignable(role, &error)),
            Err(error) => {
                tracing::debug!(%episode, %error, "not yet");
                None
            }
        });
        told.collect()
    }

    fn pull(&mut self, slot: Slot, owner: Owner) {
        let (bus, episode, news) = (self.stand.bus.clone(), self.episode.clone(), self.news.clone());
        let limit = Duration::from_millis(self.stand.timing.pull_after_ms.max(100) * 5);
        self.tasks.spawn(async move {
            let reply = pull(&bus, &episode, &Holder::Instance(owner.instance), slot, limit).await;
            if news.send(Event::Pulled { slot, reply }).await.is_err() {
                tracing::trace!(%slot, "the attempt ended before its pull");
            }
        });
    }

    async fn finish(mut self, ending: Ending, began: Instant) -> Result<Outcome, ConductError> {
        self.follower.ended(&ending);
        let work_secs = self.stand.hub.work_secs(&self.episode);
        if let Err(error) = self.stand.hub.finish(&self.episode) {
            tracing::error!(%error, "leases cannot be ended");
        }
        self.stand.hub.forget(&self.episode);
        self.tasks.shutdown().await;
        let closing = Instant::now();
        let ticks = match ending.committed {
            0 => 0,
            committed => self.driver.outline().spec.ticks_of(committed - 1).1.0,
        };
        let by_the_clock = self.driver.outline().spec.wall_clock;
        let wall_clock = by_the_clock.then(|| kept_time(self.journal.plans()));
        let finished = self.journal.finish(&ending).await?;
        self.journal_time += closing.elapsed();
        Ok(Outcome {
            ending,
            ticks,
            scores: self.scorer.finish(),
            digests: finished.digests,
            recording: finished.path,
            wall: began.elapsed(),
            work_secs,
            journal_secs: self.journal_time.as_secs_f64(),
            overhead_micros: self.pace.overhead_micros,
            counts: self.driver.counters(),
            wall_clock,
        })
    }
}

/// Sums up how plans of wall-clock mode came about.
fn kept_time<'a>(messages: impl Iterator<Item = &'a Envelope>) -> pb::WallClock {
    let mut kept = pb::WallClock::default();
    for envelope in messages.filter(|envelope| envelope.header.slot.topic == Topic::Plan) {
        let Some(answered) = Plan::from_bytes(&envelope.body).ok().and_then(|plan| plan.answered) else { continue };
        kept.plans += 1;
        kept.late += u32::from(answered.iterations_late > 0);
        kept.latency_secs.extend(answered.latency_nanos.iter().map(|nanos| *nanos as f64 * 1e-9));
    }
    kept
}

/// Says in words which messages or holders an iteration has lacked for some time, from whom, since when.
fn awaits(driver: &Driver, now: Millis) -> String {
    let named = |owner: Option<Owner>| owner.map_or("nobody".to_owned(), |owner| owner.instance.to_string());
    let late = |for_ms: &u64| *for_ms >= TELL_EVERY_MS;
    let vacant = driver.vacant(now).into_iter().filter(|(_, _, for_ms)| late(for_ms)).map(|(role, owner, for_ms)| {
        let state = if owner.is_some() { "to be ready" } else { "to be there" };
        format!("{role} ({}) {state}, for {:.1} s", named(owner), for_ms as f64 / 1e3)
    });
    let lacking = driver.awaited(now).into_iter().filter(|awaited| late(&awaited.for_ms)).map(|awaited| {
        format!("{} from {}, for {:.1} s", awaited.slot, named(awaited.owner), awaited.for_ms as f64 / 1e3)
    });
    let all: Vec<String> = vacant.chain(lacking).collect();
    match all.len() {
        0..=4 => all.join("; "),
        more => format!("{}; and {} more", all[..4].join("; "), more - 4),
    }
}

fn stepped_down(term: u64, driver: &Driver) -> Ending {
    Ending {
        status: Status::Aborted,
        reason: format!("fenced: term {term} is in charge"),
        class: None,
        committed: driver.committed_iterations(),
    }
}
