//! HC and EC of a state, from the executed motion (BS `:758-822`, or the features of `scoring.md` §5).

use std::collections::VecDeque;

use ds_space::DVec2;
use ds_space::angle::turn;

use super::moment::Moment;
use super::profile::{LoopComfortRule, Profile};
use crate::comfort::{ComfortFilters, ComfortRule, ComfortSeries};
use crate::constants::bridgesim::{ACCELERATION, JERK, STOPPED_MPS, YAW_RATE};
use crate::constants::extended_comfort as change;
use crate::constants::strict::COMFORT_STATES;
use crate::error::ScoreError;
use crate::motion::VehicleState;

/// The motion of the state before.
#[derive(Debug, Clone, Copy)]
struct Last {
    velocity_mps: DVec2,
    heading_rad: f64,
    rates: Rates,
}

/// How the motion changes, sizes only.
#[derive(Debug, Clone, Copy, Default)]
struct Rates {
    acceleration_mps2: f64,
    jerk_mps3: f64,
    yaw_rate_radps: f64,
}

/// The history that comfort is judged by.
#[derive(Debug, Clone)]
pub(crate) struct Comfort {
    last: Option<Last>,
    seen: u32,
    states: VecDeque<VehicleState>,
    filters: ComfortFilters,
    memory: ComfortSeries,
    rear_axle_to_centre_m: f64,
}

impl Comfort {
    pub(crate) fn new(dt_s: f64, rear_axle_to_centre_m: f64) -> Result<Self, ScoreError> {
        Ok(Self {
            last: None,
            seen: 0,
            states: VecDeque::with_capacity(COMFORT_STATES + 1),
            filters: ComfortFilters::with_dt(COMFORT_STATES, ComfortRule::Centre, dt_s)?,
            memory: ComfortSeries::default(),
            rear_axle_to_centre_m,
        })
    }

    /// Returns HC and EC of the next state; `None` where there is too little history, if the profile wants any.
    pub(crate) fn observe(&mut self, moment: &Moment<'_>, profile: &Profile) -> (Option<f64>, Option<f64>) {
        let before = self.last.map(|last| last.rates);
        let rates = self.rates(moment);
        let ego = &moment.state.ego;
        self.last = Some(Last { velocity_mps: ego.velocity_mps, heading_rad: ego.centre.heading_rad, rates });
        self.seen += 1;
        let extended = before.map(|before| super::unless(rates.leaps(&before)));
        match profile.comfort {
            LoopComfortRule::Differences => (Some(super::unless(rates.exceed())), Some(extended.unwrap_or(1.0))),
            // The first two states have no acceleration or jerk of their own to be compared.
            LoopComfortRule::Filtered => (self.filtered(moment), extended.filter(|_| self.seen > 3)),
        }
    }

    fn rates(&self, moment: &Moment<'_>) -> Rates {
        let Some(last) = self.last.filter(|_| moment.speed_mps >= STOPPED_MPS) else { return Rates::default() };
        let (ego, dt_s) = (&moment.state.ego, moment.around.dt_s);
        let acceleration_mps2 = ((ego.velocity_mps - last.velocity_mps) / dt_s).length();
        Rates {
            acceleration_mps2,
            jerk_mps3: (acceleration_mps2 - last.rates.acceleration_mps2).abs() / dt_s,
            yaw_rate_radps: turn(last.heading_rad, ego.centre.heading_rad).abs() / dt_s,
        }
    }

    fn filtered(&mut self, moment: &Moment<'_>) -> Option<f64> {
        let mut state = moment.state.ego.state?;
        if let Some(last) = self.states.back() {
            state.yaw_acceleration_radps2 = (state.yaw_rate_radps - last.yaw_rate_radps) / moment.around.dt_s;
        }
        self.states.push_back(state);
        if self.states.len() > COMFORT_STATES {
            self.states.pop_front();
        }
        let full = self.states.len() == COMFORT_STATES;
        full.then(|| {
            let within =
                self.filters.within(self.states.make_contiguous(), self.rear_axle_to_centre_m, &mut self.memory);
            super::unless(within.contains(&false))
        })
    }
}

impl Rates {
    fn exceed(&self) -> bool {
        self.acceleration_mps2 > ACCELERATION || self.jerk_mps3 > JERK || self.yaw_rate_radps > YAW_RATE
    }

    fn leaps(&self, before: &Self) -> bool {
        (self.acceleration_mps2 - before.acceleration_mps2).abs() > change::ACCELERATION
            || (self.jerk_mps3 - before.jerk_mps3).abs() > change::JERK
            || (self.yaw_rate_radps - before.yaw_rate_radps).abs() > change::YAW_RATE
    }
}
