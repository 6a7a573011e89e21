//! What an adversary's car can do, and whether a drive keeps to it.

use ds_vehicle::{Control, Rolling};

/// The limits of a drive, SI units.
pub(crate) struct Limits;

impl Limits {
    pub(crate) const BRAKING_MPS2: f64 = -7.6;
    pub(crate) const ACCELERATION_MPS2: f64 = 3.0;
    pub(crate) const LATERAL_MPS2: f64 = 4.0;
    pub(crate) const TOTAL_MPS2: f64 = 8.0;
    pub(crate) const JERK_MPS3: f64 = 12.65;
    pub(crate) const CURVATURE_PM: f64 = 0.2;
    pub(crate) const STEERING_RADPS: f64 = 0.8;
    /// Of the speed limit of the lane.
    pub(crate) const SPEEDING: f64 = 1.3;
}

/// Returns the curvature nearest to a wish that the car can take a tick after another one.
pub(crate) fn steered(before_pm: f64, wish_pm: f64, speed_mps: f64, wheel_base_m: f64, dt_secs: f64) -> f64 {
    let most_pm = (0.95 * Limits::CURVATURE_PM).min(0.9 * Limits::LATERAL_MPS2 / speed_mps.max(1.0).powi(2));
    let angle = |curvature_pm: f64| (wheel_base_m * curvature_pm).atan();
    let most_rad = 0.85 * Limits::STEERING_RADPS * dt_secs;
    let wish_rad = angle(wish_pm.clamp(-most_pm, most_pm));
    let before_rad = angle(before_pm);
    (before_rad + (wish_rad - before_rad).clamp(-most_rad, most_rad)).tan() / wheel_base_m
}

/// Returns the first tick at which a drive goes beyond the limits, with what and its value.
pub(crate) fn beyond(
    states: &[Rolling],
    controls: &[Control],
    wheel_base_m: f64,
    dt_secs: f64,
    most_mps: &dyn Fn(&Rolling) -> f64,
) -> Option<(usize, &'static str, f64)> {
    for (tick, control) in controls.iter().enumerate() {
        let (car, next) = (&states[tick], &states[tick + 1]);
        let mean_mps = 0.5 * (car.speed_mps + next.speed_mps);
        let lateral_mps2 = mean_mps * mean_mps * control.curvature_pm;
        let a = control.acceleration_mps2;
        let before = if tick == 0 { control } else { &controls[tick - 1] };
        let jerk = (a - before.acceleration_mps2).abs() / dt_secs;
        let steering = ((wheel_base_m * control.curvature_pm).atan() - (wheel_base_m * before.curvature_pm).atan())
            .abs()
            / dt_secs;
        let slack = 1.0 + 1e-6;
        let checks = [
            ("speed", next.speed_mps, most_mps(next)),
            ("acceleration", a, Limits::ACCELERATION_MPS2),
            ("braking", -a, -Limits::BRAKING_MPS2),
            ("lateral acceleration", lateral_mps2.abs(), Limits::LATERAL_MPS2),
            ("total acceleration", a.hypot(lateral_mps2), Limits::TOTAL_MPS2),
            // A car that has come to a stand stops braking at once.
            ("jerk", if next.speed_mps < 0.3 { 0.0 } else { jerk }, Limits::JERK_MPS3),
            ("curvature", control.curvature_pm.abs(), Limits::CURVATURE_PM),
            ("steering rate", steering, Limits::STEERING_RADPS),
        ];
        if let Some((what, value, _)) = checks.into_iter().find(|(_, value, most)| *value > most * slack) {
            return Some((tick, what, value));
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use ds_space::PoseSe2;

    fn check(controls: &[Control], speed_mps: f64, expected: Option<&str>) {
        let mut states = vec![Rolling { pose: PoseSe2::default(), speed_mps }];
        for control in controls {
            states.push(states[states.len() - 1].forwards(*control, 0.1));
        }
        let got = beyond(&states, controls, 2.8, 0.1, &|_| 20.0);
        assert_eq!(got.map(|(_, what, _)| what), expected, "{got:?}");
    }

    #[test]
    fn each_limit_is_named() {
        let control = |acceleration_mps2, curvature_pm| Control { acceleration_mps2, curvature_pm };
        check(&[control(0.0, 0.0); 5], 10.0, None);
        check(&[control(0.5, 0.0)], 20.0, Some("speed"));
        check(&[control(3.1, 0.0)], 10.0, Some("acceleration"));
        check(&[control(-7.7, 0.0)], 10.0, Some("braking"));
        check(&[control(0.0, 0.05)], 10.0, Some("lateral acceleration"));
        check(&[control(-7.5, 0.035)], 10.0, Some("total acceleration"));
        check(&[control(0.0, 0.0), control(1.3, 0.0)], 10.0, Some("jerk"));
        check(&[control(0.0, 0.21)], 2.0, Some("curvature"));
        check(&[control(0.0, 0.0), control(0.0, 0.03)], 5.0, Some("steering rate"));
    }

    #[test]
    fn steering_stays_within_its_rate_and_the_curve() {
        assert!((steered(0.0, 0.01, 10.0, 2.8, 0.1) - 0.01).abs() < 1e-12);
        assert!(steered(0.0, 1.0, 3.0, 2.8, 0.1) < 0.025);
        assert!(steered(0.036, 1.0, 10.0, 2.8, 0.1) <= 0.036 + 1e-12);
    }
}
