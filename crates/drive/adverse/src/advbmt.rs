//! The arm `advbmt-default`: collision state and filter as Adv-BMT releases them, driven backwards by our motion model.
//!
//! At the end of a window of 91 frames its centre is on the ego's, at any heading, at about half the ego's speed, in a body of
//! the ego's shape. Eight drives are drawn backwards; the first that moves 0.1 m a tick and bends less than 0.8 /m is taken,
//! else the last. Nobody asks for a road, for others, or for a way out: what each drive would have fallen to is only counted.

use std::sync::Arc;

use ds_space::{DVec2, Draws, PoseSe2, Tick, angle};
use ds_vehicle::{Control, Rolling};
use ds_world::{CrashClass, Scene};

use crate::measure::measured;
use crate::model::{MotionModel, STEP_TICKS, Step};
use crate::solve::Trial;
use crate::stage::{Body, Stage};
use crate::validity::{Candidate, Rejection, check_drive, met};
use crate::variant::{Attack, Built, Options, Refusal, Variant, scored_until, with_track};

const WINDOW_TICKS: u32 = 90;
const DRIVES: u64 = 8;
const LEAST_STEP_M: f64 = 0.1;
const MOST_CURVATURE_PM: f64 = 0.8;
const BRAKING_MPS2: f64 = -4.0;

/// Makes the variant of a scenario as this arm has it: at most one, of the class that the contact turns out to be.
///
/// # Errors
/// As for [`crate::variants`].
pub fn advbmt(scene: &Scene, model: &MotionModel, options: &Options) -> Result<Built, Refusal> {
    let last = scored_until(scene, options)?.0;
    let mut built = Built::default();
    let draws = Draws::new(&scene.digest, "adversary of Adv-BMT", &[options.seed]);
    let mut stage = Stage::new(scene, model, &draws);
    stage.body = Body { size: scene.vehicle.size };
    // A window that ends after the scored drive would put the contact where nobody looks.
    let first = WINDOW_TICKS.max(options.hand_over.0 + 1);
    if last < first {
        return Err(Refusal::Short { last, needed: first });
    }
    let contact = first + draws.below(0, u64::from(last - first + 1)) as u32;
    let drive = drawn(&stage, contact, &draws);
    let attack = Attack { contact, corridor: corridor(&drive.states[..=contact as usize]), states: &drive.states };
    let mut fallen = Vec::new();
    let candidate = Candidate { way: None, states: &drive.states, controls: &drive.controls, contact };
    fallen.extend(check_drive(&stage, &candidate, options.hand_over).err());
    let made = finished(&stage, &attack, drive.surprise, options, Tick(last));
    let class = made.as_ref().map_or(CrashClass::RearEnd, |variant| variant.class);
    built.candidates.insert(class, 1);
    match made {
        Ok(variant) => {
            let unsolved = if variant.emptied.is_some() { Rejection::Unavoidable } else { Rejection::Unsolved };
            fallen.extend(variant.solution.is_none().then_some(unsolved));
            built.variants.push(variant);
        }
        Err(reason) => fallen.push(reason),
    }
    fallen.into_iter().for_each(|reason| *built.rejected.entry((class, reason)).or_default() += 1);
    Ok(built)
}

/// A drive of every tick of the log.
struct Driven {
    states: Vec<Rolling>,
    controls: Vec<Control>,
    /// Mean of −ln of the backward chance of its steps.
    surprise: f64,
}

/// Draws the collision state and drives back from it until a drive passes the filter.
fn drawn(stage: &Stage<'_>, contact: u32, draws: &Draws) -> Driven {
    let ego = stage.ego(contact);
    let turned_rad = std::f64::consts::TAU * draws.normal(10);
    let speed_mps = (0.5 * stage.ego_velocity(contact).length() + 0.5 * draws.normal(20)).max(0.0);
    let heading_rad = angle::wrap(ego.forward.to_angle() + turned_rad);
    let centre = PoseSe2 { position: ego.centre, heading_rad };
    let end = Rolling { pose: stage.body.rear(&centre), speed_mps };
    let mut driven = backwards(stage, end, contact, draws, 0);
    for drive in 1..DRIVES {
        if passes(&driven, stage.dt_secs, contact) {
            break;
        }
        driven = backwards(stage, end, contact, draws, drive);
    }
    while Tick(driven.states.len() as u32) <= stage.scene.last_tick() {
        let car = driven.states[driven.states.len() - 1];
        let acceleration_mps2 = BRAKING_MPS2.max(-car.speed_mps / stage.dt_secs);
        let control = Control { acceleration_mps2, curvature_pm: 0.0 };
        driven.states.push(car.forwards(control, stage.dt_secs));
        driven.controls.push(control);
    }
    driven
}

/// Says whether a drive moves and does not bend too much within its window.
fn passes(driven: &Driven, dt_secs: f64, contact: u32) -> bool {
    let window = driven.states.len() - 1 - WINDOW_TICKS.min(contact) as usize;
    let moves = driven.states[window..].iter().all(|car| car.speed_mps * dt_secs >= LEAST_STEP_M);
    moves && driven.controls[window..].iter().all(|control| control.curvature_pm.abs() < MOST_CURVATURE_PM)
}

/// Drives back to the first tick, each half second drawn from the backward table, and forwards again.
fn backwards(stage: &Stage<'_>, end: Rolling, contact: u32, draws: &Draws, drive: u64) -> Driven {
    let mut after = Step { speed_mps: end.speed_mps, acceleration_mps2: 0.0, yaw_rate_radps: 0.0 };
    let (mut car, mut controls, mut surprise, mut steps) = (end, Vec::new(), 0.0, 0.0);
    while controls.len() < contact as usize {
        let index = 1000 * (drive + 1) + controls.len() as u64;
        let before = stage.model.drawn_before(car.speed_mps, &after, draws.uniform(index));
        for _ in 0..STEP_TICKS.min(contact as usize - controls.len()) {
            let control = Control {
                acceleration_mps2: before.acceleration_mps2.min(car.speed_mps / stage.dt_secs),
                curvature_pm: (before.yaw_rate_radps / car.speed_mps.max(0.1)).clamp(-1.0, 1.0),
            };
            car = car.backwards(control, stage.dt_secs);
            controls.push(control);
        }
        surprise += stage.model.backwards(&before, &after);
        steps += 1.0;
        after = before;
    }
    controls.reverse();
    let mut states = vec![car];
    for control in &controls {
        states.push(states[states.len() - 1].forwards(*control, stage.dt_secs));
    }
    Driven { states, controls, surprise: surprise / f64::max(steps, 1.0) }
}

/// Returns the line that it drives, each half second.
fn corridor(states: &[Rolling]) -> Vec<DVec2> {
    let mut points: Vec<DVec2> = Vec::new();
    for car in states.iter().step_by(STEP_TICKS) {
        if points.last().is_none_or(|last| last.distance(car.pose.position) > 1.0) {
            points.push(car.pose.position);
        }
    }
    let last = states[states.len() - 1].pose;
    points.push(last.position + last.forward() * 10.0);
    points
}

/// Finds out by the simulator what the drive meets, and of which class that is.
fn finished(
    stage: &Stage<'_>,
    attack: &Attack<'_>,
    surprise: f64,
    options: &Options,
    last: Tick,
) -> Result<Variant, Rejection> {
    let (scene, agent) = with_track(stage, attack, CrashClass::RearEnd, options)?;
    let met = met(stage, &Arc::new(scene), agent, last).ok_or(Rejection::NoContact)?;
    if met.tick <= options.hand_over {
        return Err(Rejection::Start);
    }
    let class = met.class.ok_or(Rejection::Class)?;
    let (scene, _) = with_track(stage, attack, class, options)?;
    let scene = Arc::new(scene);
    let measures = measured(stage, attack.states, met, options.hand_over);
    let trial = Trial { scene: &scene, road: &stage.road, threat: measures.threat, last };
    let (solution, careful) = (if options.solve { trial.expert() } else { None }, trial.careful());
    let emptied = if solution.is_none() { trial.emptied(met.tick) } else { None };
    let margin_ticks = solution.as_ref().and_then(|_| trial.margin_ticks(met.tick));
    let scene = Arc::unwrap_or_clone(scene);
    let planned = Tick(attack.contact);
    Ok(Variant { scene, agent, class, planned, surprise, measures, emptied, solution, margin_ticks, careful })
}
