//! The intelligent driver model (Treiber, Hennecke and Helbing 2000): acceleration from speed, gap and closing speed.
//!
//! a = a_max·(1 − (v/v0)^δ − (s*/s)²), s* = s0 + max(0, v·T + v·Δv / (2·√(a_max·b))). In the improved model the free term
//! above the desired speed is −(b/a_max)·(1 − (v0/v)^(δ·a_max/b)), so that a lower limit ahead brings gentle braking.
//! Reaction times and lags of the drive are the integrator's.

use ds_effect::plant::Follower;

/// How reactive agents drive. The defaults are those of NAVSIM's reactive traffic.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IdmParameters {
    /// Desired speed in metres per second; `None`: an agent's highest logged speed within 20 m along its path, at
    /// least 3 m/s.
    pub desired_speed_mps: Option<f64>,
    /// Gap s0 kept at a stand, bumper to bumper, in metres.
    pub minimum_gap_m: f64,
    /// Time headway T, in seconds.
    pub headway_secs: f64,
    /// Largest acceleration a_max, in metres per second squared.
    pub acceleration_mps2: f64,
    /// Comfortable deceleration b (positive), in metres per second squared.
    pub deceleration_mps2: f64,
    /// Largest deceleration (positive), in metres per second squared.
    pub emergency_deceleration_mps2: f64,
}

impl Default for IdmParameters {
    fn default() -> Self {
        Self {
            desired_speed_mps: None,
            minimum_gap_m: 1.0,
            headway_secs: 1.5,
            acceleration_mps2: 1.0,
            deceleration_mps2: 2.0,
            emergency_deceleration_mps2: 8.0,
        }
    }
}

/// What a follower has ahead.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lead {
    /// Bumper to bumper, in metres; negative when overlapping.
    pub gap_m: f64,
    /// Its speed along the follower's path.
    pub speed_mps: f64,
}

/// Exponent of the free-road term in traffic.
pub(crate) const EXPONENT: i32 = 4;

/// Which form of the model is meant: what published variants leave open.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Form {
    /// Exponent of the free-road term.
    pub exponent: Exponent,
    /// What a driver does above the desired speed.
    pub above: Above,
    /// What the wanted gap is at least, behind a leader that draws away.
    pub shortest: Shortest,
    /// Gaps are taken to be at least this long, in metres.
    pub closest_m: f64,
}

/// An exponent; the two ways of raising to it differ in the last digits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Exponent {
    /// By multiplication.
    Whole(i32),
    /// By logarithms: for one that is fitted.
    Real(f64),
}

/// The free-road term above the desired speed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Above {
    /// As published in 2000: the same power as below.
    Original,
    /// At most comfortable braking.
    Improved,
}

/// The least that the wanted gap comes to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shortest {
    /// That kept at a stand.
    AtStand,
    /// Nothing.
    Nothing,
}

impl Form {
    /// That of simulated traffic.
    pub const TRAFFIC: Self = Self {
        exponent: Exponent::Whole(EXPONENT),
        above: Above::Improved,
        shortest: Shortest::AtStand,
        closest_m: 0.05,
    };
}

impl Exponent {
    fn value(self) -> f64 {
        match self {
            Self::Whole(exponent) => f64::from(exponent),
            Self::Real(exponent) => exponent,
        }
    }

    fn raise(self, base: f64) -> f64 {
        match self {
            Self::Whole(exponent) => base.powi(exponent),
            Self::Real(exponent) => base.powf(exponent),
        }
    }
}

impl IdmParameters {
    /// Returns these parameters with what a plant says of its following drivers.
    #[must_use]
    pub fn driven_by(self, driver: &Follower) -> Self {
        Self {
            headway_secs: driver.headway_secs,
            minimum_gap_m: driver.min_gap_m,
            acceleration_mps2: driver.max_accel_mps2,
            deceleration_mps2: driver.comfort_decel_mps2,
            ..self
        }
    }

    /// Returns the acceleration of a follower in simulated traffic, in metres per second squared.
    #[must_use]
    pub fn acceleration(&self, speed_mps: f64, desired_mps: f64, lead: Option<Lead>) -> f64 {
        self.acceleration_by(&Form::TRAFFIC, speed_mps, desired_mps, lead)
    }

    /// Returns the acceleration of a follower by a form of the model, in metres per second squared.
    #[inline]
    #[must_use]
    pub fn acceleration_by(&self, form: &Form, speed_mps: f64, desired_mps: f64, lead: Option<Lead>) -> f64 {
        let (most, comfortable) = (self.acceleration_mps2, self.deceleration_mps2);
        let free = if speed_mps > desired_mps && form.above == Above::Improved {
            let exponent = form.exponent.value() * most / comfortable;
            -(comfortable / most) * (1.0 - (desired_mps / speed_mps).powf(exponent))
        } else {
            1.0 - form.exponent.raise(speed_mps / desired_mps)
        };
        let interaction = lead.map_or(0.0, |lead| {
            let closing_mps = speed_mps - lead.speed_mps;
            let dynamic_m =
                speed_mps * self.headway_secs + speed_mps * closing_mps / (2.0 * (most * comfortable).sqrt());
            let wanted_m = match form.shortest {
                Shortest::AtStand => self.minimum_gap_m + dynamic_m.max(0.0),
                Shortest::Nothing => (self.minimum_gap_m + dynamic_m).max(0.0),
            };
            (wanted_m / lead.gap_m.max(form.closest_m)).powi(2)
        });
        (most * (free - interaction)).max(-self.emergency_deceleration_mps2).min(most)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn follows_at_the_equilibrium_gap() {
        let idm = IdmParameters::default();
        for lead_mps in [0.0, 3.0, 8.0, 12.0] {
            let (mut speed_mps, mut gap_m, dt) = (10.0_f64, 60.0, 0.1);
            for _ in 0..6000 {
                let acceleration = idm.acceleration(speed_mps, 15.0, Some(Lead { gap_m, speed_mps: lead_mps }));
                let next = (speed_mps + acceleration * dt).max(0.0);
                gap_m += (lead_mps - 0.5 * (speed_mps + next)) * dt;
                speed_mps = next;
                assert!(gap_m > 0.0, "drove into the leader at {lead_mps} m/s");
            }
            let expected = (1.0 + 1.5 * lead_mps) / (1.0 - (lead_mps / 15.0_f64).powi(4)).sqrt();
            assert!((gap_m - expected).abs() < 0.05 * expected, "{lead_mps} m/s: {gap_m} m, expected {expected} m");
        }
    }

    #[test]
    fn table_of_accelerations() {
        let idm = IdmParameters::default();
        // Free road: standing, at the desired speed, at twice that (-2 · (1 - 0.5²)).
        for (speed_mps, expected) in [(0.0, 1.0), (10.0, 0.0), (20.0, -1.5)] {
            assert!((idm.acceleration(speed_mps, 10.0, None) - expected).abs() < 1e-12, "{speed_mps} m/s");
        }
        // 5 m/s, gap 10 m, leader at 5 m/s: s* = 1 + 7.5; a = 1 - 1/16 - 0.7225.
        let lead = Lead { gap_m: 10.0, speed_mps: 5.0 };
        assert!((idm.acceleration(5.0, 10.0, Some(lead)) - 0.215).abs() < 1e-12);
        let overlapping = Lead { gap_m: -1.0, speed_mps: 0.0 };
        assert_eq!(idm.acceleration(5.0, 10.0, Some(overlapping)), -8.0);
    }

    #[test]
    fn forms_differ_above_the_desired_speed_and_behind_a_leader_that_draws_away() {
        let idm = IdmParameters::default();
        let original = Form { above: Above::Original, ..Form::TRAFFIC };
        let fitted = Form { exponent: Exponent::Real(4.0), ..original };
        for lead in [None, Some(Lead { gap_m: 10.0, speed_mps: 5.0 })] {
            for speed_mps in [0.0, 3.3, 7.7, 9.9] {
                let expected = idm.acceleration(speed_mps, 10.0, lead);
                for form in [original, fitted] {
                    let got = idm.acceleration_by(&form, speed_mps, 10.0, lead);
                    assert!((got - expected).abs() < 1e-14, "{form:?} at {speed_mps} m/s: {got}, {expected}");
                }
            }
        }
        // Twice the desired speed: the published power asks for 1 - 2⁴, emergency braking; the improved model for -1.5.
        assert_eq!(idm.acceleration_by(&original, 20.0, 10.0, None), -8.0);
        assert!((idm.acceleration(20.0, 10.0, None) + 1.5).abs() < 1e-12);
        // 5 m/s, gap 2 m, leader at 10 m/s: 7.5 - 8.84 m more than the 1 m at a stand, so 1 m or nothing.
        let away = Some(Lead { gap_m: 2.0, speed_mps: 10.0 });
        assert!((idm.acceleration(5.0, 10.0, away) - (1.0 - 0.0625 - 0.25)).abs() < 1e-12);
        let nothing = Form { shortest: Shortest::Nothing, ..Form::TRAFFIC };
        assert!((idm.acceleration_by(&nothing, 5.0, 10.0, away) - (1.0 - 0.0625)).abs() < 1e-12);
    }
}
