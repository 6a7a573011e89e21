//! What a manoeuvre may not do to the car: limits on its motion, and how much of each a drive leaves.

use std::f64::consts::TAU;

use ds_dynamics::ego::{Instant, ROLL_SECS};
use ds_vehicle::GRAVITY_MPS2;
use serde::{Deserialize, Serialize};

use crate::design::{Design, SECS};
use crate::error::ExperimentError;

/// Speed below which a yaw rate is told as the curvature at that speed, m/s: a car at rest has no way to curve.
const SLOW_MPS: f64 = 1.0;

/// Limits of a manoeuvre.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Envelope {
    /// Largest specific force to either side, m/s².
    pub lateral_mps2: f64,
    /// Least and largest specific force forward, m/s².
    pub along_mps2: [f64; 2],
    /// Least and largest speed, m/s.
    pub speed_mps: [f64; 2],
    /// Largest share of the friction that the tyres are asked for.
    pub tyre_share: f64,
    /// Longest way of a run, m, if that is bounded.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub length_m: Option<f64>,
    /// Largest curvature of the way, 1/m, if that is bounded.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub curvature_per_m: Option<f64>,
    /// Where the car may go, if that is bounded.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub site: Option<Site>,
}

/// A rectangle about the start, along the first heading.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Site {
    /// Least and largest way ahead of the start, m.
    pub ahead_m: [f64; 2],
    /// Least and largest way to the left of it, m.
    pub left_m: [f64; 2],
    /// Heading that every run has to start with, rad, if it is not free.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub heading_rad: Option<f64>,
}

impl Default for Envelope {
    fn default() -> Self {
        Self {
            lateral_mps2: 4.0,
            along_mps2: [-4.0, 2.5],
            speed_mps: [0.0, 45.0],
            tyre_share: 0.6,
            length_m: None,
            curvature_per_m: None,
            site: None,
        }
    }
}

/// How near drives come to one limit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Margin {
    /// The limit.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// Its value.
    pub limit: f64,
    /// The nearest that a drive came to it.
    pub reached: f64,
    /// Distance as a share of the limit's size; negative where it was passed.
    pub left: f64,
}

impl Envelope {
    /// Checks what the types do not say.
    ///
    /// # Errors
    /// If a limit is no number, or no manoeuvre could stay within it.
    pub fn check(&self) -> Result<(), ExperimentError> {
        let wrong = |field, value: String, expected: &str| {
            Err(ExperimentError::Envelope { field, value, expected: expected.to_owned() })
        };
        let positive = |value: f64| value > 0.0 && value.is_finite();
        if !positive(self.lateral_mps2) {
            return wrong("lateral_mps2", self.lateral_mps2.to_string(), "a number above 0");
        }
        if !(positive(-self.along_mps2[0]) && positive(self.along_mps2[1])) {
            return wrong("along_mps2", format!("{:?}", self.along_mps2), "[below 0, above 0]");
        }
        let ([low, high], (slowest, fastest)) = (self.speed_mps, Design::begins_mps());
        if !(low >= 0.0 && low <= fastest && high >= slowest && high > low && high.is_finite()) {
            let text = format!(
                "[0 to {fastest}, more than that and {slowest} or more]: manoeuvres begin at {slowest} to {fastest} m/s"
            );
            return wrong("speed_mps", format!("{:?}", self.speed_mps), &text);
        }
        if !(self.tyre_share > 0.0 && self.tyre_share <= 1.0) {
            return wrong("tyre_share", self.tyre_share.to_string(), "above 0, at most 1");
        }
        let shortest = Design::shortest_m();
        if let Some(length) = self.length_m.filter(|length| !(length.is_finite() && *length >= shortest)) {
            let text = format!("{shortest} or more: {SECS} s at the slowest");
            return wrong("length_m", length.to_string(), &text);
        }
        if let Some(curvature) = self.curvature_per_m.filter(|curvature| !positive(*curvature)) {
            return wrong("curvature_per_m", curvature.to_string(), "a number above 0");
        }
        let Some(site) = self.site else { return Ok(()) };
        for (field, ends) in [("site.ahead_m", site.ahead_m), ("site.left_m", site.left_m)] {
            let [low, high] = ends;
            if !(low <= 0.0 && high >= 0.0 && high > low && ends.iter().all(|end| end.is_finite())) {
                return wrong(field, format!("[{low}, {high}]"), "[0 or less, 0 or more]: the start lies inside");
            }
        }
        let heading = site.heading_rad.filter(|heading| !(-TAU..=TAU).contains(heading));
        heading.map_or(Ok(()), |heading| wrong("site.heading_rad", heading.to_string(), "-2π to 2π"))
    }

    /// Returns what some drives leave of each limit, each with the friction of its road.
    #[must_use]
    pub fn margins<'a>(&self, drives: impl Iterator<Item = (&'a [Instant], f64)>) -> Vec<Margin> {
        let mut reach = Reach::default();
        for (instants, friction) in drives {
            instants.iter().for_each(|instant| reach.take(instant, friction));
            reach.length = reach.length.max(instants.iter().map(|instant| instant.v.abs() * ROLL_SECS).sum());
        }
        let mut found = vec![
            upper("acceleration to the side", "m/s²", self.lateral_mps2, reach.lateral),
            lower("acceleration forward, least", "m/s²", self.along_mps2[0], reach.along[0]),
            upper("acceleration forward, largest", "m/s²", self.along_mps2[1], reach.along[1]),
            upper("speed, largest", "m/s", self.speed_mps[1], reach.speed[1]),
            upper("demand on the tyres", "1", self.tyre_share, reach.tyres),
        ];
        if self.speed_mps[0] > 0.0 {
            found.push(lower("speed, least", "m/s", self.speed_mps[0], reach.speed[0]));
        }
        if let Some(length) = self.length_m {
            found.push(upper("length of the way", "m", length, reach.length));
        }
        if let Some(curvature) = self.curvature_per_m {
            found.push(upper("curvature", "1/m", curvature, reach.curvature));
        }
        if let Some(site) = self.site {
            found.push(lower("way back", "m", site.ahead_m[0], reach.ahead[0]));
            found.push(upper("way ahead", "m", site.ahead_m[1], reach.ahead[1]));
            found.push(lower("way to the right", "m", site.left_m[0], reach.left[0]));
            found.push(upper("way to the left", "m", site.left_m[1], reach.left[1]));
        }
        found
    }
}

/// Tells whether no limit was passed.
#[must_use]
pub(crate) fn holds(margins: &[Margin]) -> bool {
    margins.iter().all(|margin| margin.left >= 0.0)
}

/// Returns the limit that is nearest, or passed by most.
#[must_use]
pub(crate) fn tightest(margins: &[Margin]) -> Option<&Margin> {
    margins.iter().min_by(|a, b| a.left.total_cmp(&b.left))
}

fn margin(name: &str, unit: &str, limit: f64, reached: f64, distance: f64) -> Margin {
    // a limit of nil has no size of its own, that of a curvature is always a small one
    let size = if unit == "1/m" { limit } else { limit.abs().max(1.0) };
    let left = distance / size;
    Margin { name: name.to_owned(), unit: unit.to_owned(), limit, reached, left }
}

fn upper(name: &str, unit: &str, limit: f64, reached: f64) -> Margin {
    margin(name, unit, limit, reached, limit - reached)
}

fn lower(name: &str, unit: &str, limit: f64, reached: f64) -> Margin {
    margin(name, unit, limit, reached, reached - limit)
}

/// The ends of what drives reach.
struct Reach {
    lateral: f64,
    along: [f64; 2],
    speed: [f64; 2],
    tyres: f64,
    length: f64,
    curvature: f64,
    ahead: [f64; 2],
    left: [f64; 2],
}

impl Default for Reach {
    fn default() -> Self {
        let none = [f64::INFINITY, f64::NEG_INFINITY];
        Self {
            lateral: 0.0,
            along: none,
            speed: none,
            tyres: 0.0,
            length: 0.0,
            curvature: 0.0,
            ahead: none,
            left: none,
        }
    }
}

impl Reach {
    fn take(&mut self, instant: &Instant, friction: f64) {
        let Instant { x, y, v, yaw_rate, ax, ay, .. } = *instant;
        let widen = |ends: &mut [f64; 2], value: f64| *ends = [ends[0].min(value), ends[1].max(value)];
        self.lateral = self.lateral.max(ay.abs());
        self.tyres = self.tyres.max(ax.hypot(ay) / (friction * GRAVITY_MPS2));
        self.curvature = self.curvature.max(yaw_rate.abs() / v.abs().max(SLOW_MPS));
        widen(&mut self.along, ax);
        widen(&mut self.speed, v);
        widen(&mut self.ahead, x);
        widen(&mut self.left, y);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_passed_limit_has_a_negative_margin_and_holds_no_more() {
        let envelope = Envelope {
            site: Some(Site { ahead_m: [-1.0, 100.0], left_m: [-5.0, 5.0], heading_rad: None }),
            // of one instant, at more than 25 m/s, and a circle of 20 m
            length_m: Some(25.0 * ROLL_SECS),
            curvature_per_m: Some(0.05),
            ..Envelope::default()
        };
        let calm = Instant { x: 10.0, v: 12.0, ax: 1.0, ay: -2.0, ..Instant::default() };
        let rows = [
            (calm, 1.0, None),
            (Instant { ay: -4.2, ..calm }, 1.0, Some("acceleration to the side")),
            (Instant { ax: -4.2, ay: 0.0, ..calm }, 1.0, Some("acceleration forward, least")),
            (calm, 0.3, Some("demand on the tyres")),
            (Instant { y: -6.0, ..calm }, 1.0, Some("way to the right")),
            (Instant { yaw_rate: 0.7, ..calm }, 1.0, Some("curvature")),
            (Instant { v: 30.0, ..calm }, 1.0, Some("length of the way")),
        ];
        for (instant, friction, passed) in rows {
            let margins = envelope.margins(std::iter::once((&[instant][..], friction)));
            assert_eq!(holds(&margins), passed.is_none(), "{margins:?}");
            let named = tightest(&margins).filter(|m| m.left < 0.0).map(|m| m.name.as_str());
            assert_eq!(named, passed);
        }
    }

    #[test]
    fn limits_that_no_car_could_keep_are_refused_by_name() {
        let whole = Envelope::default();
        whole.check().expect("the built-in one is sound");
        let rows = [
            (Envelope { lateral_mps2: 0.0, ..whole }, "lateral_mps2"),
            (Envelope { along_mps2: [1.0, 2.0], ..whole }, "along_mps2"),
            (Envelope { along_mps2: [f64::NEG_INFINITY, 2.0], ..whole }, "along_mps2"),
            (Envelope { speed_mps: [0.0, f64::INFINITY], ..whole }, "speed_mps"),
            (Envelope { speed_mps: [0.0, 2.0], ..whole }, "speed_mps"),
            (Envelope { speed_mps: [30.0, 40.0], ..whole }, "speed_mps"),
            (Envelope { tyre_share: 1.4, ..whole }, "tyre_share"),
            (Envelope { length_m: Some(20.0), ..whole }, "length_m"),
            (Envelope { length_m: Some(f64::NAN), ..whole }, "length_m"),
            (Envelope { curvature_per_m: Some(-0.1), ..whole }, "curvature_per_m"),
            (
                Envelope {
                    site: Some(Site { ahead_m: [-5.0, f64::INFINITY], left_m: [-1.0, 1.0], heading_rad: None }),
                    ..whole
                },
                "site.ahead_m",
            ),
            (
                Envelope {
                    site: Some(Site { ahead_m: [-5.0, 9.0], left_m: [-1.0, 1.0], heading_rad: Some(f64::NAN) }),
                    ..whole
                },
                "site.heading_rad",
            ),
            (
                Envelope { site: Some(Site { ahead_m: [5.0, 9.0], left_m: [-1.0, 1.0], heading_rad: None }), ..whole },
                "site.ahead_m",
            ),
        ];
        for (envelope, named) in rows {
            let refused = envelope.check().expect_err(named).to_string();
            assert!(refused.contains(named), "{refused}");
        }
    }
}
