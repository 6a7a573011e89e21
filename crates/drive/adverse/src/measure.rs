//! What is recorded of a variant along the logged drive: when it threatens, how close it comes, how hard it meets.

use ds_space::plane::OrientedBox;
use ds_space::{DVec2, Tick};
use ds_vehicle::Rolling;

use crate::stage::{Stage, gap_m};
use crate::validity::Met;

/// Times to collision beyond this are not looked for, in seconds.
const HORIZON_SECS: f64 = 4.0;
const STEP_SECS: f64 = 0.1;
/// Who goes on as before stays so near to its place in the lane, in metres.
const ASIDE_M: f64 = 0.375;
/// Who goes on as before keeps to the acceleration that it has, or gives it up, to so many metres per second squared.
const HARDER_MPS2: f64 = 1.0;

/// Numbers of a variant, all along the logged drive of the ego.
#[derive(Debug, Clone, PartialEq)]
pub struct Measures {
    /// The first tick from hand-over on at which the adversary does not go on as before, or the time to collision falls below
    /// 4 s; at the latest the contact.
    pub threat: Tick,
    /// The first contact.
    pub met: Met,
    /// Change of velocity of each of two equal masses that stay together, in metres per second.
    pub delta_v_mps: f64,
    /// Time to collision of each tick from hand-over to contact, at constant velocities; none beyond 4 s.
    pub ttc_secs: Vec<Option<f64>>,
    /// Deceleration along the line of approach with which the ego would come to the adversary's speed within the gap
    /// at the threat tick, in metres per second squared.
    pub required_mps2: f64,
}

impl Measures {
    /// Returns the least time to collision before contact, in seconds.
    #[must_use]
    pub fn least_ttc_secs(&self) -> Option<f64> {
        let before = &self.ttc_secs[..self.ttc_secs.len().saturating_sub(1)];
        before.iter().flatten().copied().reduce(f64::min)
    }
}

pub(crate) fn measured(stage: &Stage<'_>, states: &[Rolling], met: Met, hand_over: Tick) -> Measures {
    let ticks = hand_over.0..=met.tick.0;
    let ttc_secs: Vec<Option<f64>> = ticks.map(|tick| ttc(stage, &states[tick as usize], tick)).collect();
    let near = ttc_secs.iter().position(Option::is_some).map_or(met.tick.0, |i| hand_over.0 + i as u32);
    let threat = leaves(stage, states, hand_over, met.tick).unwrap_or(near).min(near).min(met.tick.0);
    let relative = |tick: u32| {
        let car = &states[tick as usize];
        stage.ego_velocity(tick) - car.pose.forward() * car.speed_mps
    };
    let car = &states[threat as usize];
    let body = stage.body.grown(&stage.body.centre(car), 0.0);
    let towards = (body.centre - stage.ego(threat).centre).normalize_or_zero();
    let closing_mps = relative(threat).dot(towards).max(0.0);
    let gap = gap_m(stage.ego(threat), &body).max(0.1);
    Measures {
        threat: Tick(threat),
        delta_v_mps: 0.5 * relative(met.tick.0).length(),
        required_mps2: closing_mps * closing_mps / (2.0 * gap),
        met,
        ttc_secs,
    }
}

/// Returns the first tick up to the last at which a car does not do what it did at hand-over: keep its place in its lane and
/// those that this leads to, and its acceleration, or give that up.
fn leaves(stage: &Stage<'_>, states: &[Rolling], hand_over: Tick, last: Tick) -> Option<u32> {
    let acceleration = |tick: u32| {
        let before = &states[tick.saturating_sub(1) as usize];
        (states[tick as usize].speed_mps - before.speed_mps) / stage.dt_secs
    };
    let had_mps2 = acceleration(hand_over.0);
    let usual = had_mps2.min(0.0) - HARDER_MPS2..=had_mps2.max(0.0) + HARDER_MPS2;
    let kept = stage.road.lane_at(&stage.body.centre(&states[hand_over.0 as usize]));
    let aside = |tick: u32| {
        let centre = stage.body.centre(&states[tick as usize]);
        kept.is_some_and(|kept| stage.road.beside_m(&kept, centre.position) > ASIDE_M)
    };
    (hand_over.0 + 1..=last.0).find(|tick| !usual.contains(&acceleration(*tick)) || aside(*tick))
}

fn ttc(stage: &Stage<'_>, car: &Rolling, tick: u32) -> Option<f64> {
    let other = stage.body.grown(&stage.body.centre(car), 0.0);
    let relative_mps = car.pose.forward() * car.speed_mps - stage.ego_velocity(tick);
    time_to_touch(stage.ego(tick), &other, relative_mps)
}

/// Returns when two bodies touch at constant velocities, in seconds; nothing beyond 4 s.
pub(crate) fn time_to_touch(ego: &OrientedBox, other: &OrientedBox, relative_mps: DVec2) -> Option<f64> {
    let steps = (HORIZON_SECS / STEP_SECS).round() as u32;
    let after = |i: u32| f64::from(i) * STEP_SECS;
    (0..=steps).find(|i| ego.touches(&other.moved(relative_mps * after(*i)))).map(after)
}

#[cfg(test)]
mod tests {
    use ds_scenario::{Family, generate};
    use ds_space::Draws;

    use super::*;
    use crate::MotionModel;

    #[test]
    fn who_leaves_its_place_or_its_acceleration_does_not_go_on_as_before() {
        let (scene, model) = (generate(Family::FreeCurve, 1000), MotionModel::town());
        let stage = Stage::new(&scene, &model, &Draws::from_seed(0, "body"));
        let lane = stage.road.lane_at(&scene.logged_ego(Tick(0)).pose).expect("the ego starts in a lane").lane;
        let ways = stage.road.ways(lane, 0.0, 200.0);
        let since = |from: u32, tick: u32| f64::from(tick.saturating_sub(from));
        for (aside_from, brakes_mps2, leaves_at) in
            [(99, 0.0, None), (40, 0.0, Some(40)), (99, 1.5, Some(31)), (99, 0.5, None)]
        {
            let mut station_m = 5.0;
            let car = |tick: u32| {
                let speed_mps = 8.0 - 0.1 * brakes_mps2 * since(30, tick);
                station_m += 0.1 * speed_mps;
                let left_m = if tick < aside_from { 0.1 } else { 0.6 };
                Rolling { pose: stage.body.rear(&ways[0].pose(station_m, left_m)), speed_mps }
            };
            let states: Vec<Rolling> = (0..=60).map(car).collect();
            let found = leaves(&stage, &states, Tick(20), Tick(60));
            assert_eq!(found, leaves_at, "aside from {aside_from}, braking at {brakes_mps2} m/s²");
        }
    }
}
