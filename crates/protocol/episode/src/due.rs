//! Which messages a work order makes due: for each role what it takes, what it makes, and what a fresh instance needs
//! besides to restore its state. Functions of the outline and the order alone, so that every process agrees.
//!
//! Iteration 0 renders tick 0; iteration i > 0 the ticks `first..=last`, moved by plan i-1. All roles take `scene` first.

use ds_space::Tick;
use ds_topic::{Advance, EpisodeSpec, Role, Slot, Topic};

use crate::codec::Outline;

/// Returns the role that publishes a topic, `None` for the orchestrator's own.
#[must_use]
pub fn maker(topic: Topic) -> Option<Role> {
    match topic {
        Topic::World | Topic::Ego => Some(Role::Sim),
        Topic::Layout => Some(Role::Layout),
        Topic::Frame | Topic::Cache => Some(Role::Video),
        Topic::Plan => Some(Role::Policy),
        Topic::Scene | Topic::Advance | Topic::Score | Topic::Event | Topic::Diagnosis => None,
    }
}

/// Says whether a role takes a topic pushed to it (`scene` and `advance` apart).
#[must_use]
pub fn takes(role: Role, topic: Topic, spec: &EpisodeSpec) -> bool {
    match role {
        Role::Sim => false,
        Role::Layout => topic == Topic::World,
        Role::Video => topic == Topic::Layout || (topic == Topic::World && spec.observation.needs_world()),
        Role::Policy => {
            matches!(topic, Topic::Frame | Topic::Ego)
                || (topic == Topic::World && spec.witnessed_at(spec.last_tick).is_some())
        }
    }
}

/// Says whether the policy must answer after an iteration: the next one exists and is not driven by the log.
#[must_use]
pub fn plan_due(spec: &EpisodeSpec, iteration: u32) -> bool {
    iteration >= spec.warm_up && iteration + 1 < spec.iterations()
}

/// Returns what a role makes for an order, in slot order.
#[must_use]
pub fn outputs(outline: &Outline, role: Role, advance: &Advance) -> Vec<Slot> {
    let ticks = (advance.first, advance.last);
    match role {
        Role::Sim => [of_ticks(Topic::World, ticks), of_ticks(Topic::Ego, ticks)].concat(),
        Role::Layout => of_cameras(Topic::Layout, ticks, outline.cameras),
        Role::Video => {
            let mut slots = of_cameras(Topic::Frame, ticks, outline.cameras);
            for chunk in outline.spec.chunks_of(advance.iteration) {
                slots.extend((0..outline.cameras).map(|camera| Slot::of_camera(Topic::Cache, chunk, camera)));
            }
            slots
        }
        Role::Policy if advance.plan_due => vec![Slot::new(Topic::Plan, advance.iteration)],
        Role::Policy => Vec::new(),
    }
}

/// Returns what a role takes for an order, in slot order.
#[must_use]
pub fn inputs(outline: &Outline, role: Role, advance: &Advance) -> Vec<Slot> {
    let ticks = (advance.first, advance.last);
    match role {
        Role::Sim => Vec::new(),
        Role::Layout => of_ticks(Topic::World, ticks),
        Role::Video => {
            let world = if outline.spec.observation.needs_world() { of_ticks(Topic::World, ticks) } else { Vec::new() };
            [world, of_cameras(Topic::Layout, ticks, outline.cameras)].concat()
        }
        Role::Policy if advance.plan_due => {
            let seen = outline.spec.seen_at(advance.last);
            let egos = (seen.0, advance.last);
            let worlds = outline.spec.witnessed_at(advance.last).map(|ticks| of_ticks(Topic::World, ticks));
            let frames = of_cameras(Topic::Frame, seen, outline.cameras);
            [worlds.unwrap_or_default(), of_ticks(Topic::Ego, egos), frames].concat()
        }
        Role::Policy => Vec::new(),
    }
}

/// Returns the first tick of which messages may be due again after an order that ends at `last`.
#[must_use]
pub fn remembered_from(spec: &EpisodeSpec, last: Tick) -> Tick {
    let seen = spec.seen_at(last).0;
    spec.witnessed_at(last).map_or(seen, |(first, _)| seen.min(first))
}

/// Returns what a fresh instance of a role needs from the journal before it can work on an order; empty in iteration 0.
#[must_use]
pub fn restore_inputs(outline: &Outline, role: Role, advance: &Advance) -> Vec<Slot> {
    let Some(before) = advance.first.previous() else { return Vec::new() };
    match role {
        Role::Sim => vec![Slot::new(Topic::World, before.0)],
        Role::Layout | Role::Policy => Vec::new(),
        Role::Video if outline.spec.chunk_ticks == 0 => Vec::new(),
        Role::Video => {
            let chunks = outline.spec.chunks_of(advance.iteration).start;
            let committed = chunks.saturating_sub(1) * outline.spec.chunk_ticks;
            let remembered = outline.spec.layout_memory_ticks;
            let first = if remembered > 0 { committed.saturating_sub(remembered) } else { committed + 1 };
            let mut slots = of_cameras(Topic::Layout, (Tick(first), before), outline.cameras);
            for chunk in 0..chunks {
                slots.extend((0..outline.cameras).map(|camera| Slot::of_camera(Topic::Cache, chunk, camera)));
            }
            slots
        }
    }
}

/// Returns every slot that the journal must hold before an iteration is committed, `scene` and `advance` apart.
#[must_use]
pub fn all_outputs(outline: &Outline, advance: &Advance) -> Vec<Slot> {
    Role::ALL.into_iter().flat_map(|role| outputs(outline, role, advance)).collect()
}

/// Returns the tick that a slot describes; for a chunk its last tick, for plans and orders the iteration's last.
#[must_use]
pub fn tick_of(spec: &EpisodeSpec, slot: Slot) -> Tick {
    match slot.topic {
        Topic::World | Topic::Ego | Topic::Layout | Topic::Frame | Topic::Score | Topic::Diagnosis => Tick(slot.index),
        Topic::Cache => Tick(slot.index.saturating_mul(spec.chunk_ticks)),
        Topic::Advance | Topic::Plan => spec.ticks_of(slot.index).1,
        Topic::Scene | Topic::Event => Tick(0),
    }
}

fn of_ticks(topic: Topic, (first, last): (Tick, Tick)) -> Vec<Slot> {
    first.to(last).map(|tick| Slot::new(topic, tick.0)).collect()
}

fn of_cameras(topic: Topic, (first, last): (Tick, Tick), cameras: u16) -> Vec<Slot> {
    let of_tick = |tick: Tick| (0..cameras).map(move |camera| Slot::of_camera(topic, tick.0, camera));
    first.to(last).flat_map(of_tick).collect()
}
