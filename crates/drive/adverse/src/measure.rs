//! What is recorded of a variant along the logged drive: when it threatens, how close it comes, how hard it meets.

use ds_space::plane::OrientedBox;
use ds_space::{DVec2, Tick};
use ds_vehicle::Rolling;

use crate::stage::{Stage, gap_m};
use crate::validity::Met;

/// Times to collision beyond this are not looked for, in seconds.
const HORIZON_SECS: f64 = 4.0;
const STEP_SECS: f64 = 0.1;

/// Numbers of a variant, all along the logged drive of the ego.
#[derive(Debug, Clone, PartialEq)]
pub struct Measures {
    /// The first tick from hand-over on at which the time to collision falls below 4 s, at the latest the contact.
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
    let first = ttc_secs.iter().position(Option::is_some).map_or(met.tick.0, |i| hand_over.0 + i as u32);
    let threat = first.min(met.tick.0);
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
