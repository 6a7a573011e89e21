//! The protocol under a seeded fault simulator: drop, duplicate, reorder, delay, kill, hang, partition, heal, drain, two
//! orchestrators. Always: one owner accepted per epoch, no iteration executed twice by an owner, one content per slot;
//! in the end the digests of the fault-free run, or a named status and a prefix of them.
//!
//! `DREAMSTREAM_FAULT_SEEDS` sets the number of seeds (`.ci/run` asks for 10,000), `DREAMSTREAM_FAULT_SEED` runs one alone.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};

use crate::faultsim::cluster::{Cluster, Outcome};
use crate::faultsim::script::{Mishap, Moment, Network, Script};
use crate::faultsim::toy::{ToyCodec, ToyMaker};
use ds_episode::driver::Status;
use ds_episode::{Codec, Counters, due};
use ds_space::Digest;
use ds_topic::{Advance, Envelope, Motion, Role, Slot, Topic};

const SEEDS: u64 = 2_000;

/// Reasons with which a run under these faults may end early; none of them is a fault of the protocol.
const NAMED: [&str; 4] = ["no_instance", "iteration_deadline", "too_many_reassignments", "quarantined"];

fn fault_free(script: &Script) -> BTreeMap<Slot, Digest> {
    let calm = Script { network: Network::CALM, mishaps: Vec::new(), ..script.clone() };
    let outcome = Cluster::new(calm).run();
    assert_eq!(outcome.ending.status, Status::Completed, "{}", outcome.ending.reason);
    outcome.contents
}

/// Runs a script and holds its results against those of the fault-free run.
fn check(script: Script) -> Outcome {
    let expected = fault_free(&script);
    let outcome = Cluster::new(script).run();
    if outcome.ending.status == Status::Completed {
        assert!(outcome.contents == expected, "the digests differ from the fault-free run");
    } else {
        let name = outcome.ending.reason.split(':').next().unwrap_or_default();
        assert!(NAMED.contains(&name), "ended with {:?} {:?}", outcome.ending.status, outcome.ending.reason);
        for (slot, content) in &outcome.contents {
            assert_eq!(expected.get(slot), Some(content), "{slot} differs from the fault-free run");
        }
    }
    outcome
}

#[expect(clippy::disallowed_methods, reason = "a test's size is set from outside")]
fn number(name: &str) -> Option<u64> {
    std::env::var(name).ok().map(|text| text.parse().expect("a number of seeds"))
}

/// How runs ended, and what they counted.
#[derive(Default)]
struct Tally {
    endings: BTreeMap<String, u64>,
    counters: Counters,
}

impl Tally {
    fn of(seeds: impl Iterator<Item = u64>) -> Self {
        let mut tally = Self::default();
        for seed in seeds {
            let script = Script::wild(seed);
            let run = catch_unwind(AssertUnwindSafe(|| check(script.clone())));
            let Ok(outcome) = run else { panic!("seed {seed} failed, see above; script: {script:?}") };
            let name = outcome.ending.reason.split(':').next().unwrap_or_default();
            *tally.endings.entry(format!("{} {name}", outcome.ending.status.name())).or_default() += 1;
            tally.counters += outcome.totals;
            tally.counters += outcome.driver;
        }
        tally
    }

    fn and(mut self, other: Self) -> Self {
        for (ending, count) in other.endings {
            *self.endings.entry(ending).or_default() += count;
        }
        self.counters += other.counters;
        self
    }
}

#[test]
fn any_mishaps_end_with_the_digests_of_the_fault_free_run_or_a_named_status() {
    let seeds = match number("DREAMSTREAM_FAULT_SEED") {
        Some(seed) => seed..seed + 1,
        None => 0..number("DREAMSTREAM_FAULT_SEEDS").unwrap_or(SEEDS),
    };
    let count = seeds.end - seeds.start;
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let tally = std::thread::scope(|scope| {
        let every = |first| seeds.clone().skip(first).step_by(cores);
        let parts: Vec<_> = (0..cores).map(|first| scope.spawn(move || Tally::of(every(first)))).collect();
        let parts = parts.into_iter().map(|part| part.join().expect("a seed failed, see above"));
        parts.fold(Tally::default(), Tally::and)
    });
    let Tally { endings, counters } = tally;
    let completed = endings.get("completed ").copied().unwrap_or(0);
    eprintln!("{count} seeds: {endings:?}, {counters:?}");
    assert!(completed * 100 >= count * 95, "only {completed} of {count} seeds completed: {endings:?}");
}

fn completes(script: Script) -> Outcome {
    let outcome = check(script);
    assert_eq!(outcome.ending.status, Status::Completed, "{}", outcome.ending.reason);
    outcome
}

#[test]
fn completes_with_all_pushes_dropped() {
    for seed in 0..40 {
        let network = Network { drop_pushes: 1.0, ..Network::CALM };
        let outcome = completes(Script { network, ..Script::calm(seed) });
        assert_eq!(outcome.pushes_delivered, 0);
        assert!(outcome.totals.pulls > 0 && outcome.driver.pulls > 0);
    }
}

#[test]
fn completes_with_a_third_dropped_doubled_and_reordered() {
    for seed in 0..40 {
        let network = Network { drop_pushes: 0.3, drop_pulls: 0.3, duplicate: 0.3, delay_ms: 60, ghosts: 0.0 };
        let outcome = completes(Script { network, ..Script::calm(seed) });
        assert!(outcome.totals.duplicates + outcome.driver.duplicates > 0);
    }
}

#[test]
fn a_prompt_network_shows_no_gap_and_moves_no_role() {
    let network = Network { delay_ms: 0, ..Network::CALM };
    let outcome = completes(Script { network, ..Script::calm(3) });
    assert_eq!((outcome.totals.gaps, outcome.totals.foreign, outcome.driver.reassignments), (0, 0, 0));
}

#[test]
fn survives_a_kill_of_each_role_in_each_iteration_and_moment() {
    for role in Role::ALL {
        for moment in [Moment::Before, Moment::Middle, Moment::After] {
            for seed in 0..4 {
                let script = Script::calm(seed);
                for iteration in 0..script.outline.spec.iterations() {
                    let mishaps = vec![Mishap::KillAtWork { role, iteration, moment, times: 1 }];
                    completes(Script { mishaps, ..script.clone() });
                }
            }
        }
    }
}

#[test]
fn survives_a_kill_of_the_only_instance_of_a_role() {
    for role in Role::ALL {
        let mishaps = vec![Mishap::KillAtWork { role, iteration: 2, moment: Moment::Middle, times: 1 }];
        completes(Script { mishaps, workers_per_role: 1, ..Script::calm(5) });
    }
}

#[test]
fn a_killed_orchestrator_resumes_from_its_journal() {
    for seed in 0..60 {
        let at = 20 + seed * 12;
        let mishaps = vec![Mishap::KillOrchestrator { at, restart_after: 50 + 20 * (seed % 7) }];
        completes(Script { mishaps, ..Script::calm(seed) });
    }
}

#[test]
fn a_deaf_zombie_orchestrator_changes_nothing() {
    let mut refused = 0;
    for seed in 0..60 {
        let mishaps = vec![Mishap::SecondOrchestrator { at: 20 + seed * 10, deaf: true }];
        let network = Network { delay_ms: 30, ..Network::CALM };
        refused += completes(Script { mishaps, network, ..Script::calm(seed) }).totals.refused_terms;
    }
    assert!(refused > 0, "no order of the lower term was ever refused");
}

#[test]
fn what_broken_predecessors_still_say_leaves_no_trace() {
    let mut ghosts = 0;
    for seed in 0..40 {
        let kill =
            Mishap::KillAtWork { role: Role::ALL[(seed % 4) as usize], iteration: 1, moment: Moment::Middle, times: 1 };
        let mishaps = vec![kill, Mishap::KillOrchestrator { at: 400, restart_after: 50 }];
        let network = Network { ghosts: 0.5, ..Network::CALM };
        ghosts += completes(Script { mishaps, network, ..Script::calm(seed) }).ghosts;
    }
    assert!(ghosts > 1_000, "only {ghosts} ghosts");
}

/// Makes everything again from the orders and plans of a journal alone.
fn replay(script: &Script, journal: &[Envelope]) -> BTreeMap<Slot, Digest> {
    let codec = ToyCodec::new(script.outline.clone());
    let mut messages: BTreeMap<Slot, Envelope> = journal.iter().map(|held| (held.header.slot, held.clone())).collect();
    let mut made = BTreeMap::new();
    let mut makers = Role::ALL.map(|role| ToyMaker::new(role, script.outline.clone()));
    for iteration in 0..script.outline.spec.iterations() {
        let (first, last) = script.outline.spec.ticks_of(iteration);
        let plan = iteration.checked_sub(1).and_then(|before| messages.get(&Slot::new(Topic::Plan, before)));
        let motion = match plan {
            _ if iteration == 0 => Motion::Initial,
            Some(plan) => {
                Motion::Plan(codec.decode_plan(&plan.body).expect("a journalled plan is readable").trajectory)
            }
            None => Motion::Log,
        };
        let plan_due = due::plan_due(&script.outline.spec, iteration);
        let (border, owners) = (Digest::default(), BTreeMap::new());
        let order = Advance { iteration, first, last, motion, border, plan_due, owners };
        for (role, maker) in Role::ALL.into_iter().zip(&mut makers).take(3) {
            let inputs = due::inputs(&script.outline, role, &order);
            let inputs = inputs.into_iter().map(|slot| (slot, messages[&slot].clone())).collect();
            for output in maker.work(&order, &inputs) {
                made.insert(output.slot, output.content);
                messages.get_mut(&output.slot).expect("the journal is whole").header.content = output.content;
            }
        }
    }
    made
}

#[test]
fn the_journalled_plan_is_the_one_that_was_driven_whatever_later_holders_plan() {
    let mut superseded = 0;
    for seed in 0..200 {
        let mut script = Script { fickle_policy: true, ..Script::wild(seed) };
        let kill = |iteration| Mishap::KillAtWork { role: Role::Policy, iteration, moment: Moment::After, times: 1 };
        script.mishaps.extend([kill(1), kill(2), Mishap::KillOrchestrator { at: 150 + seed, restart_after: 60 }]);
        let outcome = Cluster::new(script.clone()).run();
        assert_eq!(outcome.ending.status, Status::Completed, "seed {seed}: {}", outcome.ending.reason);
        superseded += outcome.driver.superseded_plans;
        let driven = replay(&script, &outcome.journal);
        let journalled = outcome.contents.into_iter().filter(|(slot, _)| slot.topic != Topic::Plan).collect();
        assert!(driven == journalled, "seed {seed}: the journal holds states that its plans do not lead to");
    }
    eprintln!("{superseded} plans came after the accepted one");
}

#[test]
fn a_polite_second_orchestrator_takes_over() {
    for seed in 0..30 {
        let mishaps = vec![Mishap::SecondOrchestrator { at: 20 + seed * 20, deaf: false }];
        completes(Script { mishaps, ..Script::calm(seed) });
    }
}

#[test]
fn a_hung_stage_that_wakes_after_its_lease_publishes_nothing() {
    let mut withheld = 0;
    for role in Role::ALL {
        for seed in 0..10 {
            let mishaps = vec![Mishap::HangAtWork { role, iteration: 1, for_ms: 500 + 100 * seed }];
            withheld += completes(Script { mishaps, ..Script::calm(seed) }).totals.withheld;
        }
    }
    assert!(withheld > 0, "no output was ever made after the lease ran out");
}

#[test]
fn heals_after_partitions_of_every_shape() {
    for mask in 1..64 {
        let mishaps = vec![Mishap::Partition { at: 40, mask: mask * 17, for_ms: 200 + 20 * u64::from(mask) }];
        completes(Script { mishaps, ..Script::calm(u64::from(mask)) });
    }
}

#[test]
fn draining_hands_over_without_a_death() {
    for worker in 0..8 {
        let mishaps = vec![Mishap::Drain { at: 60, worker, restart_after: 200 }];
        completes(Script { mishaps, deaths_to_quarantine: 1, ..Script::calm(worker as u64) });
    }
}

#[test]
fn an_episode_that_kills_two_instances_is_quarantined() {
    let mishaps = vec![Mishap::KillAtWork { role: Role::Layout, iteration: 1, moment: Moment::Before, times: 100 }];
    let outcome = check(Script { mishaps, deaths_to_quarantine: 2, workers_per_role: 3, ..Script::calm(1) });
    assert_eq!(outcome.ending.status, Status::Aborted);
    assert!(outcome.ending.reason.starts_with("quarantined: layout"), "{}", outcome.ending.reason);
    assert!(outcome.ending.committed == 1, "iteration 0 was committed");
}
