//! Comfort features of a series of states and whether they stay within their limits (`scoring.md` §5).
//!
//! Six series, each filtered as the references do it, at 10 Hz. The shift from the rear axle to the centre adds
//! displacement·(ω² + α) to the longitudinal acceleration, a quirk of the reference; the lateral one gets nothing.

use std::sync::LazyLock;

use crate::constants::comfort::{
    ACCELERATION_WINDOW, HEADING_WINDOW, JERK_MAGNITUDE, JERK_WINDOW, LAT_ACCELERATION, LON_ACCELERATION, LON_JERK,
    PAST_TENTHS, YAW_ACCELERATION, YAW_RATE,
};
use crate::constants::horizon::{DT_S, STATES};
use crate::error::ScoreError;
use crate::motion::VehicleState;
use crate::smoothing::{Smoother, round, unwrap};

/// How many features there are.
pub const FEATURES: usize = 6;
/// The names of the features, in order.
pub const FEATURE_NAMES: [&str; FEATURES] =
    ["lon_acceleration", "lat_acceleration", "jerk_magnitude", "lon_jerk", "yaw_acceleration", "yaw_rate"];
/// The fewest states that can be filtered: a cubic needs four.
pub const FEWEST_STATES: usize = 4;

const LIMITS: [(f64, f64); FEATURES] = [
    LON_ACCELERATION,
    (-LAT_ACCELERATION, LAT_ACCELERATION),
    (-JERK_MAGNITUDE, JERK_MAGNITUDE),
    (-LON_JERK, LON_JERK),
    (-YAW_ACCELERATION, YAW_ACCELERATION),
    (-YAW_RATE, YAW_RATE),
];

/// The filtered series, in the order of [`FEATURE_NAMES`]; SI units.
pub type Features = [Vec<f64>; FEATURES];

/// Which of the six features stay within their limits.
pub type Within = [bool; FEATURES];

/// Which filters and which acceleration are used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ComfortRule {
    /// HC of v2: acceleration of the centre, short windows.
    Centre,
    /// C of v1: acceleration of the rear axle, windows as long as the series.
    RearAxle,
}

/// The filters for series of one length.
#[derive(Debug, Clone)]
pub struct ComfortFilters {
    states: usize,
    rule: ComfortRule,
    /// Smooths accelerations before they are differentiated.
    smooth: Smoother,
    /// Smooths accelerations that are tested themselves.
    acceleration: Smoother,
    jerk: Smoother,
    yaw_rate: Smoother,
    yaw_acceleration: Smoother,
}

/// The filters that every plan needs; they are the same in all scenes.
#[derive(Debug)]
pub(crate) struct StandardFilters {
    /// 41 executed states under v2.
    pub(crate) executed: ComfortFilters,
    /// The same after the past that HC looks at.
    pub(crate) history: ComfortFilters,
    /// 41 executed states under v1.
    pub(crate) executed_v1: ComfortFilters,
}

impl StandardFilters {
    /// Returns the filters, made at first use.
    pub(crate) fn get() -> &'static Self {
        static FILTERS: LazyLock<StandardFilters> = LazyLock::new(|| StandardFilters {
            executed: ComfortFilters::made(STATES, ComfortRule::Centre, DT_S),
            history: ComfortFilters::made(PAST_TENTHS.count() + STATES, ComfortRule::Centre, DT_S),
            executed_v1: ComfortFilters::made(STATES, ComfortRule::RearAxle, DT_S),
        });
        &FILTERS
    }
}

/// Memory for the features of one series, reused from series to series.
#[derive(Debug, Clone, Default)]
pub struct ComfortSeries {
    features: Features,
    raw: Vec<f64>,
    smooth: Vec<f64>,
}

impl ComfortFilters {
    /// Prepares filters for series of this many states, 0.1 s apart.
    ///
    /// # Errors
    /// [`ScoreError::TooFewStates`] below [`FEWEST_STATES`].
    pub fn new(states: usize, rule: ComfortRule) -> Result<Self, ScoreError> {
        Self::with_dt(states, rule, DT_S)
    }

    /// As [`Self::new`], for states `dt_s` seconds apart.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_dt(states: usize, rule: ComfortRule, dt_s: f64) -> Result<Self, ScoreError> {
        if states < FEWEST_STATES {
            return Err(ScoreError::TooFewStates { what: "comfort series", found: states, needed: FEWEST_STATES });
        }
        Ok(Self::made(states, rule, dt_s))
    }

    /// As [`Self::with_dt`], for a length that is known to be enough.
    fn made(states: usize, rule: ComfortRule, dt_s: f64) -> Self {
        let (acceleration, jerk) = match rule {
            ComfortRule::Centre => (ACCELERATION_WINDOW.min(states), JERK_WINDOW.min(states)),
            ComfortRule::RearAxle => (states, states),
        };
        let heading = HEADING_WINDOW.min(states);
        Self {
            states,
            rule,
            smooth: Smoother::new(ACCELERATION_WINDOW.min(states), 2, 0, dt_s),
            acceleration: Smoother::new(acceleration, 2, 0, dt_s),
            jerk: Smoother::new(jerk, 2, 1, dt_s),
            yaw_rate: Smoother::new(heading, 2, 1, dt_s),
            yaw_acceleration: Smoother::new(heading, 3, 2, dt_s),
        }
    }

    /// Returns the number of states these filters were made for.
    #[must_use]
    pub fn states(&self) -> usize {
        self.states
    }

    /// Computes the features of a series; `displacement_m` leads from the rear axle to the centre.
    ///
    /// # Panics
    /// If the series has another length than the filters were made for.
    pub fn features<'a>(
        &self,
        states: &[VehicleState],
        displacement_m: f64,
        memory: &'a mut ComfortSeries,
    ) -> &'a Features {
        assert_eq!(states.len(), self.states, "filters are made for one length");
        let ComfortSeries { features, raw, smooth } = memory;
        for series in features.iter_mut().chain([&mut *raw, &mut *smooth]) {
            series.resize(self.states, 0.0);
        }
        let [lon_acceleration, lat_acceleration, jerk_magnitude, lon_jerk, yaw_acceleration, yaw_rate] = features;
        for (value, state) in raw.iter_mut().zip(states) {
            let (rate, acceleration) = (state.yaw_rate_radps, state.yaw_acceleration_radps2);
            *value = state.ax_mps2
                + match self.rule {
                    ComfortRule::Centre => displacement_m * (rate * rate + acceleration),
                    ComfortRule::RearAxle => 0.0,
                };
        }
        self.filter(&self.acceleration, raw, lon_acceleration);
        self.filter(&self.smooth, raw, smooth);
        self.filter(&self.jerk, smooth, lon_jerk);
        fill(raw, states, |state| state.ay_mps2);
        self.filter(&self.acceleration, raw, lat_acceleration);
        fill(raw, states, |state| state.ax_mps2.hypot(state.ay_mps2));
        self.filter(&self.smooth, raw, smooth);
        self.filter(&self.jerk, smooth, jerk_magnitude);
        fill(raw, states, |state| state.heading_rad);
        unwrap(raw);
        self.filter(&self.yaw_acceleration, raw, yaw_acceleration);
        self.filter(&self.yaw_rate, raw, yaw_rate);
        features
    }

    fn filter(&self, smoother: &Smoother, series: &[f64], out: &mut [f64]) {
        smoother.filter(series, out);
        round(out);
    }

    /// Says which features of a series stay within their limits at all states.
    pub fn within(&self, states: &[VehicleState], displacement_m: f64, memory: &mut ComfortSeries) -> Within {
        within(self.features(states, displacement_m, memory))
    }
}

fn fill(out: &mut [f64], states: &[VehicleState], column: impl Fn(&VehicleState) -> f64) {
    for (value, state) in out.iter_mut().zip(states) {
        *value = column(state);
    }
}

/// Says which features stay strictly within their limits at all states.
#[must_use]
pub fn within(features: &Features) -> Within {
    let mut result = [true; FEATURES];
    for ((result, series), (low, high)) in result.iter_mut().zip(features).zip(LIMITS) {
        *result = series.iter().all(|value| *value > low && *value < high);
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(rule: ComfortRule, state: impl Fn(f64) -> VehicleState, expected: Within) {
        let states: Vec<VehicleState> = (0..41).map(|step| state(DT_S * f64::from(step))).collect();
        let filters = ComfortFilters::new(41, rule).expect("41 states are enough");
        assert_eq!(filters.within(&states, 1.5, &mut ComfortSeries::default()), expected, "{rule:?}");
    }

    #[test]
    fn limits_by_table() {
        let all = [true; FEATURES];
        let but = |which: &[usize]| std::array::from_fn(|i| !which.contains(&i));
        let at = VehicleState::default();
        for rule in [ComfortRule::Centre, ComfortRule::RearAxle] {
            check(rule, |_| VehicleState { ax_mps2: 2.39, ..at }, all);
            check(rule, |_| VehicleState { ax_mps2: 2.40, ..at }, but(&[0]));
            check(rule, |_| VehicleState { ax_mps2: -4.04, ..at }, all);
            check(rule, |_| VehicleState { ax_mps2: -4.06, ..at }, but(&[0]));
            check(rule, |_| VehicleState { ay_mps2: 4.90, ..at }, but(&[1]));
            // From -3.0 to 2.2 m/s2.
            check(rule, |time_s| VehicleState { ax_mps2: -3.0 + 1.3 * time_s, ..at }, all);
            check(rule, |time_s| VehicleState { heading_rad: 0.96 * time_s, ..at }, but(&[5]));
            check(rule, |time_s| VehicleState { heading_rad: 0.97 * time_s * time_s, ..at }, but(&[4, 5]));
        }
        // Only the centre feels the yaw: 1.5 * (1.3² + 0) = 2.535.
        check(ComfortRule::Centre, |_| VehicleState { yaw_rate_radps: 1.3, ..at }, but(&[0]));
        check(ComfortRule::RearAxle, |_| VehicleState { yaw_rate_radps: 1.3, ..at }, all);
    }

    #[test]
    fn short_series_are_filtered_or_refused() {
        assert!(ComfortFilters::new(3, ComfortRule::Centre).is_err());
        for states in [4, 5, 8, 9, 14, 15, 16] {
            let filters = ComfortFilters::new(states, ComfortRule::Centre).expect("enough");
            let still = vec![VehicleState::default(); states];
            assert_eq!(filters.within(&still, 1.5, &mut ComfortSeries::default()), [true; FEATURES]);
        }
    }
}
