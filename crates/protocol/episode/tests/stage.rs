//! A stage told one thing at a time: what it refuses, reports, withholds and repeats.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::faultsim::toy::{SCENE, ToyCodec, hash};
use bytes::Bytes;
use ds_episode::stage::{Action, Assignment, Event, Output, PullFrom, Stage, StopReason};
use ds_episode::{Codec, Fault, Millis, Outline, Timing, due};
use ds_space::{AttemptId, Digest, EpisodeId, InstanceId, SimTime, Tick};
use ds_topic::{
    Advance, Envelope, EpisodeSpec, Header, Motion, ObservationSource, Owner, Role, SCHEMA_VERSION, Slot, Topic,
};

const LEASE_UNTIL: Millis = Millis(1_000);

fn id(text: &str) -> InstanceId {
    InstanceId::new(text).expect("a valid id")
}

fn outline() -> Outline {
    let spec = EpisodeSpec {
        policy: "toy".to_owned(),
        observation: ObservationSource::Dreamstream,
        replan_period: 2,
        horizon: 8,
        chunk_ticks: 2,
        ..EpisodeSpec::replay(EpisodeId::new("e").expect("a valid id"), "toy", Tick(6))
    };
    Outline { spec, cameras: 1, dt: SimTime(100_000_000) }
}

/// A stage under test and the hand that feeds it.
struct Bench {
    stage: Stage,
    codec: Arc<ToyCodec>,
    role: Role,
    sequence: u64,
}

impl Bench {
    fn new(role: Role) -> Self {
        let codec = Arc::new(ToyCodec::new(outline()));
        let assignment = Assignment {
            episode: outline().spec.episode,
            attempt: AttemptId(1),
            role,
            owner: Owner { instance: id(role.name()), epoch: 5 },
            term: 3,
            lease_until: LEASE_UNTIL,
        };
        let stage = Stage::new(assignment, Timing::default(), codec.clone(), Millis(0));
        Self { stage, codec, role, sequence: 0 }
    }

    /// A stage that has the scene.
    fn ready(role: Role) -> Self {
        let mut bench = Self::new(role);
        let actions = bench.tell(bench.scene());
        assert!(actions.contains(&Action::Ready { epoch: 5 }), "{actions:?}");
        bench
    }

    /// A stage that has done iteration 0.
    fn after_first(role: Role) -> Self {
        let mut bench = Self::ready(role);
        bench.tell(bench.order(&advance(0)));
        let content = advance(0).content();
        for slot in due::inputs(&outline(), role, &advance(0)) {
            bench.tell(bench.input(slot, 5, hash("input", &[], &[slot.index])));
        }
        bench.tell(Event::Restored { order: content, result: Ok(()) });
        let actions = bench.tell(Event::Worked { order: content, result: Ok(bench.outputs(&advance(0))) });
        let published = actions.iter().filter(|action| matches!(action, Action::Publish(_))).count();
        assert_eq!(published, due::outputs(&outline(), role, &advance(0)).len());
        bench
    }

    fn tell(&mut self, event: Event) -> Vec<Action> {
        self.tell_at(10, event)
    }

    fn tell_at(&mut self, at: u64, event: Event) -> Vec<Action> {
        self.stage.handle(Millis(at), event)
    }

    fn header(&self, slot: Slot, content: Digest) -> Header {
        Header {
            episode: outline().spec.episode,
            attempt: AttemptId(1),
            term: 3,
            epoch: 0,
            iteration: 0,
            tick: Tick(0),
            time: SimTime(0),
            sequence: self.sequence,
            publisher: id("orchestrator"),
            schema_version: SCHEMA_VERSION,
            trace: String::new(),
            slot,
            content,
        }
    }

    fn scene(&self) -> Event {
        let header = self.header(Slot::new(Topic::Scene, 0), hash("scene", &[], &[]));
        Event::Message(Envelope { header, body: Bytes::from_static(SCENE) })
    }

    fn order(&self, advance: &Advance) -> Event {
        self.order_of_term(advance, 3)
    }

    fn order_of_term(&self, advance: &Advance, term: u64) -> Event {
        let mut header = self.header(Slot::new(Topic::Advance, advance.iteration), advance.content());
        header.term = term;
        Event::Message(Envelope { header, body: self.codec.encode_advance(advance) })
    }

    fn input(&self, slot: Slot, epoch: u64, content: Digest) -> Event {
        let mut header = self.header(slot, content);
        header.epoch = epoch;
        header.publisher = id(due::maker(slot.topic).expect("an input has a maker").name());
        Event::Message(Envelope { header, body: Bytes::copy_from_slice(&content.0) })
    }

    fn outputs(&self, advance: &Advance) -> Vec<Output> {
        let slots = due::outputs(&outline(), self.role, advance);
        let content = |slot: Slot| hash(slot.topic.name(), &[], &[slot.index]);
        slots
            .into_iter()
            .map(|slot| Output { slot, tick: Tick(slot.index), content: content(slot), body: Bytes::new() })
            .collect()
    }
}

fn owners() -> BTreeMap<Role, Owner> {
    Role::ALL.into_iter().map(|role| (role, Owner { instance: id(role.name()), epoch: 5 })).collect()
}

fn advance(iteration: u32) -> Advance {
    let (first, last) = outline().spec.ticks_of(iteration);
    let motion = if iteration == 0 { Motion::Initial } else { Motion::Log };
    let border = if iteration == 0 { Digest::default() } else { hash("world", &[], &[first.0 - 1]) };
    let plan_due = due::plan_due(&outline().spec, iteration);
    Advance { iteration, first, last, motion, border, plan_due, owners: owners() }
}

fn reported(actions: &[Action]) -> Vec<&str> {
    let name = |action| match action {
        &Action::Report(Fault { ref name, .. }) => Some(name.as_str()),
        _ => None,
    };
    actions.iter().filter_map(name).collect()
}

fn works(actions: &[Action]) -> bool {
    actions.iter().any(|action| matches!(action, Action::Work { .. }))
}

#[test]
fn works_on_the_next_order_and_answers_the_same_order_again() {
    let mut bench = Bench::after_first(Role::Sim);
    assert!(works(&bench.tell(bench.order(&advance(1)))));
    let again = bench.tell(bench.order(&advance(1)));
    assert!(again.is_empty(), "a repeat while working changes nothing: {again:?}");
    bench.tell(Event::Worked { order: advance(1).content(), result: Ok(bench.outputs(&advance(1))) });
    let again = bench.tell(bench.order(&advance(1)));
    assert_eq!(again.len(), 4, "two worlds and two egos are published again: {again:?}");
    assert!(again.iter().all(|action| matches!(action, Action::Publish(_))));
}

#[test]
fn reports_another_order_for_an_iteration() {
    let mut bench = Bench::after_first(Role::Sim);
    bench.tell(bench.order(&advance(1)));
    let other = Advance { motion: Motion::Initial, ..advance(1) };
    let actions = bench.tell(bench.order(&other));
    assert_eq!(reported(&actions), [Fault::CONFLICTING_ADVANCE]);
    assert!(!works(&actions));
}

#[test]
fn refuses_an_order_from_another_border() {
    let mut bench = Bench::after_first(Role::Sim);
    let other = Advance { border: hash("elsewhere", &[], &[]), ..advance(1) };
    let actions = bench.tell(bench.order(&other));
    assert_eq!(reported(&actions), [Fault::WRONG_BORDER]);
    assert!(!works(&actions));
}

#[test]
fn a_fresh_simulator_compares_the_journalled_border_before_it_restores() {
    let mut bench = Bench::ready(Role::Sim);
    bench.tell(bench.order(&advance(1)));
    let slot = Slot::new(Topic::World, 0);
    let Event::Message(wrong) = bench.input(slot, 4, hash("elsewhere", &[], &[])) else { unreachable!() };
    let actions = bench.tell(Event::Pulled { slot, from: PullFrom::Journal, reply: Some(wrong) });
    assert_eq!(reported(&actions), [Fault::WRONG_BORDER]);

    let mut bench = Bench::ready(Role::Sim);
    bench.tell(bench.order(&advance(1)));
    let Event::Message(right) = bench.input(slot, 4, advance(1).border) else { unreachable!() };
    let actions = bench.tell(Event::Pulled { slot, from: PullFrom::Journal, reply: Some(right) });
    assert!(matches!(actions[..], [Action::Restore { .. }]), "{actions:?}");
    let actions = bench.tell(Event::Restored { order: advance(1).content(), result: Ok(()) });
    assert!(works(&actions));
}

#[test]
fn refuses_orders_of_a_lower_term_and_of_other_owners() {
    let mut bench = Bench::after_first(Role::Sim);
    bench.tell(bench.order_of_term(&advance(0), 4));
    assert!(!works(&bench.tell(bench.order_of_term(&advance(1), 3))));
    assert_eq!(bench.stage.counters().refused_terms, 1);

    let mut bench = Bench::after_first(Role::Sim);
    let mut earlier = advance(1);
    earlier.owners.insert(Role::Sim, Owner { instance: id("other"), epoch: 4 });
    assert!(!works(&bench.tell(bench.order(&earlier))));
    assert_eq!(bench.stage.counters().refused_epochs, 1);

    let mut later = advance(1);
    let successor = Owner { instance: id("other"), epoch: 6 };
    later.owners.insert(Role::Sim, successor.clone());
    assert_eq!(bench.tell(bench.order(&later)), [Action::Stop(StopReason::Superseded(successor))]);
    assert!(bench.stage.stopped());
}

#[test]
fn takes_inputs_of_the_named_owner_only_and_reports_divergence() {
    let mut bench = Bench::after_first(Role::Layout);
    bench.tell(bench.order(&advance(1)));
    let slot = Slot::new(Topic::World, 1);
    bench.tell(bench.input(slot, 4, hash("old", &[], &[])));
    assert_eq!((bench.stage.counters().refused_epochs, bench.stage.held_inputs()), (1, 1));
    bench.tell(bench.input(slot, 5, hash("new", &[], &[])));
    bench.tell(bench.input(slot, 5, hash("new", &[], &[])));
    assert_eq!((bench.stage.counters().duplicates, bench.stage.held_inputs()), (1, 2));
    let actions = bench.tell(bench.input(slot, 5, hash("differs", &[], &[])));
    assert_eq!(reported(&actions), [Fault::DIVERGENT_DUPLICATE]);
}

#[test]
fn an_order_with_a_new_owner_makes_it_accept_that_one() {
    let mut bench = Bench::after_first(Role::Layout);
    bench.tell(bench.order(&advance(1)));
    let mut moved = advance(1);
    moved.owners.insert(Role::Sim, Owner { instance: id("sim"), epoch: 6 });
    bench.tell(bench.order(&moved));
    bench.tell(bench.input(Slot::new(Topic::World, 1), 5, hash("old", &[], &[])));
    assert_eq!(bench.stage.counters().refused_epochs, 1);
    bench.tell(bench.input(Slot::new(Topic::World, 1), 6, hash("new", &[], &[])));
    assert!(works(&bench.tell(bench.input(Slot::new(Topic::World, 2), 6, hash("new", &[], &[])))));
}

#[test]
fn withholds_what_was_made_after_the_lease_until_it_is_renewed() {
    let mut bench = Bench::after_first(Role::Sim);
    bench.tell(bench.order(&advance(1)));
    let worked = Event::Worked { order: advance(1).content(), result: Ok(bench.outputs(&advance(1))) };
    let late = LEASE_UNTIL.0;
    assert!(!bench.tell_at(late, worked).iter().any(|action| matches!(action, Action::Publish(_))));
    let asked = bench.tell_at(late, Event::Asked { query: 9, slot: Slot::new(Topic::World, 1) });
    assert_eq!(asked[0], Action::Answer { query: 9, reply: None });
    assert!(!bench.tell_at(late, bench.order(&advance(1))).iter().any(|action| matches!(action, Action::Publish(_))));
    let renewed = bench.tell_at(late, Event::LeaseRenewed { until: Millis(late + 500) });
    assert_eq!(renewed.iter().filter(|action| matches!(action, Action::Publish(_))).count(), 4);
    assert_eq!(bench.stage.counters().withheld, 4);
}

#[test]
fn refuses_outputs_that_are_not_those_due() {
    let mut bench = Bench::after_first(Role::Sim);
    bench.tell(bench.order(&advance(1)));
    let mut outputs = bench.outputs(&advance(1));
    outputs.pop();
    let actions = bench.tell(Event::Worked { order: advance(1).content(), result: Ok(outputs) });
    assert_eq!(reported(&actions), [Fault::WRONG_OUTPUTS]);
    assert_eq!(actions.len(), 1, "nothing is published: {actions:?}");
}

#[test]
fn refuses_orders_that_contradict_the_scene() {
    let cases = [
        Advance { last: Tick(3), ..advance(1) },
        Advance { plan_due: !advance(1).plan_due, ..advance(1) },
        Advance { iteration: 9, ..advance(1) },
        Advance { border: hash("elsewhere", &[], &[]), ..advance(0) },
    ];
    for order in cases {
        let mut bench = Bench::ready(Role::Layout);
        assert_eq!(reported(&bench.tell(bench.order(&order))), [Fault::BAD_MESSAGE], "{order:?}");
    }
}

#[test]
fn an_unreadable_or_altered_order_is_reported() {
    let mut bench = Bench::ready(Role::Layout);
    let Event::Message(mut message) = bench.order(&advance(0)) else { unreachable!() };
    message.header.content = hash("altered", &[], &[]);
    assert_eq!(reported(&bench.tell(Event::Message(message.clone()))), [Fault::BAD_MESSAGE]);
    message.body = Bytes::from_static(b"?");
    assert_eq!(reported(&bench.tell(Event::Message(message))), [Fault::BAD_MESSAGE]);
}

#[test]
fn asks_owner_and_journal_in_turn_for_what_does_not_come() {
    let mut bench = Bench::after_first(Role::Layout);
    bench.tell_at(20, bench.order(&advance(1)));
    let asked = |actions: Vec<Action>| -> Vec<PullFrom> {
        let of_world = |action| match action {
            Action::Pull { slot, from } if slot.topic == Topic::World => Some(from),
            _ => None,
        };
        actions.into_iter().filter_map(of_world).collect()
    };
    assert!(asked(bench.tell_at(219, Event::Now)).is_empty());
    let owner = PullFrom::Owner(Owner { instance: id("sim"), epoch: 5 });
    // One question while nothing has come; the other message is asked for as soon as the first is there.
    assert_eq!(asked(bench.tell_at(220, Event::Now)), std::slice::from_ref(&owner));
    assert!(asked(bench.tell_at(300, Event::Now)).is_empty());
    assert_eq!(asked(bench.tell_at(420, Event::Now)), [PullFrom::Journal]);
    let first = bench.input(Slot::new(Topic::World, 1), 5, hash("w", &[], &[1]));
    assert_eq!(asked(bench.tell_at(430, first)), [owner]);
}

#[test]
fn drops_pushes_beyond_its_window_and_foreign_ones() {
    let mut bench = Bench::after_first(Role::Layout);
    bench.tell(bench.order(&advance(1)));
    for tick in 1..=6 {
        bench.tell(bench.input(Slot::new(Topic::World, tick), 5, hash("w", &[], &[tick])));
    }
    assert_eq!(bench.stage.counters().dropped, 2, "ticks 5 and 6 belong to the iteration after the next");
    let Event::Message(mut message) = bench.input(Slot::new(Topic::World, 1), 5, hash("w", &[], &[])) else {
        unreachable!()
    };
    message.header.attempt = AttemptId(2);
    bench.tell(Event::Message(message));
    assert_eq!(bench.stage.counters().foreign, 1);
}

#[test]
fn drains_after_the_iteration_that_it_works_on() {
    let mut bench = Bench::after_first(Role::Sim);
    bench.tell(bench.order(&advance(1)));
    assert!(bench.tell(Event::Drain).is_empty());
    let actions = bench.tell(Event::Worked { order: advance(1).content(), result: Ok(bench.outputs(&advance(1))) });
    assert_eq!(actions.len(), 4);
    assert_eq!(bench.tell(bench.order(&advance(2))), [Action::Stop(StopReason::Drained)]);
}

#[test]
fn repeats_the_report_of_a_broken_maker() {
    let mut bench = Bench::after_first(Role::Sim);
    bench.tell(bench.order(&advance(1)));
    let fault = Fault::infrastructure("out_of_memory", "3 GB asked");
    let actions = bench.tell(Event::Worked { order: advance(1).content(), result: Err(fault.clone()) });
    assert_eq!(actions, [Action::Report(fault.clone())]);
    assert_eq!(bench.tell_at(1_100, Event::Now), [Action::Report(fault)]);
}
