//! What pushes a car besides its tyres: drive and brakes within friction, rolling, air, slopes; and the slip of a tyre.

use ds_effect::plant::{Road, Vehicle};

/// Standard gravity, in metres per second squared.
pub const GRAVITY_MPS2: f64 = 9.81;
/// Below this speed nothing rolls, in metres per second.
pub const STANDING_MPS: f64 = 0.05;
/// Side area of wind over frontal drag area; a passenger car's side force is about two and a half times its drag.
const SIDE_WIND: f64 = 2.5;

/// Returns what the road passes on of a drive or brake force, within friction times weight; both in newtons, or both over
/// one mass.
#[inline]
#[must_use]
pub fn held(force: f64, friction: f64, weight: f64) -> f64 {
    let most = friction * weight;
    force.clamp(-most, most)
}

/// Returns the rolling resistance against the direction of travel, over mass, in metres per second squared.
#[inline]
#[must_use]
pub fn rolling_mps2(car: &Vehicle, forward_mps: f64) -> f64 {
    if forward_mps.abs() > STANDING_MPS { car.rolling_mps2.copysign(forward_mps) } else { 0.0 }
}

/// Returns drag against the forward axis and the side force of wind to the left, in newtons, at a heading given as sine
/// and cosine.
#[inline]
#[must_use]
pub fn air_n(car: &Vehicle, road: &Road, forward_mps: f64, sin: f64, cos: f64) -> [f64; 2] {
    if road.wind_x_mps == 0.0 && road.wind_y_mps == 0.0 {
        return [car.drag_n_s2_m2 * forward_mps * forward_mps.abs(), 0.0];
    }
    let along = forward_mps - (cos * road.wind_x_mps + sin * road.wind_y_mps);
    let across = -sin * road.wind_x_mps + cos * road.wind_y_mps;
    let air = (along * along + across * across).sqrt();
    [car.drag_n_s2_m2 * along * air, SIDE_WIND * car.drag_n_s2_m2 * across * air]
}

/// Returns gravity's pull along a slope, in metres per second squared: against travel uphill, to the right where the left
/// side is higher.
#[inline]
#[must_use]
pub fn slope_mps2(slope_rad: f64) -> f64 {
    GRAVITY_MPS2 * slope_rad.sin()
}

/// Returns the slip angle of an axle that steers by an angle and moves across and ahead at speeds in the rig, in radians.
#[inline]
#[must_use]
pub fn slip_rad(steering_rad: f64, across_mps: f64, ahead_mps: f64) -> f64 {
    steering_rad - across_mps.atan2(ahead_mps)
}

#[cfg(test)]
mod tests {
    use ds_world::VehicleParameters;

    use super::*;
    use crate::{IdmParameters, nominal};

    #[test]
    fn by_table() {
        let mut car = nominal(&VehicleParameters::ZOE, &IdmParameters::default()).vehicle;
        (car.drag_n_s2_m2, car.rolling_mps2) = (0.4, 0.1);
        for (speed_mps, drag_n, rolling) in [(20.0, 160.0, 0.1), (-10.0, -40.0, -0.1), (0.04, 0.000_64, 0.0)] {
            let [along, across] = air_n(&car, &Road::default(), speed_mps, 0.6, 0.8);
            assert!((along - drag_n).abs() < 1e-12 && across == 0.0, "{speed_mps} m/s: {along}");
            assert_eq!(rolling_mps2(&car, speed_mps), rolling);
        }
        assert_eq!([held(9.0, 0.5, 10.0), held(-9.0, 0.5, 10.0), held(2.0, 0.5, 10.0)], [5.0, -5.0, 2.0]);
        assert!((slope_mps2(0.1) - 0.979_366).abs() < 1e-6);
    }

    #[test]
    fn a_wind_from_the_left_pushes_to_the_right_and_turns_with_the_heading() {
        let mut car = nominal(&VehicleParameters::ZOE, &IdmParameters::default()).vehicle;
        car.drag_n_s2_m2 = 0.4;
        let to_the_south = Road { wind_y_mps: -6.0, ..Road::default() };
        // Air at 8 m/s ahead and 6 m/s aside moves at 10 m/s over the car.
        let [along, across] = air_n(&car, &to_the_south, 8.0, 0.0, 1.0);
        assert!((along - 32.0).abs() < 1e-12 && (across + 60.0).abs() < 1e-12, "{along} {across}");
        let [along, across] = air_n(&car, &to_the_south, 8.0, 1.0, 0.0);
        assert!((along - 0.4 * 14.0 * 14.0).abs() < 1e-12 && across.abs() < 1e-12, "{along} {across}");
    }
}
