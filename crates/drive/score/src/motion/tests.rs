//! The banded fits against dense normal equations as the reference writes them; drives worked out by hand.

use ds_space::angle::wrap;
use ds_space::{DVec2, PoseSe2, SimTime};
use ds_world::{Trajectory, TrajectoryPoint};
use proptest::prelude::*;

use super::*;
use crate::constants::horizon::DT_S;

/// Solves A·x = b by elimination with pivoting.
fn solve(mut a: Vec<Vec<f64>>, mut b: Vec<f64>) -> Vec<f64> {
    let n = b.len();
    for column in 0..n {
        let pivot = (column..n).max_by(|i, j| a[*i][column].abs().total_cmp(&a[*j][column].abs())).expect("rows");
        a.swap(column, pivot);
        b.swap(column, pivot);
        let head = a[column].clone();
        for row in column + 1..n {
            let factor = a[row][column] / head[column];
            a[row].iter_mut().zip(&head).skip(column).for_each(|(value, above)| *value -= factor * above);
            b[row] -= factor * b[column];
        }
    }
    for row in (0..n).rev() {
        let sum: f64 = (row + 1..n).map(|k| a[row][k] * b[k]).sum();
        b[row] = (b[row] - sum) / a[row][row];
    }
    b
}

/// Minimises ‖y − A·z‖² + Σ weight·(R·z)² and integrates z to a profile.
fn fitted(rows: &[Vec<f64>], y: &[f64], penalties: &[(f64, Vec<f64>)]) -> Vec<f64> {
    let n = rows[0].len();
    let mut normal = vec![vec![0.0; n]; n];
    let mut rhs = vec![0.0; n];
    let weighted = rows.iter().zip(y).map(|(row, y)| (1.0, row, *y));
    for (weight, row, y) in weighted.chain(penalties.iter().map(|(weight, row)| (*weight, row, 0.0))) {
        for i in 0..n {
            rhs[i] += weight * row[i] * y;
            for j in 0..n {
                normal[i][j] += weight * row[i] * row[j];
            }
        }
    }
    let z = solve(normal, rhs);
    let mut profile = vec![z[0]];
    for rate in &z[1..] {
        profile.push(profile[profile.len() - 1] + DT_S * rate);
    }
    profile
}

fn unit(n: usize, entries: &[(usize, f64)]) -> Vec<f64> {
    let mut row = vec![0.0; n];
    entries.iter().for_each(|(i, value)| row[*i] = *value);
    row
}

fn dense_speeds(poses: &[PoseSe2; STATES]) -> Vec<f64> {
    let (mut rows, mut y) = (Vec::new(), Vec::new());
    for i in 0..STEPS {
        let step = poses[i + 1].position - poses[i].position;
        for (share, moved) in [(poses[i].forward().x, step.x), (poses[i].forward().y, step.y)] {
            let entry = |j: usize| {
                if j == 0 {
                    DT_S
                } else if j <= i {
                    DT_S * DT_S
                } else {
                    0.0
                }
            };
            rows.push((0..STEPS).map(|j| share * entry(j)).collect());
            y.push(moved);
        }
    }
    let mut penalties: Vec<_> = (1..=37).map(|j| (1e-4, unit(STEPS, &[(j, 1.0)]))).collect();
    penalties.push((1e-4, unit(STEPS, &[(38, -1.0), (39, 1.0)])));
    fitted(&rows, &y, &penalties)
}

fn dense_curvatures(poses: &[PoseSe2; STATES], speeds: &[f64]) -> Vec<f64> {
    let (mut rows, mut y) = (Vec::new(), Vec::new());
    for i in 0..STEPS {
        let entry = |j: usize| {
            if j == 0 {
                DT_S
            } else if j <= i {
                DT_S * DT_S
            } else {
                0.0
            }
        };
        rows.push((0..STEPS).map(|j| speeds[i] * entry(j)).collect::<Vec<f64>>());
        y.push(wrap(poses[i + 1].heading_rad - poses[i].heading_rad));
    }
    let mut penalties: Vec<_> = (1..STEPS).map(|j| (1e-2, unit(STEPS, &[(j, 1.0)]))).collect();
    penalties.push((1e-10, unit(STEPS, &[(0, 1.0)])));
    fitted(&rows, &y, &penalties)
}

proptest! {
    #[test]
    fn banded_fits_equal_dense_ones(
        turns in prop::collection::vec(-0.05..0.05f64, STEPS), steps in prop::collection::vec(0.0..1.5f64, STEPS),
    ) {
        let mut poses = [PoseSe2::new(4.7e3, -3.0e3, 2.9); STATES];
        for i in 0..STEPS {
            let position = poses[i].position + poses[i].forward() * steps[i] + DVec2::new(0.01, -0.02);
            poses[i + 1] = PoseSe2 { position, heading_rad: wrap(poses[i].heading_rad + turns[i]) };
        }
        let speeds = SpeedFit::get().speeds(&poses, &profile::directions(&poses));
        for (banded, dense) in speeds.iter().zip(dense_speeds(&poses)) {
            prop_assert!((banded - dense).abs() < 1e-8, "{banded} {dense}");
        }
        for (banded, dense) in profile::curvatures(&poses, &speeds).iter().zip(dense_curvatures(&poses, &speeds)) {
            prop_assert!((banded - dense).abs() < 1e-8, "{banded} {dense}");
        }
    }
}

fn straight(speed_mps: f64) -> PlannedPoses {
    PlannedPoses { dt_s: 0.5, poses: (1..=8).map(|i| PoseSe2::new(0.5 * speed_mps * f64::from(i), 0.0, 0.0)).collect() }
}

#[test]
fn the_simulators_profile_is_the_same_but_for_rounding() {
    let pose = |step: usize| {
        let secs = DT_S * step as f64;
        PoseSe2::new(7.0 * secs + 0.4 * (2.0 * secs).sin(), 0.3 * secs * secs, 0.1 * secs)
    };
    let poses: [PoseSe2; STATES] = std::array::from_fn(pose);
    let speeds = SpeedFit::get().speeds(&poses, &profile::directions(&poses));
    let curvatures = profile::curvatures(&poses, &speeds);
    let points =
        (1..STATES).map(|step| TrajectoryPoint { after: SimTime::from_secs(DT_S * step as f64), pose: pose(step) });
    let plan = Trajectory::new(points.collect()).expect("the plan is sound");
    let reference = ds_vehicle::Reference::new(&plan, PoseSe2::default(), SimTime::from_secs(DT_S));
    let simulated = ds_vehicle::Profile::of(&reference);
    for step in 0..STEPS {
        assert!((speeds[step] - simulated.speed_mps[step]).abs() < 1e-12, "speed {step}");
        assert!((curvatures[step] - simulated.curvature_per_m[step]).abs() < 1e-9, "curvature {step}");
    }
}

#[test]
fn a_plan_at_its_own_speed_is_followed_exactly() {
    let start = VehicleState { vx_mps: 10.0, heading_rad: 0.3, ..VehicleState::default() };
    let states = Executor::default().execute(&start, &straight(10.0)).expect("a sound plan");
    for (step, state) in (0u32..).zip(&states) {
        let along = DVec2::from_angle(0.3) * f64::from(step);
        assert!((state.position() - along).length() < 1e-9, "{step}: {state:?}");
    }
}

#[test]
fn braking_from_rest_of_plan_takes_the_worked_first_step() {
    // v = 10, reference 0 throughout: a_cmd = −10/11·10, a' = a_cmd/3 after one step of 0.1 s with a lag of 0.2 s.
    let start = VehicleState { vx_mps: 10.0, ..VehicleState::default() };
    let states = Executor::default().execute(&start, &straight(0.0)).expect("a sound plan");
    let first = -100.0 / 11.0 / 3.0;
    assert!((states[1].ax_mps2 - first).abs() < 1e-9 && (states[1].vx_mps - (10.0 + 0.1 * first)).abs() < 1e-9);
    assert!((states[1].x_m - 1.0).abs() < 1e-12);
}

#[test]
fn sampling_by_table() {
    let ego = PoseSe2::new(100.0, 50.0, std::f64::consts::FRAC_PI_2);
    let plan = PlannedPoses { dt_s: 0.5, poses: vec![PoseSe2::new(5.0, 0.0, 0.5), PoseSe2::new(5.0, 5.0, 1.0)] };
    let mut poses = [PoseSe2::default(); STATES];
    plan.sample(&ego, &mut poses).expect("a sound plan");
    for (step, x_m, y_m, heading_rad) in [
        (0, 100.0, 50.0, 0.0),
        (2, 100.0, 52.0, 0.2),
        (5, 100.0, 55.0, 0.5),
        (6, 99.0, 55.0, 0.6),
        (40, 95.0, 55.0, 1.0),
    ] {
        assert!((poses[step].position - DVec2::new(x_m, y_m)).length() < 1e-12, "{step}: {:?}", poses[step]);
        assert!((poses[step].heading_rad - ego.heading_rad - heading_rad).abs() < 1e-12, "{step}: {:?}", poses[step]);
    }
    assert_eq!(plan.coverage(), Coverage::Held);
    assert_eq!(straight(1.0).coverage(), Coverage::Whole);
    assert_eq!(PlannedPoses { dt_s: 1.0, ..straight(1.0) }.coverage(), Coverage::Cut);
    assert_eq!(PlannedPoses { dt_s: 0.1, poses: vec![PoseSe2::default(); 40] }.coverage(), Coverage::Whole);
}

#[test]
fn bad_plans_are_refused_by_name() {
    for (plan, says) in [
        (PlannedPoses { dt_s: 0.5, poses: vec![] }, "plan of 0 poses"),
        (PlannedPoses { dt_s: 0.0, ..straight(1.0) }, "at 0 s"),
        (PlannedPoses { dt_s: f64::NAN, ..straight(1.0) }, "at NaN s"),
        (PlannedPoses { dt_s: 0.5, poses: vec![PoseSe2::new(1.0, f64::NAN, 0.0)] }, "\"poses[0].y\" is NaN"),
    ] {
        let error = plan.check().expect_err(says).to_string();
        assert!(error.contains(says), "{error}");
    }
}
