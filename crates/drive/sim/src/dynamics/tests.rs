//! The car against closed forms, limits and any number of sub-steps.

use super::*;

fn body(speed_mps: f64, steering_rad: f64) -> Body {
    let ego = EgoState { velocity_mps: DVec2::new(speed_mps, 0.0), steering_rad, ..EgoState::default() };
    Body { ego, sensed_rad: steering_rad, ..Body::default() }
}

fn chassis(kind: DynamicsKind, substeps: u32) -> Chassis {
    let plant = crate::nominal(&VehicleParameters::ZOE, &crate::IdmParameters::default());
    Chassis::new(VehicleParameters::ZOE, kind, substeps, 0.1, Arc::new(plant), false)
}

/// Holds speed and steering until the motion is steady.
fn steady_yaw_rate(kind: DynamicsKind, speed_mps: f64, steering_rad: f64) -> (f64, f64) {
    let (chassis, mut body) = (chassis(kind, 10), body(speed_mps, steering_rad));
    for _ in 0..80 {
        let acceleration_mps2 = 3.0 * (speed_mps - body.ego.speed_mps());
        chassis.step(&mut body, Command { acceleration_mps2, steering_rate_radps: 0.0 });
    }
    (body.ego.yaw_rate_radps, body.ego.speed_mps())
}

#[test]
fn steady_circles_have_the_analytic_understeer() {
    let wheel_base_m = VehicleParameters::ZOE.wheel_base_m;
    for (speed_mps, steering_rad) in [(5.0, 0.05), (10.0, 0.03), (15.0, -0.02), (25.0, 0.01)] {
        let (yaw_rate, v) = steady_yaw_rate(DynamicsKind::SingleTrack, speed_mps, steering_rad);
        let expected = v * steering_rad / (wheel_base_m + UNDERSTEER_S2_PER_M * v * v);
        assert!((yaw_rate / expected - 1.0).abs() < 0.02, "{speed_mps} m/s: {yaw_rate}, expected {expected}");
        let (yaw_rate, v) = steady_yaw_rate(DynamicsKind::Kinematic, speed_mps, steering_rad);
        assert!((yaw_rate - v * steering_rad.tan() / wheel_base_m).abs() < 1e-9);
    }
}

#[test]
fn lateral_acceleration_stays_within_friction() {
    for speed_mps in [10.0, 20.0, 40.0] {
        let (chassis, mut body) = (chassis(DynamicsKind::SingleTrack, 10), body(speed_mps, 0.0));
        for _ in 0..50 {
            chassis.step(&mut body, Command { acceleration_mps2: 0.0, steering_rate_radps: 5.0 });
            let lateral = body.ego.speed_mps() * body.ego.yaw_rate_radps;
            assert!(body.ego.is_finite() && lateral.abs() < 2.5 * GRAVITY_MPS2, "{:?}", body.ego);
        }
        assert!(body.ego.speed_mps() < speed_mps, "cornering costs speed");
    }
}

#[test]
fn any_number_of_substeps_is_stable() {
    for substeps in [1, 2, 5, 100] {
        for speed_mps in [2.5, 4.0, 8.0, 30.0, 65.0] {
            let (chassis, mut body) = (chassis(DynamicsKind::SingleTrack, substeps), body(speed_mps, 0.01));
            for _ in 0..100 {
                chassis.step(&mut body, Command::default());
            }
            let expected = body.ego.speed_mps() * 0.01 / VehicleParameters::ZOE.wheel_base_m;
            let yaw_rate = body.ego.yaw_rate_radps;
            assert!(yaw_rate > 0.0 && yaw_rate < 1.1 * expected, "{substeps} at {speed_mps} m/s: {yaw_rate}");
        }
    }
}

#[test]
fn brakes_hold_at_a_stand() {
    for kind in [DynamicsKind::SingleTrack, DynamicsKind::Kinematic] {
        let (chassis, mut body) = (chassis(kind, 10), body(6.0, 0.1));
        let mut before = body.ego.pose.position;
        for tick in 0..30 {
            let braking = if body.ego.speed_mps() > 0.0 { -6.0 } else { 0.0 };
            chassis.step(&mut body, Command { acceleration_mps2: braking, steering_rate_radps: 0.0 });
            assert!(body.ego.speed_mps() >= 0.0, "tick {tick}");
            if tick == 20 {
                before = body.ego.pose.position;
            }
        }
        assert_eq!(body.ego.speed_mps(), 0.0);
        assert_eq!(body.ego.pose.position, before);
    }
}

#[test]
fn steering_keeps_its_rate_and_angle_limits() {
    let (chassis, mut body) = (chassis(DynamicsKind::SingleTrack, 10), body(5.0, 0.0));
    for _ in 0..20 {
        let before = body.ego.steering_rad;
        chassis.step(&mut body, Command { acceleration_mps2: 0.0, steering_rate_radps: 9.0 });
        assert!(body.ego.steering_rad - before <= 0.08 + 1e-12 && body.ego.steering_rad <= 0.6);
    }
    assert_eq!(body.ego.steering_rad, 0.6);
}

#[test]
fn a_log_without_steering_gets_it_from_its_yaw_rate() {
    let ego = EgoState { velocity_mps: DVec2::new(10.0, 0.0), yaw_rate_radps: 0.2, ..EgoState::default() };
    for (kind, wheel_base_m) in [(DynamicsKind::Kinematic, 2.588), (DynamicsKind::SingleTrack, 2.588 + 0.2184)] {
        let body = chassis(kind, 10).take_over(&ego);
        assert!((body.ego.steering_rad.tan() * 10.0 / wheel_base_m - 0.2).abs() < 1e-4, "{kind:?}");
    }
}
