//! The law against closed forms, its table against the law, loads against statics.

use ds_effect::plant::FrictionCircle;
use ds_world::VehicleParameters;

use super::*;
use crate::{IdmParameters, nominal};

const AXLE: Axle = Axle { stiffness_n: 8e4, limit_n: 6e3 };

fn car() -> Vehicle {
    nominal(&VehicleParameters::ZOE, &IdmParameters::default()).vehicle
}

#[test]
fn the_law_is_linear_at_first_and_ends_at_friction() {
    for knee in [1.0, 2.0, 4.0, f64::INFINITY] {
        let small = AXLE.tyre(1e-9, knee);
        assert!((small.force_n / 8e-5 - 1.0).abs() < 1e-6 && (small.tangent_n / 8e4 - 1.0).abs() < 1e-6, "{knee}");
        let large = AXLE.tyre(-1e6, knee);
        assert!((large.force_n / -6e3 - 1.0).abs() < 1e-6 && large.tangent_n.abs() < 1e-3, "{knee}: {large:?}");
    }
    // Worked out by hand at the limit: (1 + 1)^(-1/2), and its derivative 2^(-3/2).
    let there = AXLE.tyre(6e3 / 8e4, 2.0);
    assert!((there.force_n / 6e3 - 0.5_f64.sqrt()).abs() < 1e-12);
    assert!((there.tangent_n / 8e4 - 0.5 * 0.5_f64.sqrt()).abs() < 1e-12);
}

#[test]
fn the_tangent_is_the_derivative() {
    for knee in [1.5, 2.0, 4.0] {
        for k in -40..=40 {
            let slip_rad = 0.01 * f64::from(k) + 1e-3;
            let [below, above] = [-1e-7, 1e-7].map(|h| AXLE.tyre(slip_rad + h, knee).force_n);
            let tangent_n = AXLE.tyre(slip_rad, knee).tangent_n;
            assert!(((above - below) / 2e-7 - tangent_n).abs() < 1.0, "{knee} at {slip_rad}");
        }
    }
}

#[test]
fn the_table_is_the_law() {
    for (knee, largest) in [(1.0, 1e-4), (2.0, 1e-4), (4.0, 2e-4), (f64::INFINITY, 4e-3)] {
        let saturation = Saturation::new(knee);
        for k in 0..=1000 {
            let slip_rad = 0.0005 * f64::from(k);
            let difference_n = AXLE.secant_n(slip_rad, &saturation) * slip_rad - AXLE.tyre(slip_rad, knee).force_n;
            assert!((difference_n / 6e3).abs() <= largest, "{knee} at {slip_rad}: {difference_n} N");
        }
    }
}

#[test]
fn loads_follow_statics_and_drive() {
    let mut car = Vehicle { front_arm_m: 1.0, rear_arm_m: 1.5, mass_kg: 1000.0, friction: 0.8, ..car() };
    car.nominal_mass_kg = 1000.0;
    let [front, rear] = axles(&car, 0.0);
    assert!((front.limit_n - 0.8 * 5886.0).abs() < 1e-9 && (rear.limit_n - 0.8 * 3924.0).abs() < 1e-9);
    // 2 m/s² at 0.5 m over 2.5 m shift 400 N to the rear.
    car.load_height_m = 0.5;
    let [front, rear] = axles(&car, 2.0);
    assert!((front.limit_n - 0.8 * 5486.0).abs() < 1e-9 && (rear.limit_n - 0.8 * 4324.0).abs() < 1e-9);
    assert!((front.stiffness_n / car.front_stiffness_n - 5486.0 / 5886.0).abs() < 1e-12);
    car.load_height_m = 1e6;
    let [front, rear] = axles(&car, 2.0);
    assert!((front.limit_n / 4708.8 - 0.3).abs() < 1e-9 && (rear.limit_n / 3139.2 - 1.7).abs() < 1e-9);
}

#[test]
fn what_brakes_take_beyond_friction_is_not_there_to_take() {
    let car = Vehicle { friction_circle: Some(FrictionCircle::default()), friction: 0.3, ..car() };
    let (at_friction, beyond) = (axles(&car, -0.3 * GRAVITY_MPS2), axles(&car, -8.0));
    for (at_friction, beyond) in at_friction.iter().zip(beyond) {
        assert!((at_friction.limit_n - beyond.limit_n).abs() < 1e-6, "{at_friction:?} {beyond:?}");
    }
}

#[test]
fn slip_builds_up_over_the_relaxation_length() {
    assert_eq!(built_share(0.0, 10.0, 0.1), 1.0);
    assert!((built_share(0.5, 10.0, 0.05) - (1.0 - (-1.0_f64).exp())).abs() < 1e-12);
}
