//! Angles in radians, wrapped to [-π, π).

use std::f64::consts::{PI, TAU};

/// Returns `angle_rad` wrapped to [-π, π).
#[must_use]
pub fn wrap(angle_rad: f64) -> f64 {
    let wrapped = (angle_rad + PI).rem_euclid(TAU) - PI;
    if wrapped >= PI { -PI } else { wrapped }
}

/// Returns the signed shortest turn from `from_rad` to `to_rad`, in [-π, π).
#[must_use]
pub fn turn(from_rad: f64, to_rad: f64) -> f64 {
    wrap(to_rad - from_rad)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(input: f64, expected: f64) {
        assert!((wrap(input) - expected).abs() < 1e-12, "wrap({input}) = {}", wrap(input));
    }

    #[test]
    fn wraps_into_half_open_interval() {
        check(0.0, 0.0);
        check(PI, -PI);
        check(-PI, -PI);
        check(3.0 * PI, -PI);
        check(0.5 + 4.0 * TAU, 0.5);
        check(-0.5 - 4.0 * TAU, -0.5);
    }
}
