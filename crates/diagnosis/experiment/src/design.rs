//! A manoeuvre as nine numbers: how fast it begins, how it is driven and braked, how it sways, which way it points.
//!
//! The numbers plan accelerations; the nominal car's geometry and resistances make commands of them (steady turn of a single
//! track, rolling resistance and drag), so that the envelope bounds the plan. SI units, left and forward positive.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

use ds_diagnosis::meta::Nominal;
use ds_dynamics::ego::{FINE_SECS, Inputs};

/// Length of a manoeuvre, s.
pub(crate) const SECS: f64 = 16.0;
/// Time over which a request comes and goes, s: no step, whose instant a log does not tell.
const RAMP_SECS: f64 = 0.4;
/// Straight ahead at the start, s.
const STRAIGHT_SECS: f64 = 1.0;
/// Slowest planned speed, m/s.
const SLOWEST_MPS: f64 = 2.0;
/// Largest steering angle of the wheels, rad.
const LOCK_RAD: f64 = 0.5;
/// Largest planned acceleration to the side, m/s².
const LATERAL_MPS2: f64 = 3.5;

/// Names of the numbers of a design.
pub const NAMES: [&str; 9] = [
    "speed_mps",
    "drive_mps2",
    "brake_mps2",
    "hold_secs",
    "sway_mps2",
    "first_hz",
    "last_hz",
    "steady_mps2",
    "heading_rad",
];
/// Least and largest value of each.
const RANGES: [(f64, f64); 9] =
    [(3.0, 28.0), (0.0, 2.2), (0.0, 3.5), (1.5, 6.0), (0.0, 3.2), (0.1, 1.5), (0.1, 1.5), (-3.0, 3.0), (-PI, PI)];

/// A manoeuvre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Design([f64; 9]);

/// The library from which a search starts, and the fixed order that it is compared with.
pub const LIBRARY: [(&str, Design); 12] = [
    ("step steer", Design([15.0, 0.0, 0.0, 6.0, 0.0, 0.1, 0.1, 2.0, 0.0])),
    ("sine sweep", Design([15.0, 0.0, 0.0, 6.0, 1.5, 0.2, 1.5, 0.0, 0.0])),
    ("slalom", Design([12.0, 0.0, 0.0, 6.0, 3.0, 0.4, 0.4, 0.0, 0.0])),
    ("brake gently", Design([22.0, 0.2, 1.2, 4.0, 0.0, 0.1, 0.1, 0.0, 0.0])),
    ("brake hard", Design([25.0, 0.4, 3.3, 2.5, 0.0, 0.1, 0.1, 0.0, 0.0])),
    ("pedal steps", Design([12.0, 1.6, 1.4, 2.0, 0.0, 0.1, 0.1, 0.0, 0.0])),
    ("full throttle", Design([6.0, 2.2, 0.0, 6.0, 0.0, 0.1, 0.1, 0.0, 0.0])),
    ("low speed, tight", Design([3.5, 0.0, 0.0, 6.0, 0.0, 0.1, 0.1, 1.6, 0.0])),
    ("circle at rising speed", Design([8.0, 0.8, 0.0, 6.0, 0.0, 0.1, 0.1, 2.8, 0.0])),
    ("straight ahead", Design([20.0, 0.0, 0.0, 6.0, 0.0, 0.1, 0.1, 0.0, 0.0])),
    ("straight ahead, opposite direction", Design([20.0, 0.0, 0.0, 6.0, 0.0, 0.1, 0.1, 0.0, PI])),
    ("brake in a bend", Design([18.0, 0.6, 2.2, 3.0, 0.0, 0.1, 0.1, 2.0, 0.0])),
];

impl Design {
    /// Returns a design by shares of each range; shares beyond 0 and 1 count as those.
    #[must_use]
    pub(crate) fn at(shares: &[f64]) -> Self {
        let of = |k: usize| RANGES[k].0 + (RANGES[k].1 - RANGES[k].0) * shares[k].clamp(0.0, 1.0);
        Self(std::array::from_fn(of))
    }

    /// Returns the shares of each range.
    #[must_use]
    pub(crate) fn shares(&self) -> [f64; 9] {
        std::array::from_fn(|k| (self.0[k] - RANGES[k].0) / (RANGES[k].1 - RANGES[k].0))
    }

    /// Returns the same manoeuvre with its accelerations less by a factor.
    #[must_use]
    pub(crate) fn gentler(&self, factor: f64) -> Self {
        let mut numbers = self.0;
        [1, 2, 4, 7].into_iter().for_each(|k| numbers[k] *= factor);
        Self(numbers)
    }

    /// Returns the same manoeuvre with another heading at its start, rad.
    #[must_use]
    pub(crate) fn pointing(mut self, heading_rad: f64) -> Self {
        self.0[8] = heading_rad;
        self
    }

    /// Returns the slowest and the fastest speed at which a manoeuvre begins, m/s.
    #[must_use]
    pub(crate) fn begins_mps() -> (f64, f64) {
        RANGES[0]
    }

    /// Returns how long the way of a manoeuvre is at the slowest, m.
    #[must_use]
    pub(crate) fn shortest_m() -> f64 {
        SLOWEST_MPS * SECS
    }

    /// Returns its numbers by name.
    #[must_use]
    pub fn numbers(&self) -> BTreeMap<String, f64> {
        NAMES.iter().zip(self.0).map(|(name, value)| ((*name).to_owned(), value)).collect()
    }

    /// Returns the design of some numbers; those that are not named are 0.
    #[must_use]
    pub fn named(numbers: &BTreeMap<String, f64>) -> Self {
        Self(NAMES.map(|name| numbers.get(name).copied().unwrap_or(0.0)))
    }

    /// Returns the heading that it starts with, rad.
    #[must_use]
    pub fn heading_rad(&self) -> f64 {
        self.0[8]
    }

    /// Returns the speed that it starts with, m/s.
    #[must_use]
    pub fn speed_mps(&self) -> f64 {
        self.0[0]
    }

    /// Returns the commands for a nominal car on the fine grid, with the planned speed.
    #[must_use]
    pub fn inputs(&self, nominal: &Nominal) -> Inputs {
        let base = nominal.lf + nominal.lr;
        let (front, rear) = (nominal.cornering_stiffness_front, nominal.cornering_stiffness_rear);
        let understeer = nominal.mass * (nominal.lr * rear - nominal.lf * front) / (front * rear * base);
        let count = (SECS / FINE_SECS).round() as usize + 1;
        let mut inputs = Inputs {
            start_secs: 0.0,
            steer: Vec::with_capacity(count),
            accel: Vec::with_capacity(count),
            speed: Vec::with_capacity(count),
            brake_work: Vec::with_capacity(count),
        };
        let (mut speed, mut work) = (self.0[0], 0.0);
        for k in 0..count {
            let secs = k as f64 * FINE_SECS;
            let near = ((speed - SLOWEST_MPS) / 1.5).clamp(0.0, 1.0);
            let wish = self.along(secs);
            let along = if wish < 0.0 { wish * near } else { wish };
            let accel = along + nominal.rolling_decel + nominal.drag_decel_per_v2 * speed * speed;
            let turn = self.across(secs) / speed.powi(2) * (base + understeer * speed * speed);
            work += (-accel).max(0.0) * nominal.mass * speed * FINE_SECS * 1e-6;
            inputs.steer.push(turn.clamp(-LOCK_RAD, LOCK_RAD));
            inputs.accel.push(accel);
            inputs.speed.push(speed);
            inputs.brake_work.push(work);
            speed = (speed + FINE_SECS * along).max(SLOWEST_MPS);
        }
        inputs
    }

    /// Returns the planned acceleration forward at a time, m/s².
    fn along(&self, secs: f64) -> f64 {
        let [_, drive, brake, hold, ..] = self.0;
        let since = secs - STRAIGHT_SECS;
        if since < 0.0 {
            return 0.0;
        }
        let place = since % (2.0 * hold);
        let (level, into) = if place < hold { (drive, place) } else { (-brake, place - hold) };
        let share = (into / RAMP_SECS).min((hold - into) / RAMP_SECS).clamp(0.0, 1.0);
        level * share * ((SECS - secs) / RAMP_SECS).clamp(0.0, 1.0)
    }

    /// Returns the planned acceleration to the left at a time, m/s².
    fn across(&self, secs: f64) -> f64 {
        let [_, _, _, _, sway, first, last, steady, _] = self.0;
        let since = secs - STRAIGHT_SECS;
        if since < 0.0 {
            return 0.0;
        }
        let turned = first * since + 0.5 * (last - first) * since * since / (SECS - STRAIGHT_SECS);
        let share = (since / (2.0 * RAMP_SECS)).min((SECS - secs) / (2.0 * RAMP_SECS)).clamp(0.0, 1.0);
        let less = (LATERAL_MPS2 / (sway + steady.abs()).max(1e-9)).min(1.0);
        share * less * (sway * (TAU * turned).sin() + steady)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_library_lies_in_the_ranges_and_plans_finite_commands() {
        let nominal = ds_dynamics::synthetic::nominal();
        for (name, design) in LIBRARY {
            assert_eq!(Design::at(&design.shares()).numbers().len(), NAMES.len());
            assert!(design.shares().iter().all(|share| (-1e-9..=1.0 + 1e-9).contains(share)), "{name}");
            let inputs = design.inputs(&nominal);
            assert_eq!(inputs.steer.len(), 1601);
            assert!(inputs.speed.iter().all(|v| (SLOWEST_MPS..60.0).contains(v)), "{name}");
            assert!(inputs.steer.iter().all(|s| s.abs() <= LOCK_RAD), "{name}");
            // no step: a change within a sample that a log could not place
            let change = inputs.accel.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
            assert!(change < 0.2, "{name}: {change}");
        }
    }
}
