//! Lane changes as decisions: what each driver could have changed to, what it would have brought (MOBIL), what it did.
//!
//! A change is seen when a driver's place passes the middle between two lanes; it was decided when it began, two
//! seconds before. The chance of deciding rises with the advantage as a logistic function about the threshold.

use ds_sim::{Changer, IdmParameters, Neighbour, THRESHOLD_MPS2};
use ds_space::DVec2;

use crate::case::Recording;
use crate::scenery::{Actor, Scenery};

/// From the begin of a change to the middle between the lanes, s.
const HALF_CHANGE_SECS: f64 = 2.0;
/// Around a change nothing else is decided, s.
const QUIET_SECS: (f64, f64) = (2.5, 5.5);
/// Seconds between two looks at drivers who stay.
const LOOK_SECS: f64 = 0.5;
/// Width of the logistic function, m/s².
const WIDTH_MPS2: f64 = 0.25;
/// Chance that a look is followed by a change, or by none, whatever the advantage.
const LAPSE: f64 = 0.01;

/// One look of a driver at another lane.
#[derive(Debug, Clone, Copy)]
pub struct Look {
    /// When, as a tick.
    pub tick: usize,
    /// Gain of the own acceleration, m/s².
    pub mine_mps2: f64,
    /// Gain of others' accelerations, m/s².
    pub others_mps2: f64,
    /// Whether the driver changed.
    pub changed: bool,
}

/// Returns a driver's looks at other lanes.
#[must_use]
pub fn looks(scenery: &Scenery, recording: &Recording, actor: &Actor, idm: &IdmParameters) -> Vec<Look> {
    let slots = slots(scenery, actor);
    let tick_of = |secs: f64| (secs / scenery.dt_secs) as usize;
    let changes = changes_of(scenery, &slots);
    let mut looks = Vec::new();
    for &(middle, from, to) in &changes {
        let begin = middle.saturating_sub(tick_of(HALF_CHANGE_SECS));
        let options = options(scenery, recording, actor, begin, from, idm);
        if let Some(option) = options.iter().find(|option| option.0 == to) {
            looks.push(Look { tick: begin, mine_mps2: option.1, others_mps2: option.2, changed: true });
        }
    }
    let step = tick_of(LOOK_SECS).max(1);
    for tick in (scenery.from_tick..slots.len()).step_by(step) {
        let quiet = |middle: usize| {
            (middle.saturating_sub(tick_of(QUIET_SECS.0))..middle + tick_of(QUIET_SECS.1)).contains(&tick)
        };
        let Some(slot) = slots[tick].filter(|_| !changes.iter().any(|(middle, ..)| quiet(*middle))) else { continue };
        for (_, mine_mps2, others_mps2) in options(scenery, recording, actor, tick, slot, idm) {
            looks.push(Look { tick, mine_mps2, others_mps2, changed: false });
        }
    }
    looks
}

/// Returns the ticks at which a driver passes the middle between two lanes.
#[must_use]
pub fn changes(scenery: &Scenery, actor: &Actor) -> Vec<usize> {
    changes_of(scenery, &slots(scenery, actor)).into_iter().map(|(tick, ..)| tick).collect()
}

fn changes_of(scenery: &Scenery, slots: &[Option<i8>]) -> Vec<(usize, i8, i8)> {
    let quiet = (3.0 / scenery.dt_secs) as usize;
    let mut changes: Vec<(usize, i8, i8)> = Vec::new();
    for tick in 1..slots.len() {
        if let (Some(from), Some(to)) = (slots[tick - 1], slots[tick])
            && from != to
            && changes.last().is_none_or(|(last, ..)| tick - last > quiet)
        {
            changes.push((tick, from, to));
        }
    }
    changes
}

/// Returns the negative log likelihood of looks, those at a stay weighted as the correlated ones they are.
#[must_use]
pub fn loss(looks: &[Look], politeness: f64) -> f64 {
    let one = |look: &Look| {
        let advantage = look.mine_mps2 + politeness * look.others_mps2;
        let chance = 1.0 / (1.0 + ((THRESHOLD_MPS2 - advantage) / WIDTH_MPS2).clamp(-30.0, 30.0).exp());
        let chance = LAPSE + (1.0 - 2.0 * LAPSE) * chance;
        if look.changed { -chance.ln() } else { -0.25 * (1.0 - chance).ln() }
    };
    looks.iter().map(one).sum()
}

fn slots(scenery: &Scenery, actor: &Actor) -> Vec<Option<i8>> {
    let Some(lanes) = scenery.ways.lanes.get(actor.index) else { return Vec::new() };
    let slot = |mark: &Option<crate::scenery::Mark>| {
        let mark = mark.as_ref()?;
        let known = (-2i8..=2).filter_map(|slot| Some((slot, lanes.offset_m(slot, mark.along_m)?)));
        let off = |offset_m: f64| (mark.lateral_m - offset_m).abs();
        known.min_by(|a, b| off(a.1).total_cmp(&off(b.1))).map(|(slot, _)| slot)
    };
    actor.marks.iter().map(slot).collect()
}

/// Returns the safe changes of a driver at a tick: slot, own gain, others' gain.
fn options(
    scenery: &Scenery,
    recording: &Recording,
    actor: &Actor,
    tick: usize,
    slot: i8,
    idm: &IdmParameters,
) -> Vec<(i8, f64, f64)> {
    let (Some(path), Some(lanes)) = (&scenery.ways.paths[actor.index], scenery.ways.lanes.get(actor.index)) else {
        return Vec::new();
    };
    let Some(mark) = actor.marks.get(tick).and_then(Option::as_ref) else { return Vec::new() };
    let desired = |along_m: f64| idm.desired_speed_mps.unwrap_or_else(|| path.at(along_m).desired_mps);
    let mut near = Vec::new();
    for (index, who) in recording.agents.iter().enumerate() {
        let Some(there) = who.seen.get(tick).copied().flatten() else { continue };
        let here = path.at(mark.along_m).pose.position;
        if index == actor.index || who.class.is_static() || there.at.distance(here) > 120.0 {
            continue;
        }
        let [centre_m, lateral_m] = path.project(there.at);
        let (direction, forward) = (path.direction_at(centre_m), DVec2::from_angle(there.heading_rad));
        let (along, across) = (direction.dot(forward).abs(), direction.perp_dot(forward).abs());
        let speed_mps = there.speed_mps * direction.dot(forward);
        let wanted = scenery.ways.paths.get(index).and_then(Option::as_ref).zip(scenery.places[tick][index]);
        let wanted_mps = wanted.map_or(speed_mps, |(path, placed)| {
            idm.desired_speed_mps.unwrap_or_else(|| path.at(placed.along_m).desired_mps)
        });
        near.push(Neighbour {
            ahead_m: centre_m - mark.along_m,
            lateral_m,
            half_across_m: across * who.half_length_m + along * who.half_width_m,
            half_along_m: along * who.half_length_m + across * who.half_width_m,
            speed_mps,
            desired_mps: wanted_mps.max(0.1),
        });
    }
    let changer = Changer {
        idm,
        politeness: 0.0,
        lanes,
        along_m: mark.along_m,
        speed_mps: mark.speed_mps.max(0.0),
        desired_mps: desired(mark.along_m),
        half_length_m: actor.half_length_m,
        half_width_m: actor.half_width_m,
    };
    changer.options(slot, &near).iter().map(|option| (option.to, option.mine_mps2, option.others_mps2)).collect()
}
