//! What the orchestrator counts for whoever runs a fleet: iterations and what they cost beside the makers' work, commits,
//! recoveries, deadlines, leases, members and episodes by state. It reads the clock; nothing of it enters an episode.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use ds_episode::driver::{Ending, Status};
use ds_episode::{Counters, Driver};
use ds_process::exposition::{Histogram, Kind, Page};
use ds_process::tally::tell_counters;
use ds_topic::Role;
use ds_wire::control as pb;

use crate::hub::{Hub, LOSSES, Leases};
use crate::registry::Registry;

/// The deadline of a plan in wall-clock mode, which ends nothing.
const ANSWER: &str = "answer";
/// Deadlines, and the faults that say that one was missed.
const DEADLINES: [(&str, &[&str]); 4] = [
    (ANSWER, &[]),
    ("iteration", &["iteration_deadline"]),
    ("holder", &["no_instance"]),
    ("policy", &["policy_deadline", "policy_absent"]),
];

#[derive(Default)]
struct Counts {
    machines: Counters,
    iterations: u64,
    ticks: u64,
    iteration_times: Histogram,
    overheads: Histogram,
    commits: Histogram,
    recoveries: Histogram,
    deadline_misses: BTreeMap<&'static str, u64>,
    attempts: BTreeMap<&'static str, u64>,
}

/// The counts of all attempts; clones share them.
#[derive(Clone, Default)]
pub(crate) struct Tally(Arc<Mutex<Counts>>);

impl Tally {
    fn lock(&self) -> MutexGuard<'_, Counts> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Begins to follow one attempt.
    pub(crate) fn follow(&self) -> Follower {
        Follower {
            tally: self.clone(),
            counters: Counters::default(),
            since: None,
            worked_secs: 0.0,
            ahead_secs: 0.0,
            interrupted: None,
        }
    }

    /// Tells all counts of this orchestrator.
    pub(crate) fn tell(&self, hub: &Hub, registry: &Registry, page: &mut Page) {
        self.tell_attempts(page);
        tell_leases(&hub.leases(), page);
        let help = "Members of the fleet by role and by what they are up to, as `dreamstream top` shows them.";
        let mut tell = |role: &str, state, count| {
            let labels = [("role", role), ("state", state)];
            page.tell("dreamstream_instances", help, Kind::Gauge, &labels, count);
        };
        for (role, state) in Role::ALL.into_iter().flat_map(|role| pb::MEMBER_STATES.map(|state| (role, state))) {
            tell(role.name(), state, 0.0);
        }
        for member in hub.list() {
            let role = member.hello.as_ref().and_then(|hello| pb::role_of(hello.role));
            tell(role.map_or("unknown", Role::name), pb::member_state(&member), 1.0);
        }
        for (status, count) in registry.episodes() {
            let help = "Episodes of all runs in the ledger, by status.";
            page.tell("dreamstream_episodes", help, Kind::Gauge, &[("status", status)], count as f64);
        }
        let help = "Term of this orchestrator, raised at each start.";
        page.tell("dreamstream_term", help, Kind::Gauge, &[], hub.term() as f64);
    }

    fn tell_attempts(&self, page: &mut Page) {
        let counts = self.lock();
        tell_counters(page, "orchestrator", &counts.machines);
        let mut counter = |name, help, labels: &[(&str, &str)], count: u64| {
            page.tell(name, help, Kind::Counter, labels, count as f64);
        };
        counter("dreamstream_iterations_total", "Iterations committed.", &[], counts.iterations);
        counter("dreamstream_ticks_total", "Ticks driven and committed, as in results.", &[], counts.ticks);
        for (deadline, _) in DEADLINES {
            let count = counts.deadline_misses.get(deadline).copied().unwrap_or_default();
            let help = "Deadlines missed: each ended an attempt, but for answers in wall-clock mode.";
            counter("dreamstream_deadline_misses_total", help, &[("deadline", deadline)], count);
        }
        for status in [Status::Completed, Status::Failed, Status::Aborted] {
            let count = counts.attempts.get(status.name()).copied().unwrap_or_default();
            let labels = [("status", status.name())];
            counter("dreamstream_attempts_total", "Attempts at episodes that ended, by status.", &labels, count);
        }
        let mut times = |name, help, times: &Histogram| page.tell_times(name, help, &[], times);
        let help = "Time from the commit before (or the first order) to an iteration's own.";
        times("dreamstream_iteration_seconds", help, &counts.iteration_times);
        let help = "What of it no maker worked: bus, waiting, protocol, scoring and the commit.";
        times("dreamstream_iteration_overhead_seconds", help, &counts.overheads);
        let help = "Time to write an iteration to the journal and sync it.";
        times("dreamstream_commit_seconds", help, &counts.commits);
        let help = "Time from the loss of a holder, as the orchestrator learns of it, to the next commit.";
        times("dreamstream_recovery_seconds", help, &counts.recoveries);
    }
}

fn tell_leases(leases: &Leases, page: &mut Page) {
    for role in Role::ALL {
        let mut counter = |name, help, labels: &[(&str, &str)], count: Option<&u64>| {
            page.tell(name, help, Kind::Counter, labels, count.copied().unwrap_or_default() as f64);
        };
        let of_role = ("role", role.name());
        let given = leases.given.get(&role);
        counter("dreamstream_leases_total", "Roles given to instances, each under a new epoch.", &[of_role], given);
        for cause in LOSSES {
            let lost = leases.lost.get(&(role, cause));
            let help = "Leases that ended before their episode did: the epoch is fenced off.";
            counter("dreamstream_lost_leases_total", help, &[of_role, ("cause", cause)], lost);
        }
    }
}

/// Follows one attempt.
pub(crate) struct Follower {
    tally: Tally,
    counters: Counters,
    /// When the last commit was over, or the first order was sent.
    since: Option<Instant>,
    /// What the makers had worked until then.
    worked_secs: f64,
    /// Work of iterations to come that was told of before: taken off their overhead.
    ahead_secs: f64,
    /// When a holder was lost, until the next commit.
    interrupted: Option<Instant>,
}

impl Follower {
    /// Notes what the driver has counted since the last look.
    pub(crate) fn look(&mut self, driver: &Driver) {
        let counters = driver.counters();
        self.tally.lock().machines += counters - self.counters;
        if counters.reassignments > self.counters.reassignments {
            self.interrupted.get_or_insert_with(Instant::now);
        }
        self.counters = counters;
    }

    /// Notes that an order was sent.
    pub(crate) fn ordered(&mut self) {
        self.since.get_or_insert_with(Instant::now);
    }

    /// Notes that an iteration of so many ticks is in the journal, how long that took, and what the makers have worked
    /// in this attempt so far.
    pub(crate) fn committed(&mut self, ticks: u32, commit_secs: f64, worked_secs: f64) {
        let now = Instant::now();
        let took = self.since.replace(now).map_or(0.0, |since| now.duration_since(since).as_secs_f64());
        let overhead = took - (worked_secs - self.worked_secs) + self.ahead_secs;
        (self.worked_secs, self.ahead_secs) = (worked_secs, overhead.min(0.0));
        let mut counts = self.tally.lock();
        counts.iterations += 1;
        counts.ticks += u64::from(ticks);
        counts.commits.observe(commit_secs);
        counts.iteration_times.observe(took);
        counts.overheads.observe(overhead.max(0.0));
        if let Some(interrupted) = self.interrupted.take() {
            counts.recoveries.observe(now.duration_since(interrupted).as_secs_f64());
        }
    }

    /// Notes that answers came late in wall-clock mode.
    pub(crate) fn late(&self, answers: u32) {
        *self.tally.lock().deadline_misses.entry(ANSWER).or_default() += u64::from(answers);
    }

    /// Notes how the attempt ended.
    pub(crate) fn ended(&self, ending: &Ending) {
        let mut counts = self.tally.lock();
        *counts.attempts.entry(ending.status.name()).or_default() += 1;
        let fault = ending.reason.split(':').next().unwrap_or_default();
        if let Some((deadline, _)) = DEADLINES.iter().find(|(_, faults)| faults.contains(&fault)) {
            *counts.deadline_misses.entry(deadline).or_default() += 1;
        }
    }
}
