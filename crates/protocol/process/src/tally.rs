//! What the stages of one role have done in this process: counts of their machines, orders and restores of their makers.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use ds_episode::stage::Event;
use ds_episode::{Counters, FaultClass, Stage};
use ds_topic::{Role, Topic};

use crate::exposition::{Histogram, Kind, Page};
use crate::workbench::Done;

/// Tells the counts of protocol machines; `role` is a stage's, or `orchestrator` for its drivers.
pub fn tell_counters(page: &mut Page, role: &str, counters: &Counters) {
    for (name, help, count) in counters.list() {
        let name = format!("dreamstream_protocol_{name}_total");
        page.tell(&name, help, Kind::Counter, &[("role", role)], count as f64);
    }
}

/// All that is counted of a role.
#[derive(Default)]
struct Counts {
    machines: Counters,
    held_inputs: usize,
    held_roles: u32,
    orders: Histogram,
    restores: Histogram,
    cache_hits: u64,
    frames: u64,
    faults: BTreeMap<FaultClass, u64>,
}

/// The counts of a role; clones share them.
#[derive(Clone, Default)]
pub(crate) struct Tally(Arc<Mutex<Counts>>);

impl Tally {
    fn lock(&self) -> MutexGuard<'_, Counts> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Tells the counts of a role that so many episodes can have a holder of here.
    pub(crate) fn tell(&self, role: Role, slots: u32, page: &mut Page) {
        let counts = self.lock();
        let labels = [("role", role.name())];
        tell_counters(page, role.name(), &counts.machines);
        let mut gauge = |name, help, value: f64| page.tell(name, help, Kind::Gauge, &labels, value);
        gauge("dreamstream_slots", "Episodes that can be held at once.", slots.into());
        gauge("dreamstream_held_roles", "Episodes held now, one role each.", counts.held_roles.into());
        let help = "Messages that wait in the inboxes of held roles until all that an order needs is there.";
        gauge("dreamstream_queue_depth", help, counts.held_inputs as f64);
        let help = "Time that makers worked on one order, of orders that were carried out.";
        page.tell_times("dreamstream_order_seconds", help, &labels, &counts.orders);
        let help = "Time to make a state again from journalled messages; their number counts the misses of the cache.";
        page.tell_times("dreamstream_restore_seconds", help, &labels, &counts.restores);
        let mut counter = |name, help, labels: &[(&str, &str)], count: u64| {
            page.tell(name, help, Kind::Counter, labels, count as f64);
        };
        let help = "Orders that found their state in memory: the KV cache of a video model, the world of a simulator.";
        counter("dreamstream_cache_hits_total", help, &labels, counts.cache_hits);
        if role == Role::Video {
            counter("dreamstream_frames_total", "Frames made, one a tick and camera.", &[], counts.frames);
        }
        for class in FaultClass::ALL {
            let labels = [labels[0], ("class", class.name())];
            let count = counts.faults.get(&class).copied().unwrap_or_default();
            counter("dreamstream_faults_total", "Faults that makers met, by what follows.", &labels, count);
        }
    }

    /// Begins to follow one machine.
    pub(crate) fn follow(&self) -> Follower {
        self.lock().held_roles += 1;
        Follower { tally: self.clone(), counters: Counters::default(), held_inputs: 0, restored: None }
    }
}

/// Follows the machine of one held role until it is dropped.
pub(crate) struct Follower {
    tally: Tally,
    counters: Counters,
    held_inputs: usize,
    /// The iteration whose state was made again.
    restored: Option<u32>,
}

impl Follower {
    /// Notes what the machine has counted since the last look.
    pub(crate) fn look(&mut self, stage: &Stage) {
        let (counters, held_inputs) = (stage.counters(), stage.held_inputs());
        let mut counts = self.tally.lock();
        counts.machines += counters - self.counters;
        counts.held_inputs = counts.held_inputs + held_inputs - self.held_inputs;
        drop(counts);
        (self.counters, self.held_inputs) = (counters, held_inputs);
    }

    /// Notes what the maker has done. The state before iteration 0 is no cached one.
    pub(crate) fn done(&mut self, done: &Done) {
        let secs = done.micros as f64 * 1e-6;
        let mut counts = self.tally.lock();
        match &done.event {
            Event::Restored { result: Ok(()), .. } => {
                self.restored = Some(done.iteration);
                if done.iteration > 0 {
                    counts.restores.observe(secs);
                }
            }
            Event::Worked { result: Ok(outputs), .. } => {
                counts.orders.observe(secs);
                counts.cache_hits += u64::from(self.restored != Some(done.iteration));
                let frames = outputs.iter().filter(|output| output.slot.topic == Topic::Frame).count();
                counts.frames += frames as u64;
            }
            Event::Restored { result: Err(fault), .. } | Event::Worked { result: Err(fault), .. } => {
                *counts.faults.entry(fault.class).or_default() += 1;
            }
            _ => {}
        }
    }
}

impl Drop for Follower {
    fn drop(&mut self) {
        let mut counts = self.tally.lock();
        counts.held_roles -= 1;
        counts.held_inputs -= self.held_inputs;
    }
}
