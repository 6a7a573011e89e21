//! Ticks and simulation time. No wall clock: time in an episode is a count.

use std::fmt;
use std::ops::{Add, Sub};

/// The index of a simulated state, 0 being the initial one; one tick lasts the scenario's `dt`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Tick(pub u32);

impl Tick {
    /// Returns the tick `count` later.
    #[must_use]
    pub fn plus(self, count: u32) -> Self {
        Self(self.0 + count)
    }

    /// Returns the tick before, or `None` at tick 0.
    #[must_use]
    pub fn previous(self) -> Option<Self> {
        self.0.checked_sub(1).map(Self)
    }

    /// Returns all ticks from `self` to `last`, both included.
    pub fn to(self, last: Self) -> impl DoubleEndedIterator<Item = Self> + Clone {
        (self.0..=last.0).map(Self)
    }
}

impl fmt::Display for Tick {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// Simulation time since the start of the scenario, in integer nanoseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct SimTime(pub i64);

impl SimTime {
    /// Returns the time of `tick` when one tick lasts `dt`.
    #[must_use]
    pub fn at(tick: Tick, dt: Self) -> Self {
        Self(dt.0 * i64::from(tick.0))
    }

    /// Returns the nearest time to `secs`.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, reason = "as casts saturate, and times are far below the limit")]
    pub fn from_secs(secs: f64) -> Self {
        Self((secs * 1e9).round() as i64)
    }

    /// Returns the time in seconds.
    #[must_use]
    pub fn secs(self) -> f64 {
        self.0 as f64 * 1e-9
    }
}

impl Add for SimTime {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self(self.0 + other.0)
    }
}

impl Sub for SimTime {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self(self.0 - other.0)
    }
}
