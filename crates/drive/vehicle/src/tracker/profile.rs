//! Speed and curvature of a reference, fitted to its poses by regularised least squares.
//!
//! As in NAVSIM's batched LQR tracker: minimise ‖Δp − A·z‖² plus a penalty on the changes. Its unknowns (initial value
//! and rates) are replaced by the values themselves, which gives the same minimum with banded equations. Its quirk is
//! kept: the speed penalty is on the acceleration in all rows but the last, which has the difference of the last two.

use ds_space::angle::turn;

use super::banded::Banded;
use super::reference::Reference;

const ACCELERATION_PENALTY: f64 = 1e-4;
const CURVATURE_PENALTY: f64 = 1e-10;
const CURVATURE_RATE_PENALTY: f64 = 1e-2;

/// Speed and curvature of each displacement of a reference.
#[derive(Debug, Clone)]
pub struct Profile {
    /// In metres per second.
    pub speed_mps: Vec<f64>,
    /// Per metre, left positive.
    pub curvature_per_m: Vec<f64>,
}

impl Profile {
    /// Fits the profile of a reference.
    #[must_use]
    pub fn of(reference: &Reference) -> Self {
        let speed_mps = fit_speed(reference);
        let curvature_per_m = fit_curvature(reference, &speed_mps);
        Self { speed_mps, curvature_per_m }
    }
}

fn fit_speed(reference: &Reference) -> Vec<f64> {
    let (n, dt) = (reference.steps(), reference.dt_secs);
    let mut matrix = Banded::zeros(n);
    let mut right = Vec::with_capacity(n);
    for (i, ends) in reference.poses.windows(2).enumerate() {
        let ahead_m = (ends[1].position - ends[0].position).dot(ends[0].forward());
        matrix.add_square(i, &[dt], 1.0);
        right.push(dt * ahead_m);
    }
    // Rows of the penalty: accelerations a_1..a_(n-3), then a_(n-1) - a_(n-2).
    for i in 1..n.saturating_sub(2) {
        matrix.add_square(i - 1, &[-1.0 / dt, 1.0 / dt], ACCELERATION_PENALTY);
    }
    if n >= 3 {
        matrix.add_square(n - 3, &[1.0 / dt, -2.0 / dt, 1.0 / dt], ACCELERATION_PENALTY);
    }
    matrix.solve(right)
}

fn fit_curvature(reference: &Reference, speed_mps: &[f64]) -> Vec<f64> {
    let (n, dt) = (reference.steps(), reference.dt_secs);
    let mut matrix = Banded::zeros(n);
    let mut right = Vec::with_capacity(n);
    for (i, ends) in reference.poses.windows(2).enumerate() {
        let step_m = speed_mps[i] * dt;
        matrix.add_square(i, &[step_m], 1.0);
        right.push(step_m * turn(ends[0].heading_rad, ends[1].heading_rad));
    }
    matrix.add_square(0, &[1.0], CURVATURE_PENALTY);
    for i in 1..n {
        matrix.add_square(i - 1, &[-1.0 / dt, 1.0 / dt], CURVATURE_RATE_PENALTY);
    }
    matrix.solve(right)
}

#[cfg(test)]
mod tests {
    use ds_space::{PoseSe2, SimTime};
    use ds_world::{Trajectory, TrajectoryPoint};

    use super::*;

    /// The published form: unknowns v0 and accelerations, dense normal equations, Gaussian elimination.
    fn published_speed(reference: &Reference) -> Vec<f64> {
        let (n, dt) = (reference.steps(), reference.dt_secs);
        let mut matrix = vec![vec![0.0; n]; n];
        let mut right = vec![0.0; n];
        for (i, ends) in reference.poses.windows(2).enumerate() {
            let moved = ends[1].position - ends[0].position;
            for axis in [(moved.x, ends[0].heading_rad.cos()), (moved.y, ends[0].heading_rad.sin())] {
                let row: Vec<f64> = (0..n)
                    .map(|j| {
                        if j == 0 {
                            dt
                        } else if j <= i {
                            dt * dt
                        } else {
                            0.0
                        }
                    })
                    .map(|v| v * axis.1)
                    .collect();
                add_row(&mut matrix, &mut right, &row, axis.0, 1.0);
            }
        }
        for row in 0..n - 2 {
            let mut penalty = vec![0.0; n];
            if row + 1 < n - 2 {
                penalty[1 + row] = 1.0;
            } else {
                (penalty[n - 2], penalty[n - 1]) = (-1.0, 1.0);
            }
            add_row(&mut matrix, &mut right, &penalty, 0.0, 1e-4);
        }
        let z = eliminate(matrix, right);
        let mut speed = z[0];
        let mut speeds = vec![speed];
        for acceleration in &z[1..] {
            speed += acceleration * dt;
            speeds.push(speed);
        }
        speeds
    }

    fn add_row(matrix: &mut [Vec<f64>], right: &mut [f64], row: &[f64], value: f64, weight: f64) {
        for (i, a) in row.iter().enumerate() {
            for (j, b) in row.iter().enumerate() {
                matrix[i][j] += weight * a * b;
            }
            right[i] += weight * a * value;
        }
    }

    fn eliminate(mut matrix: Vec<Vec<f64>>, mut right: Vec<f64>) -> Vec<f64> {
        let n = right.len();
        for i in 0..n {
            let best = (i..n).max_by(|a, b| matrix[*a][i].abs().total_cmp(&matrix[*b][i].abs())).expect("rows remain");
            matrix.swap(i, best);
            right.swap(i, best);
            for row in i + 1..n {
                let factor = matrix[row][i] / matrix[i][i];
                let (above, below) = matrix.split_at_mut(row);
                for (value, pivot) in below[0].iter_mut().zip(&above[i]).skip(i) {
                    *value -= factor * pivot;
                }
                right[row] -= factor * right[i];
            }
        }
        for i in (0..n).rev() {
            let known: f64 = (i + 1..n).map(|j| matrix[i][j] * right[j]).sum();
            right[i] = (right[i] - known) / matrix[i][i];
        }
        right
    }

    fn curve() -> Reference {
        let points = (1..=8)
            .map(|i| {
                let t = f64::from(i) * 0.5;
                TrajectoryPoint { after: SimTime::from_secs(t), pose: PoseSe2::new(6.0 * t, 0.4 * t * t, 0.13 * t) }
            })
            .collect();
        let plan = Trajectory::new(points).expect("the plan is sound");
        Reference::new(&plan, PoseSe2::new(3.0, -2.0, 0.7), SimTime::from_secs(0.1))
    }

    #[test]
    fn banded_speed_equals_the_published_dense_form() {
        let reference = curve();
        assert_eq!(reference.steps(), 40);
        let ours = fit_speed(&reference);
        for (i, (a, b)) in ours.iter().zip(published_speed(&reference)).enumerate() {
            assert!((a - b).abs() < 1e-8, "speed {i}: {a} and {b}");
        }
    }

    #[test]
    fn a_circle_has_constant_speed_and_curvature() {
        let points = (1..=40)
            .map(|i| {
                let angle = f64::from(i) * 0.1 * 8.0 / 20.0;
                let pose = PoseSe2::new(20.0 * angle.sin(), 20.0 * (1.0 - angle.cos()), angle);
                TrajectoryPoint { after: SimTime::from_secs(f64::from(i) * 0.1), pose }
            })
            .collect();
        let plan = Trajectory::new(points).expect("the plan is sound");
        let profile = Profile::of(&Reference::new(&plan, PoseSe2::default(), SimTime::from_secs(0.1)));
        for (speed, curvature) in profile.speed_mps.iter().zip(&profile.curvature_per_m) {
            assert!((speed - 8.0).abs() < 0.02 && (curvature - 0.05).abs() < 1e-3, "{speed} m/s, {curvature} 1/m");
        }
    }

    #[test]
    fn the_shortest_plans_have_a_profile() {
        for secs in [0.01, 0.1, 0.2, 0.3] {
            let point = TrajectoryPoint { after: SimTime::from_secs(secs), pose: PoseSe2::new(1.0, 0.0, 0.0) };
            let plan = Trajectory::new(vec![point]).expect("the plan is sound");
            let profile = Profile::of(&Reference::new(&plan, PoseSe2::default(), SimTime::from_secs(0.1)));
            assert!(profile.speed_mps.iter().chain(&profile.curvature_per_m).all(|v| v.is_finite()), "{secs} s");
        }
    }
}
