//! The intelligent driver model (Treiber, Hennecke and Helbing 2000): acceleration from speed, gap and closing speed.
//!
//! a = a_max·(1 − (v/v0)⁴ − (s*/s)²), s* = s0 + max(0, v·T + v·Δv / (2·√(a_max·b))). Above the desired speed the
//! free term is −b·(1 − (v0/v)^(4·a_max/b)) (the improved model), so that a lower limit ahead brings gentle braking.

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

/// Exponent of the free-road term.
pub(crate) const EXPONENT: f64 = 4.0;

/// Gaps are taken to be at least this long.
const SMALLEST_GAP_M: f64 = 0.05;

impl IdmParameters {
    /// Returns the acceleration of a follower, in metres per second squared.
    #[must_use]
    pub fn acceleration(&self, speed_mps: f64, desired_mps: f64, lead: Option<Lead>) -> f64 {
        let (most, comfortable) = (self.acceleration_mps2, self.deceleration_mps2);
        let free = if speed_mps <= desired_mps {
            most * (1.0 - (speed_mps / desired_mps).powi(EXPONENT as i32))
        } else {
            -comfortable * (1.0 - (desired_mps / speed_mps).powf(4.0 * most / comfortable))
        };
        let interaction = lead.map_or(0.0, |lead| {
            let closing_mps = speed_mps - lead.speed_mps;
            let dynamic_m =
                speed_mps * self.headway_secs + speed_mps * closing_mps / (2.0 * (most * comfortable).sqrt());
            let wanted_m = self.minimum_gap_m + dynamic_m.max(0.0);
            most * (wanted_m / lead.gap_m.max(SMALLEST_GAP_M)).powi(2)
        });
        (free - interaction).clamp(-self.emergency_deceleration_mps2, most)
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
}
