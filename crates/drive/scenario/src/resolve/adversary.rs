//! Checks the adversary of a scenario: its track is a vehicle that is always there, its attack comes before its contact.

use ds_space::{AgentId, Tick};
use ds_world::{Adversary, AdversaryMode, AgentClass, Budget, CrashClass, Scene};

use crate::document::{AdversaryPart, BudgetPart};
use crate::place::{Fault, Place};

const LONGEST_ATTACK_SECS: f64 = 60.0;
const MOST_EFFORT_MPS: f64 = 1000.0;
const FARTHEST_ASIDE_M: f64 = 20.0;
const MOST_REAIMS: u32 = 1000;

/// Checks an adversary against the rest of its scene.
pub(super) fn adversary(at: &Place<'_>, part: &AdversaryPart, scene: &Scene) -> Result<Adversary, Fault> {
    let track_at = at.field("track");
    let Some(track) = scene.tracks.get(part.track as usize) else {
        return Err(track_at.fault(format!("is {}, there are {} tracks", part.track, scene.tracks.len())));
    };
    if track.class != AgentClass::Vehicle {
        return Err(track_at.fault(format!("is {}, which is no vehicle", part.track)));
    }
    if let Some(tick) = track.points.iter().position(Option::is_none) {
        return Err(track_at.fault(format!("is {}, which is not there at tick {tick}", part.track)));
    }
    let named = |name: &'static str, value: &str, names: Vec<&str>| {
        at.field(name).fault(format!("is {value:?}, none of {}", names.join(", ")))
    };
    let class = CrashClass::from_name(&part.class)
        .ok_or_else(|| named("class", &part.class, CrashClass::ALL.map(CrashClass::name).to_vec()))?;
    let mode = AdversaryMode::from_name(&part.mode)
        .ok_or_else(|| named("mode", &part.mode, AdversaryMode::ALL.map(AdversaryMode::name).to_vec()))?;
    let last = scene.last_tick().0;
    if part.contact_tick > last {
        return Err(at.field("contact_tick").fault(format!("is {}, the last tick is {last}", part.contact_tick)));
    }
    if part.attack_tick >= part.contact_tick {
        let problem = format!("is {}, not before the contact at {}", part.attack_tick, part.contact_tick);
        return Err(at.field("attack_tick").fault(problem));
    }
    Ok(Adversary {
        track: AgentId(part.track),
        class,
        mode,
        attack: Tick(part.attack_tick),
        contact: Tick(part.contact_tick),
        budget: budget(&at.field("budget"), &part.budget)?,
        corridor: at.field("corridor_m").points(&part.corridor_m, 2)?,
    })
}

fn budget(at: &Place<'_>, part: &BudgetPart) -> Result<Budget, Fault> {
    if part.reaims > MOST_REAIMS {
        return Err(at.field("reaims").fault(format!("is {}, the limit is {MOST_REAIMS}", part.reaims)));
    }
    Ok(Budget {
        attack_secs: at.field("attack_secs").within(part.attack_secs, 0.0, LONGEST_ATTACK_SECS)?,
        effort_mps: at.field("effort_mps").within(part.effort_mps, 0.0, MOST_EFFORT_MPS)?,
        aside_m: at.field("aside_m").within(part.aside_m, 0.0, FARTHEST_ASIDE_M)?,
        reaims: part.reaims,
    })
}
