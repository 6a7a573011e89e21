//! Leases, epochs, terms, devices, quarantine and cordon, over a ledger in memory.

use crate::faultsim::store::SharedStore;
use ds_episode::Millis;
use ds_episode::fleet::{
    AssignError, ComputeClass, Fleet, FleetSettings, Granted, Hello, JoinError, Ledger, LedgerError, LossCause, Request,
};
use ds_space::{AttemptId, EpisodeId, InstanceId};
use ds_topic::Role;

const SETTINGS: FleetSettings =
    FleetSettings { lease_ms: 100, margin_ms: 20, deaths_to_quarantine: 2, failures_to_cordon: 2 };

fn id(text: &str) -> InstanceId {
    InstanceId::new(text).expect("a valid id")
}

fn hello(name: &str) -> Hello {
    Hello {
        instance: id(name),
        role: Role::Video,
        slots: 1,
        devices: Vec::new(),
        shares_device: false,
        class: ComputeClass("a".to_owned()),
    }
}

fn request(episode: &str) -> Request {
    let episode = EpisodeId::new(episode).expect("a valid id");
    Request { episode, attempt: AttemptId(1), role: Role::Video, exclude: None }
}

fn fleet(store: &SharedStore, names: &[&str]) -> Fleet<SharedStore> {
    let mut fleet = Fleet::open(store.clone(), SETTINGS, Millis(0)).expect("an empty ledger opens");
    for name in names {
        fleet.join(Millis(0), hello(name)).expect("it may join");
    }
    fleet
}

fn assign(fleet: &mut Fleet<SharedStore>, at: u64, episode: &str) -> Result<Granted, AssignError> {
    fleet.assign(Millis(at), request(episode))
}

#[test]
fn waits_for_lease_and_margin_and_raises_the_epoch() {
    let store = SharedStore::default();
    let mut fleet = fleet(&store, &["a", "b"]);
    let first = assign(&mut fleet, 0, "e").expect("two are free");
    assert_eq!((first.owner.instance.as_str(), first.owner.epoch), ("a", 1));
    fleet.renew(Millis(90), &id("b")).expect("in charge");
    assert!(matches!(assign(&mut fleet, 95, "e"), Err(AssignError::Held { until: Millis(120), .. })));
    assert!(fleet.expire(Millis(119)).expect("in charge").is_empty());
    let lost = fleet.expire(Millis(120)).expect("in charge");
    assert_eq!((lost.len(), lost[0].cause), (1, LossCause::Died));
    let second = assign(&mut fleet, 121, "e").expect("b is free");
    assert_eq!((second.owner.instance.as_str(), second.owner.epoch), ("b", 2));
    assert!(fleet.renew(Millis(121), &id("a")).expect("in charge").is_none(), "a silent instance must join again");
}

#[test]
fn several_roles_are_given_at_once_or_none() {
    let store = SharedStore::default();
    let mut fleet = fleet(&store, &["a"]);
    let sim = |episode: &str| Request { role: Role::Sim, ..request(episode) };
    fleet.join(Millis(0), Hello { role: Role::Sim, slots: 2, ..hello("s") }).expect("it may join");
    let all = vec![sim("e"), request("e"), request("f"), sim("e")];
    let answers = fleet.assign_all(Millis(0), all).expect("in charge");
    let given: Vec<_> = answers.iter().map(|answer| answer.as_ref().ok().map(|given| given.owner.epoch)).collect();
    assert_eq!(given, [Some(1), Some(1), None, None], "one video worker has one slot");
    assert!(
        matches!(answers[3], Err(AssignError::Held { epoch: 1, .. })),
        "a role that is asked for twice is given once"
    );
    assert!(matches!(answers[2], Err(AssignError::NoFreeSlot { role: Role::Video, members: 1 })));
    // Fenced, nothing is given, and nobody counts as busy.
    Fleet::open(store.clone(), SETTINGS, Millis(0)).expect("the ledger opens again");
    assert!(fleet.assign_all(Millis(1), vec![sim("f")]).is_err());
    assert_eq!(fleet.members().find(|member| member.hello.role == Role::Sim).map(|member| member.held), Some(1));
}

#[test]
fn a_renewed_lease_holds() {
    let mut fleet = fleet(&SharedStore::default(), &["a"]);
    assign(&mut fleet, 0, "e").expect("one is free");
    for at in (50..1_000).step_by(50) {
        let held = fleet.renew(Millis(at), &id("a")).expect("in charge").expect("it has joined");
        assert_eq!(held.len(), 1);
        assert!(fleet.expire(Millis(at)).expect("in charge").is_empty());
    }
}

#[test]
fn a_second_orchestrator_raises_the_term_keeps_epochs_and_fences_the_first() {
    let store = SharedStore::default();
    let mut first = fleet(&store, &["a"]);
    assign(&mut first, 0, "e").expect("one is free");
    let mut second = Fleet::open(store.clone(), SETTINGS, Millis(1_000)).expect("the ledger opens again");
    assert_eq!((first.term(), second.term()), (1, 2));
    assert!(matches!(assign(&mut first, 1, "f"), Err(AssignError::Ledger(LedgerError::Fenced { own: 1, current: 2 }))));
    assert!(first.renew(Millis(1), &id("a")).is_err());
    second.join(Millis(1_000), hello("b")).expect("it may join");
    assert!(matches!(assign(&mut second, 1_000, "e"), Err(AssignError::Held { epoch: 1, .. })));
    let joined = second.join(Millis(1_001), hello("a")).expect("it may join");
    assert_eq!(joined.lost[0].cause, LossCause::Rejoined);
    assert_eq!(assign(&mut second, 1_001, "e").expect("the role is free").owner.epoch, 2);
}

#[test]
fn two_deaths_in_a_role_quarantine_the_episode_across_restarts() {
    let store = SharedStore::default();
    let mut fleet = fleet(&store, &["a"]);
    for (at, name) in [(0, "b"), (1_000, "c")] {
        fleet.join(Millis(at), hello(name)).expect("it may join");
        assign(&mut fleet, at, "e").expect("one is free");
        assert_eq!(fleet.expire(Millis(at + 500)).expect("in charge").len(), 1);
    }
    let mut fleet = self::fleet(&store, &["d"]);
    let refusal = assign(&mut fleet, 0, "e").expect_err("the episode killed two");
    assert!(refusal.lasting() && refusal.to_string().starts_with("quarantined"), "{refusal}");
    assign(&mut fleet, 0, "f").expect("another episode goes on");
}

#[test]
fn failing_two_different_episodes_cordons_an_instance() {
    let store = SharedStore::default();
    let mut fleet = fleet(&store, &["a"]);
    for episode in ["e", "e", "f"] {
        let granted = assign(&mut fleet, 0, episode).expect("a is not cordoned yet");
        fleet.dismiss(&granted.request.episode, Role::Video, &granted.owner).expect("in charge");
    }
    assert!(matches!(assign(&mut fleet, 0, "g"), Err(AssignError::NoFreeSlot { .. })));
    assert!(fleet.members().all(|member| member.cordoned));
    let mut fleet = self::fleet(&store, &["a", "b"]);
    assert_eq!(assign(&mut fleet, 0, "g").expect("b is free").owner.instance, id("b"));
}

#[test]
fn an_attempt_stays_in_its_compute_class() {
    let mut fleet = fleet(&SharedStore::default(), &["a"]);
    assign(&mut fleet, 0, "e").expect("a is free");
    let other = Hello { class: ComputeClass("b".to_owned()), ..hello("b") };
    fleet.join(Millis(0), other).expect("it may join");
    fleet.leave(&id("a")).expect("in charge");
    assert!(matches!(assign(&mut fleet, 0, "e"), Err(AssignError::NoEqualClass { .. })));
    let next = Request { attempt: AttemptId(2), ..request("e") };
    assert_eq!(fleet.assign(Millis(0), next).expect("a new attempt may take any").owner.epoch, 2);
}

#[test]
fn slots_drain_and_exclusion_bound_what_an_instance_gets() {
    let mut fleet = fleet(&SharedStore::default(), &["a"]);
    let roomy = Hello { slots: 2, ..hello("b") };
    fleet.join(Millis(0), roomy).expect("it may join");
    let holder = |granted: Result<Granted, AssignError>| granted.map(|granted| granted.owner.instance).ok();
    assert_eq!(holder(assign(&mut fleet, 0, "e")), Some(id("b")), "the most free slots first");
    let excluding = Request { exclude: Some(id("a")), ..request("f") };
    assert_eq!(holder(fleet.assign(Millis(0), excluding)), Some(id("b")));
    assert_eq!(holder(assign(&mut fleet, 0, "g")), Some(id("a")));
    assert_eq!(holder(assign(&mut fleet, 0, "h")), None);
    assert_eq!(fleet.finish(&request("g").episode).expect("in charge").len(), 1);
    fleet.drain(&id("a"));
    assert_eq!(holder(assign(&mut fleet, 0, "h")), None);
}

#[test]
fn devices_are_handed_out_once_unless_shared() {
    let mut fleet = fleet(&SharedStore::default(), &[]);
    let on = |name: &str, shares_device: bool| Hello {
        devices: vec!["gpu-0".to_owned(), "gpu-1".to_owned()],
        shares_device,
        ..hello(name)
    };
    let mut device = |name: &str, shares: bool| fleet.join(Millis(0), on(name, shares)).map(|joined| joined.device);
    assert_eq!(device("a", false).expect("two are free"), Some("gpu-0".to_owned()));
    assert_eq!(device("b", false).expect("one is free"), Some("gpu-1".to_owned()));
    assert!(matches!(device("c", false), Err(JoinError::NoFreeDevice { .. })));
    assert_eq!(device("c", true).expect("it shares"), Some("gpu-0".to_owned()));
    assert!(matches!(fleet.join(Millis(0), Hello { slots: 0, ..hello("d") }), Err(JoinError::NoSlots { .. })));
}

#[test]
fn a_broken_ledger_is_named() {
    for (key, value) in [("seat/e/video", "x\na\n1\nheld\nc"), ("seat/e/pilot", "1\na\n1\nheld\nc"), ("death/e", "")] {
        let mut store = SharedStore::default();
        let term = store.raise_term().expect("memory cannot fail");
        store.commit(term, &[(key.to_owned(), Some(value.into()))]).expect("in charge");
        let error = Fleet::open(store, SETTINGS, Millis(0)).err().expect("the entry is broken");
        assert!(error.to_string().contains(key), "{error}");
    }
}
