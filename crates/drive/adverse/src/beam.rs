//! Backwards from a collision state to the first tick: a beam over half-second steps of the bicycle in reverse.
//!
//! Each step takes an acceleration and a way of steering back onto the lane; its cost is −ln of its chance by the
//! backward table and of how it keeps to the lane, infinite beyond limits, off the road and where it would touch
//! anybody. What is kept is the controls, tick by tick: driven forwards they lead to the collision.

use std::collections::BTreeSet;

use ds_space::{Tick, angle};
use ds_vehicle::{Control, Rolling};

use crate::collision::Target;
use crate::limits::{self, Limits};
use crate::model::{ACCELERATIONS_MPS2, Keeping, STEP_TICKS, Step};
use crate::road::Way;
use crate::stage::Stage;

const WIDTH: usize = 64;
/// How firmly an offset from the lane is turned into a heading towards it, in radians a metre, at 10 m/s.
const FIRMNESS: [f64; 3] = [0.025, 0.055, 0.1];
const SETTLING_SECS: f64 = 0.8;
const MOST_TURNED_RAD: f64 = 0.22;
/// Beside the ego less than this is too close until the last half second, in metres.
const BESIDE_EGO_M: f64 = 0.2;
pub(crate) const BESIDE_OTHERS_M: f64 = 0.25;
const KEEPING_WEIGHT: f64 = 0.4;

#[derive(Debug, Clone, Copy)]
struct Node {
    car: Rolling,
    /// The half second after this place in time.
    after: Step,
    control: Control,
    cost: f64,
    parent: usize,
    segment: usize,
    ticks: usize,
    controls: [Control; STEP_TICKS],
}

/// A drive that leads to a collision: its start and the control of each tick.
#[derive(Debug, Clone)]
pub(crate) struct Drive {
    pub start: Rolling,
    pub controls: Vec<Control>,
    /// Mean of −ln of forward and backward chance, a step.
    pub surprise: f64,
}

/// Searches drives to a target; the likeliest first, at most `most`, those apart at their start.
pub(crate) fn search(stage: &Stage<'_>, way: &Way, target: &Target, most: usize) -> Vec<Drive> {
    let after = Step {
        speed_mps: target.car.speed_mps,
        acceleration_mps2: target.acceleration_mps2,
        yaw_rate_radps: target.car.speed_mps * target.curvature_pm,
    };
    let control = Control { acceleration_mps2: target.acceleration_mps2, curvature_pm: target.curvature_pm };
    let segment = way.beside(target.car.pose.position, 0).segment;
    let none = [Control::default(); STEP_TICKS];
    let first = Node { car: target.car, after, control, cost: 0.0, parent: 0, segment, ticks: 0, controls: none };
    let mut levels = vec![vec![first]];
    let mut tick = target.tick;
    while tick > 0 {
        let ticks = STEP_TICKS.min(tick as usize);
        let when = When { tick, contact: target.tick, ticks };
        let level = &levels[levels.len() - 1];
        let mut next = Vec::new();
        for (parent, node) in level.iter().enumerate() {
            expand(stage, way, node, parent, when, &mut next);
        }
        let kept = thin_out(next, way);
        if kept.is_empty() {
            return Vec::new();
        }
        levels.push(kept);
        tick -= ticks as u32;
    }
    let last = levels.len() - 1;
    let mut drives: Vec<Drive> = Vec::new();
    for index in 0..levels[last].len() {
        let node = &levels[last][index];
        let near = |drive: &Drive| drive.start.pose.position.distance(node.car.pose.position) < 4.0;
        if drives.len() < most && !drives.iter().any(near) {
            drives.push(traced(stage, &levels, index));
        }
    }
    drives
}

fn traced(stage: &Stage<'_>, levels: &[Vec<Node>], index: usize) -> Drive {
    let (mut controls, mut surprise, mut steps) = (Vec::new(), 0.0, 0.0);
    let mut at = index;
    for level in levels[1..].iter().rev() {
        let node = &level[at];
        controls.extend(node.controls[..node.ticks].iter().rev());
        at = node.parent;
    }
    let mut at = index;
    let mut before: Option<Step> = None;
    for level in levels.iter().rev() {
        if let Some(before) = before {
            surprise += 0.5 * (stage.model.forwards(&before, &level[at].after))
                + 0.5 * stage.model.backwards(&before, &level[at].after);
            steps += 1.0;
        }
        before = Some(level[at].after);
        at = level[at].parent;
    }
    let start = levels[levels.len() - 1][index].car;
    Drive { start, controls, surprise: surprise / f64::max(steps, 1.0) }
}

/// When a step back is taken.
#[derive(Clone, Copy)]
struct When {
    /// The tick that it comes from.
    tick: u32,
    /// The tick of the contact.
    contact: u32,
    /// How many ticks it goes back.
    ticks: usize,
}

/// Adds all steps that lead to a node.
fn expand(stage: &Stage<'_>, way: &Way, node: &Node, parent: usize, when: When, out: &mut Vec<Node>) {
    let most = 0.9 * Limits::JERK_MPS3 * when.ticks as f64 * stage.dt_secs;
    for acceleration_mps2 in ACCELERATIONS_MPS2 {
        if (acceleration_mps2 - node.control.acceleration_mps2).abs() > most.min(3.8) {
            continue;
        }
        for firmness in FIRMNESS {
            out.extend(step_back(stage, way, node, parent, when, acceleration_mps2, firmness));
        }
    }
}

fn step_back(
    stage: &Stage<'_>,
    way: &Way,
    node: &Node,
    parent: usize,
    when: When,
    goal_mps2: f64,
    firmness: f64,
) -> Option<Node> {
    let When { tick, contact, ticks } = when;
    let mut next = Node { parent, ticks, ..*node };
    let dt_secs = stage.dt_secs;
    let change = (goal_mps2 - node.control.acceleration_mps2) / ticks as f64;
    for i in 0..ticks {
        let beside = way.beside(next.car.pose.position, next.segment);
        if beside.station_m < 0.5 {
            return None;
        }
        let speed_mps = next.car.speed_mps;
        let error_rad = angle::turn(beside.heading_rad, next.car.pose.heading_rad);
        let wanted_rad =
            (firmness * (10.0 / speed_mps.max(5.0)) * beside.left_m).clamp(-MOST_TURNED_RAD, MOST_TURNED_RAD);
        let wish_pm = beside.curvature_pm + (error_rad - wanted_rad) / (speed_mps.max(2.0) * SETTLING_SECS);
        let curvature_pm =
            limits::steered(next.control.curvature_pm, wish_pm, speed_mps, stage.body.wheel_base_m(), dt_secs);
        let mut acceleration_mps2 = node.control.acceleration_mps2 + change * (i as f64 + 0.5);
        if speed_mps < acceleration_mps2 * dt_secs {
            let all_mps2 = speed_mps / dt_secs;
            if acceleration_mps2 - all_mps2 > 0.9 && speed_mps > 0.0 {
                return None;
            }
            acceleration_mps2 = all_mps2;
        }
        let control = Control { acceleration_mps2, curvature_pm };
        next.car = next.car.backwards(control, dt_secs);
        next.segment = beside.segment;
        next.control.curvature_pm = curvature_pm;
        next.controls[i] = control;
        let at = tick - 1 - i as u32;
        let centre = stage.body.centre(&next.car);
        let last = contact - at <= STEP_TICKS as u32;
        let near_ego = stage.body.grown(&centre, if last { 0.0 } else { BESIDE_EGO_M });
        if stage.ego(at).touches(&near_ego) || stage.meets_others(at, &stage.body.grown(&centre, BESIDE_OTHERS_M)) {
            return None;
        }
    }
    next.control.acceleration_mps2 = goal_mps2;
    let turned_rad = angle::turn(next.car.pose.heading_rad, node.car.pose.heading_rad);
    let secs = ticks as f64 * dt_secs;
    next.after = Step {
        speed_mps: node.car.speed_mps,
        acceleration_mps2: (node.car.speed_mps - next.car.speed_mps) / secs,
        yaw_rate_radps: turned_rad / secs,
    };
    cost(stage, way, node, &mut next, secs)?;
    Some(next)
}

/// Adds the cost of a step; nothing if it is beyond the limits or off the road.
fn cost(stage: &Stage<'_>, way: &Way, node: &Node, next: &mut Node, secs: f64) -> Option<()> {
    let beside = way.beside(next.car.pose.position, next.segment);
    let most_mps = 1.28 * way.limit_mps(beside.station_m);
    let centre = stage.body.centre(&next.car);
    let corners = stage.body.grown(&centre, 0.05).corners();
    if next.car.speed_mps > most_mps || !stage.road.holds(&corners, &centre) {
        return None;
    }
    let place =
        Keeping { left_m: beside.left_m, error_rad: angle::turn(beside.heading_rad, next.car.pose.heading_rad) };
    let lane_radps = 0.5 * (node.car.speed_mps + next.car.speed_mps) * beside.curvature_pm;
    let keeping = stage.model.keeping(place, next.after.yaw_rate_radps - lane_radps);
    let share = secs / 0.5;
    next.cost = node.cost + share * (stage.model.backwards(&next.after, &node.after) + KEEPING_WEIGHT * keeping);
    Some(())
}

/// Keeps the cheapest nodes, one for each small cell of place, speed and acceleration.
fn thin_out(mut nodes: Vec<Node>, way: &Way) -> Vec<Node> {
    nodes.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let mut seen = BTreeSet::new();
    let cell = |value: f64, size: f64| (value / size).round() as i64;
    nodes.retain(|node| {
        if seen.len() >= WIDTH {
            return false;
        }
        let beside = way.beside(node.car.pose.position, node.segment);
        let (v, a) = (node.car.speed_mps, node.control.acceleration_mps2);
        seen.insert((cell(beside.station_m, 1.5), cell(beside.left_m, 0.4), cell(v, 0.6), cell(a, 0.5)))
    });
    nodes
}

/// Drives forwards: the state at every tick up to the contact.
pub(crate) fn driven(stage: &Stage<'_>, drive: &Drive) -> Vec<Rolling> {
    let mut states = vec![drive.start];
    for control in &drive.controls {
        states.push(states[states.len() - 1].forwards(*control, stage.dt_secs));
    }
    states
}

/// Goes on after the contact: brakes to a stand, staying so far beside its way.
pub(crate) fn brake(stage: &Stage<'_>, way: &Way, drive: &Drive, states: &mut Vec<Rolling>) -> Vec<Control> {
    let mut controls = drive.controls.clone();
    let last = stage.scene.last_tick();
    let Some(car) = states.last().copied() else { return controls };
    let kept_m = way.beside(car.pose.position, 0).left_m;
    let mut control = controls.last().copied().unwrap_or_default();
    while Tick(states.len() as u32) <= last {
        let car = states[states.len() - 1];
        let beside = way.beside(car.pose.position, 0);
        let error_rad = angle::turn(beside.heading_rad, car.pose.heading_rad);
        let wanted_rad = (0.05 * (kept_m - beside.left_m)).clamp(-0.1, 0.1);
        let wish_pm = beside.curvature_pm + (wanted_rad - error_rad) / (car.speed_mps.max(2.0) * SETTLING_SECS);
        let base = (stage.body.wheel_base_m(), stage.dt_secs);
        control.curvature_pm = limits::steered(control.curvature_pm, wish_pm, car.speed_mps, base.0, base.1);
        // Braking eases off before the stand, so that the jerk stays within limits.
        let goal_mps2 = (-4.0f64).max(-1.2 * car.speed_mps - 0.3);
        let change = (goal_mps2 - control.acceleration_mps2).clamp(-1.1, 1.1);
        control.acceleration_mps2 += change;
        if car.speed_mps + control.acceleration_mps2 * stage.dt_secs < 0.0 {
            control.acceleration_mps2 = -car.speed_mps / stage.dt_secs;
        }
        states.push(car.forwards(control, stage.dt_secs));
        controls.push(control);
    }
    controls
}
