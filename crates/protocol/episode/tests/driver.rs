//! A driver told one thing at a time: seats, orders, commits, divergence, faults, resume.

use std::sync::Arc;

use crate::faultsim::toy::{LATE, SCENE, ToyCodec, hash};
use bytes::Bytes;
use ds_episode::driver::{Action, Attempt, Driver, EncodedScene, Ending, Event, Journal, ResumeError, Status};
use ds_episode::{Codec, Fault, FaultClass, Millis, Outline, Timing, due};
use ds_space::{AttemptId, Digest, EpisodeId, InstanceId, SimTime, Tick};
use ds_topic::{Advance, Envelope, EpisodeSpec, Header, Motion, Owner, Role, SCHEMA_VERSION, Slot, Topic};

fn id(text: &str) -> InstanceId {
    InstanceId::new(text).expect("a valid id")
}

fn outline() -> Outline {
    let spec = EpisodeSpec {
        policy: "toy".to_owned(),
        replan_period: 2,
        horizon: 8,
        warm_up: 1,
        ..EpisodeSpec::replay(EpisodeId::new("e").expect("a valid id"), "toy", Tick(5))
    };
    Outline { spec, cameras: 1, dt: SimTime(100_000_000) }
}

fn attempt(term: u64) -> Attempt {
    let episode = outline().spec.episode;
    Attempt { episode, attempt: AttemptId(1), instance: id("orchestrator"), term }
}

fn scene() -> EncodedScene {
    EncodedScene { content: hash("scene", &[], &[]), body: Bytes::from_static(SCENE) }
}

/// A driver under test and the hand that feeds it.
struct Bench {
    driver: Driver,
    codec: Arc<ToyCodec>,
    journal: Vec<Envelope>,
}

impl Bench {
    fn new() -> Self {
        Self::of(outline())
    }

    fn of(outline: Outline) -> Self {
        let codec = Arc::new(ToyCodec::new(outline));
        let driver = Driver::new(attempt(3), Timing::default(), codec.clone(), scene()).expect("the scene is readable");
        Self { driver, codec, journal: Vec::new() }
    }

    fn tell(&mut self, event: Event) -> Vec<Action> {
        self.driver.handle(Millis(10), event)
    }

    /// Seats all roles in an epoch; returns what the last one's readiness brought.
    fn seat(&mut self, epoch: u64) -> Vec<Action> {
        self.tell(Event::Start);
        let mut actions = Vec::new();
        for role in Role::ALL {
            self.tell(Event::Assigned { role, owner: Owner { instance: id(role.name()), epoch } });
            actions = self.tell(Event::ReadyBy { role, epoch });
        }
        actions
    }

    fn message(&self, slot: Slot, epoch: u64, content: Digest) -> Envelope {
        let header = Header {
            episode: outline().spec.episode,
            attempt: AttemptId(1),
            term: 3,
            epoch,
            iteration: 0,
            tick: Tick(slot.index),
            time: SimTime(0),
            sequence: 0,
            publisher: id(due::maker(slot.topic).expect("an output has a maker").name()),
            schema_version: SCHEMA_VERSION,
            trace: String::new(),
            slot,
            content,
        };
        Envelope { header, body: Bytes::copy_from_slice(&content.0) }
    }

    /// Sends everything that an iteration makes due; returns what the last message brought.
    fn complete(&mut self, iteration: u32) -> Vec<Action> {
        let mut actions = Vec::new();
        for slot in due::all_outputs(&outline(), &shape(iteration)) {
            let content = hash(slot.topic.name(), &[], &[slot.index]);
            actions = self.tell(Event::Message(self.message(slot, 1, content)));
        }
        if let Some(Action::Commit { messages, .. }) = actions.first() {
            self.journal.extend(messages.clone());
        }
        actions
    }

    fn order(&self, actions: &[Action]) -> Option<Advance> {
        actions.iter().find_map(|action| match action {
            Action::Publish(message) if message.header.slot.topic == Topic::Advance => {
                Some(self.codec.decode_advance(&message.body).expect("its own order is readable"))
            }
            _ => None,
        })
    }
}

/// What decides which messages an iteration makes due.
fn shape(iteration: u32) -> Advance {
    let (first, last) = outline().spec.ticks_of(iteration);
    let plan_due = due::plan_due(&outline().spec, iteration);
    Advance {
        iteration,
        first,
        last,
        motion: Motion::Initial,
        border: Digest::default(),
        plan_due,
        owners: std::collections::BTreeMap::new(),
    }
}

fn ending(actions: &[Action]) -> Option<&Ending> {
    actions.iter().find_map(|action| match action {
        Action::Finish(ending) => Some(ending),
        _ => None,
    })
}

fn ends(actions: &[Action], status: Status, name: &str) {
    let ending = ending(actions).unwrap_or_else(|| panic!("no end in {actions:?}"));
    assert!(ending.status == status && ending.reason.starts_with(name), "{ending:?}");
}

#[test]
fn orders_start_when_all_are_ready_and_wait_for_the_journal() {
    let mut bench = Bench::new();
    let actions = bench.seat(1);
    let order = bench.order(&actions).expect("all roles are ready");
    assert_eq!((order.iteration, order.motion, order.border), (0, Motion::Initial, Digest::default()));
    assert_eq!(order.owners.len(), 4);

    let actions = bench.complete(0);
    assert!(matches!(&actions[..], [Action::Commit { iteration: 0, messages }]
        if messages[0].header.slot.topic == Topic::Scene && messages[1].header.slot.topic == Topic::Advance));
    assert!(bench.order(&actions).is_none(), "the next order waits for the journal");
    let actions = bench.tell(Event::Journalled { iteration: 0 });
    assert!(matches!(&actions[0], Action::Observe(world) if world.header.slot == Slot::new(Topic::World, 0)));
    let order = bench.order(&actions).expect("the journal holds iteration 0");
    assert_eq!((order.iteration, order.motion, order.border), (1, Motion::Log, hash("world", &[], &[0])));
}

#[test]
fn the_accepted_plan_moves_the_next_iteration_and_the_last_completes() {
    let mut bench = Bench::new();
    bench.seat(1);
    let mut actions = Vec::new();
    for iteration in 0..outline().spec.iterations() {
        bench.complete(iteration);
        actions = bench.tell(Event::Journalled { iteration });
        if let Some(order) = bench.order(&actions) {
            assert_eq!(matches!(order.motion, Motion::Plan(_)), order.iteration >= 2, "{order:?}");
        }
    }
    ends(&actions, Status::Completed, "");
    assert_eq!(bench.driver.committed_iterations(), 4);
    let slot = Slot::new(Topic::World, 0);
    assert_eq!(bench.tell(Event::Asked { query: 7, slot }), [Action::Lookup { query: 7, slot }]);
}

#[test]
fn refuses_other_epochs_and_ends_on_divergence() {
    let mut bench = Bench::new();
    bench.seat(2);
    let slot = Slot::new(Topic::World, 0);
    bench.tell(Event::Message(bench.message(slot, 1, hash("old", &[], &[]))));
    assert_eq!(bench.driver.counters().refused_epochs, 1);
    bench.tell(Event::Message(bench.message(slot, 2, hash("one", &[], &[]))));
    bench.tell(Event::Message(bench.message(slot, 2, hash("one", &[], &[]))));
    assert_eq!(bench.driver.counters().duplicates, 1);
    let actions = bench.tell(Event::Message(bench.message(slot, 2, hash("other", &[], &[]))));
    ends(&actions, Status::Failed, Fault::DIVERGENT_DUPLICATE);
}

#[test]
fn a_successors_other_plan_is_counted_and_changes_nothing() {
    let mut bench = Bench::new();
    bench.seat(1);
    bench.complete(0);
    bench.tell(Event::Journalled { iteration: 0 });
    let slot = Slot::new(Topic::Plan, 1);
    bench.tell(Event::Message(bench.message(slot, 1, hash("first", &[], &[]))));
    bench.tell(Event::Lost { role: Role::Policy, epoch: 1, reason: "died".to_owned() });
    bench.tell(Event::Assigned { role: Role::Policy, owner: Owner { instance: id("policy"), epoch: 2 } });
    bench.tell(Event::ReadyBy { role: Role::Policy, epoch: 2 });
    let actions = bench.tell(Event::Message(bench.message(slot, 2, hash("second", &[], &[]))));
    assert!(ending(&actions).is_none(), "{actions:?}");
    assert_eq!(bench.driver.counters().superseded_plans, 1);
}

#[test]
fn an_unreadable_plan_ends_the_episode_by_rule() {
    let mut bench = Bench::new();
    bench.seat(1);
    bench.complete(0);
    bench.tell(Event::Journalled { iteration: 0 });
    let mut plan = bench.message(Slot::new(Topic::Plan, 1), 1, hash("plan", &[], &[]));
    plan.body = Bytes::from_static(b"NaN");
    let actions = bench.tell(Event::Message(plan));
    ends(&actions, Status::Failed, Fault::PLAN_REFUSED);
    assert_eq!(ending(&actions).and_then(|ending| ending.class), Some(FaultClass::Policy));
}

#[test]
fn a_plan_that_tells_of_the_wall_clock_is_of_wall_clock_mode() {
    for by_the_clock in [false, true] {
        let mut outline = outline();
        outline.spec.wall_clock = by_the_clock;
        let mut bench = Bench::of(outline);
        bench.seat(1);
        bench.complete(0);
        bench.tell(Event::Journalled { iteration: 0 });
        let mut plan = bench.message(Slot::new(Topic::Plan, 1), 1, hash("plan", &[], &[]));
        plan.body = [&plan.body[..], LATE].concat().into();
        let actions = bench.tell(Event::Message(plan));
        match by_the_clock {
            true => assert!(ending(&actions).is_none(), "{actions:?}"),
            false => ends(&actions, Status::Failed, Fault::BAD_MESSAGE),
        }
    }
}

#[test]
fn faults_follow_their_class() {
    let cases = [
        (Fault::deterministic(Fault::CONFLICTING_ADVANCE, "advance[1]"), Some(Status::Failed)),
        (Fault::policy("policy_deadline", "5 s"), Some(Status::Failed)),
        (Fault::infrastructure("out_of_memory", "3 GB"), None),
    ];
    for (fault, expected) in cases {
        let mut bench = Bench::new();
        bench.seat(1);
        let stale = Event::Faulted { role: Role::Video, epoch: 0, fault: fault.clone() };
        assert!(bench.tell(stale).is_empty(), "a fault of an earlier epoch");
        let actions = bench.tell(Event::Faulted { role: Role::Video, epoch: 1, fault: fault.clone() });
        assert_eq!(ending(&actions).map(|ending| ending.status), expected);
        if expected.is_none() {
            let owner = Owner { instance: id("video"), epoch: 1 };
            assert!(actions.contains(&Action::Dismiss { role: Role::Video, owner, fault }));
            assert!(actions.contains(&Action::Want { role: Role::Video, exclude: Some(id("video")) }));
        }
    }
}

#[test]
fn a_replacement_gets_the_same_order_with_its_epoch() {
    let mut bench = Bench::new();
    let first = bench.seat(1);
    let first = bench.order(&first).expect("all roles are ready");
    let actions = bench.tell(Event::Lost { role: Role::Video, epoch: 1, reason: "died".to_owned() });
    assert!(actions.contains(&Action::Want { role: Role::Video, exclude: None }), "{actions:?}");
    bench.tell(Event::Assigned { role: Role::Video, owner: Owner { instance: id("video-2"), epoch: 2 } });
    let actions = bench.tell(Event::ReadyBy { role: Role::Video, epoch: 2 });
    let again = bench.order(&actions).expect("all roles are ready again");
    assert_eq!(again.content(), first.content());
    assert_eq!(again.owners[&Role::Video], Owner { instance: id("video-2"), epoch: 2 });
}

#[test]
fn deadlines_name_what_is_awaited() {
    let mut bench = Bench::new();
    bench.seat(1);
    let actions = bench.driver.handle(Millis(400_000), Event::Now);
    ends(&actions, Status::Aborted, "iteration_deadline: advance[0] awaits 4 messages, first world[0]");

    let mut bench = Bench::new();
    bench.tell(Event::Start);
    let actions = bench.driver.handle(Millis(200_000), Event::Now);
    ends(&actions, Status::Aborted, "no_instance: sim has no ready holder");

    let mut bench = Bench::new();
    bench.seat(1);
    ends(&bench.tell(Event::Cancel), Status::Aborted, "cancelled");
}

#[test]
fn steps_down_before_a_higher_term() {
    let mut bench = Bench::new();
    bench.seat(1);
    let mut message = bench.message(Slot::new(Topic::World, 0), 2, hash("w", &[], &[]));
    message.header.term = 4;
    assert_eq!(bench.tell(Event::Message(message)), [Action::StepDown { term: 4 }]);
    assert!(bench.tell(Event::Now).is_empty());
    let slot = Slot::new(Topic::Scene, 0);
    assert_eq!(bench.tell(Event::Asked { query: 1, slot }), [Action::Answer { query: 1, reply: None }]);
}

#[test]
fn resumes_after_the_last_commit_with_its_plan_and_border() {
    let mut bench = Bench::new();
    bench.seat(1);
    for iteration in 0..2 {
        bench.complete(iteration);
        bench.tell(Event::Journalled { iteration });
    }
    let journal = Journal { iterations: 2, messages: &bench.journal };
    let driver = Driver::resume(attempt(4), Timing::default(), bench.codec.clone(), scene(), &journal);
    let mut resumed =
        Bench { driver: driver.expect("the journal is whole"), codec: bench.codec.clone(), journal: Vec::new() };
    let observed = resumed.tell(Event::Start).iter().filter(|action| matches!(action, Action::Observe(_))).count();
    assert_eq!(observed, 3, "ticks 0 to 2 are scored again");
    let actions = resumed.seat(2);
    let order = resumed.order(&actions).expect("all roles are ready");
    assert_eq!((order.iteration, order.border), (2, hash("world", &[], &[2])));
    assert!(matches!(order.motion, Motion::Plan(_)));

    let lacking: Vec<Envelope> =
        bench.journal.iter().filter(|message| message.header.slot != Slot::new(Topic::Ego, 1)).cloned().collect();
    let journal = Journal { iterations: 2, messages: &lacking };
    let error = Driver::resume(attempt(4), Timing::default(), bench.codec.clone(), scene(), &journal).err();
    assert_eq!(error, Some(ResumeError::Missing { iteration: 1, slot: Slot::new(Topic::Ego, 1) }));
    let journal = Journal { iterations: 9, messages: &[] };
    let error = Driver::resume(attempt(4), Timing::default(), bench.codec.clone(), scene(), &journal).err();
    assert_eq!(error, Some(ResumeError::TooMany { committed: 9, iterations: 4 }));
}

#[test]
fn a_scene_that_cannot_be_read_is_refused() {
    let codec = Arc::new(ToyCodec::new(outline()));
    let scene = EncodedScene { content: Digest::default(), body: Bytes::from_static(b"?") };
    assert!(Driver::new(attempt(1), Timing::default(), codec, scene).is_err());
}
