//! The kinematic bicycle in steps of equal time, forwards and backwards: the rear axle rolls without slip.
//!
//! Within a step acceleration and curvature are constant; the heading of its middle is the direction of the whole step,
//! so that a step back undoes a step forwards but for rounding. World frame, SI units.

use ds_space::{DVec2, PoseSe2, angle};

/// A rolling car: its rear axle and speed.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Rolling {
    /// Ground point under the rear axle and heading, in the world.
    pub pose: PoseSe2,
    /// Speed along the heading, in metres per second, not negative.
    pub speed_mps: f64,
}

/// What moves it during a step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Control {
    /// Acceleration along the heading, in metres per second squared.
    pub acceleration_mps2: f64,
    /// Curvature of its way, left positive, in 1/m.
    pub curvature_pm: f64,
}

impl Rolling {
    /// Returns the state a step later; a car that comes to a stand within the step stays there.
    #[must_use]
    pub fn forwards(&self, control: Control, dt_secs: f64) -> Self {
        let speed_mps = (self.speed_mps + control.acceleration_mps2 * dt_secs).max(0.0);
        let way_m = 0.5 * (self.speed_mps + speed_mps) * dt_secs;
        Self { pose: self.moved(way_m, way_m * control.curvature_pm), speed_mps }
    }

    /// Returns the state a step earlier; the car stood before where it would have rolled backwards.
    #[must_use]
    pub fn backwards(&self, control: Control, dt_secs: f64) -> Self {
        let speed_mps = (self.speed_mps - control.acceleration_mps2 * dt_secs).max(0.0);
        let way_m = 0.5 * (self.speed_mps + speed_mps) * dt_secs;
        Self { pose: self.moved(-way_m, -way_m * control.curvature_pm), speed_mps }
    }

    fn moved(&self, way_m: f64, turn_rad: f64) -> PoseSe2 {
        let direction = DVec2::from_angle(self.pose.heading_rad + 0.5 * turn_rad);
        PoseSe2 {
            position: self.pose.position + direction * way_m,
            heading_rad: angle::wrap(self.pose.heading_rad + turn_rad),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_quarter_of_a_circle_ends_beside_and_ahead() {
        let mut car = Rolling { pose: PoseSe2::default(), speed_mps: 10.0 };
        let steps = 1000;
        let dt_secs = 20.0 * std::f64::consts::FRAC_PI_2 / 10.0 / f64::from(steps);
        for _ in 0..steps {
            car = car.forwards(Control { acceleration_mps2: 0.0, curvature_pm: 0.05 }, dt_secs);
        }
        assert!((car.pose.position - DVec2::new(20.0, 20.0)).length() < 1e-3, "{car:?}");
    }

    #[test]
    fn braking_ends_at_a_stand() {
        let car = Rolling { pose: PoseSe2::default(), speed_mps: 0.3 };
        let car = car.forwards(Control { acceleration_mps2: -5.0, curvature_pm: 0.0 }, 0.1);
        assert_eq!(car.speed_mps, 0.0);
        assert!((car.pose.position.x - 0.015).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn a_step_back_undoes_a_step(v in 1.0..30.0, a in -7.0..3.0, k in -0.2..0.2, h in -3.0..3.0) {
            let car = Rolling { pose: PoseSe2::new(3.0, -4.0, h), speed_mps: v };
            let control = Control { acceleration_mps2: a, curvature_pm: k };
            let back = car.forwards(control, 0.1).backwards(control, 0.1);
            prop_assert!((back.pose.position - car.pose.position).length() < 1e-9);
            prop_assert!((back.speed_mps - car.speed_mps).abs() < 1e-9);
            prop_assert!(angle::turn(back.pose.heading_rad, car.pose.heading_rad).abs() < 1e-9);
        }
    }
}
