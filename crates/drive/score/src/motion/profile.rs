//! Speed and curvature profiles of 41 reference poses: two regularised least-squares fits, solved by their structure.
//!
//! Written in the profile itself instead of first value and derivatives, the normal equations are banded: the speed's
//! matrix is constant (factorised once), the curvature's is a chain. `scoring.md` §2, PDM `batch_lqr_utils.py:73-240`.

use std::sync::LazyLock;

use ds_space::angle::wrap;
use ds_space::{DVec2, PoseSe2};

use crate::constants::horizon::{DT_S, STATES, STEPS};
use crate::constants::profile::{ACCELERATION_PENALTY, CURVATURE_RATE_PENALTY, FIRST_CURVATURE_PENALTY};

/// Returns the unit vector along each pose.
pub(crate) fn directions(poses: &[PoseSe2; STATES]) -> [DVec2; STATES] {
    poses.map(|pose| pose.forward())
}

/// The factorised normal equations of the speed fit: `dt²·v + penalty = dt·d`, L·D·Lᵀ of bandwidth 2.
#[derive(Debug, Clone)]
pub(crate) struct SpeedFit {
    inverse_diagonal: [f64; STEPS],
    first_below: [f64; STEPS],
    second_below: [f64; STEPS],
}

impl SpeedFit {
    /// Returns the factors, made at first use.
    pub(crate) fn get() -> &'static Self {
        static FIT: LazyLock<SpeedFit> = LazyLock::new(SpeedFit::new);
        &FIT
    }

    fn new() -> Self {
        let mut band = [[0.0; STEPS]; 3];
        let mut add = |i: usize, j: usize, value: f64| band[i - j][j] += value;
        for i in 0..STEPS {
            add(i, i, DT_S * DT_S);
        }
        let weight = ACCELERATION_PENALTY / (DT_S * DT_S);
        // All accelerations but the last two are penalised themselves, the last by its difference (a quirk).
        for i in 1..STEPS - 2 {
            add(i - 1, i - 1, weight);
            add(i, i, weight);
            add(i, i - 1, -weight);
        }
        let last: [(usize, f64); 3] = [(STEPS - 3, 1.0), (STEPS - 2, -2.0), (STEPS - 1, 1.0)];
        for (i, a) in last {
            for (j, b) in last.iter().filter(|(j, _)| *j <= i) {
                add(i, *j, weight * a * b);
            }
        }
        Self::factorise(&band)
    }

    fn factorise(band: &[[f64; STEPS]; 3]) -> Self {
        let mut fit = Self { inverse_diagonal: [0.0; STEPS], first_below: [0.0; STEPS], second_below: [0.0; STEPS] };
        let mut diagonal = [0.0; STEPS];
        for i in 0..STEPS {
            // Row i of L: entries at i − 2 and i − 1.
            let second = if i >= 2 { band[2][i - 2] / diagonal[i - 2] } else { 0.0 };
            let carried = if i >= 2 { second * diagonal[i - 2] * fit.first_below[i - 1] } else { 0.0 };
            let first = if i >= 1 { (band[1][i - 1] - carried) / diagonal[i - 1] } else { 0.0 };
            let mut pivot = band[0][i];
            if i >= 1 {
                pivot -= first * first * diagonal[i - 1];
            }
            if i >= 2 {
                pivot -= second * second * diagonal[i - 2];
            }
            diagonal[i] = pivot;
            fit.inverse_diagonal[i] = 1.0 / pivot;
            fit.first_below[i] = first;
            fit.second_below[i] = second;
        }
        fit
    }

    /// Returns the fitted speed at each of the 40 displacements, in metres per second.
    pub(crate) fn speeds(&self, poses: &[PoseSe2; STATES], directions: &[DVec2; STATES]) -> [f64; STEPS] {
        let mut v = [0.0; STEPS];
        for i in 0..STEPS {
            v[i] = DT_S * directions[i].dot(poses[i + 1].position - poses[i].position);
        }
        v[1] -= self.first_below[1] * v[0];
        for i in 2..STEPS {
            v[i] -= self.first_below[i] * v[i - 1] + self.second_below[i] * v[i - 2];
        }
        for (value, inverse) in v.iter_mut().zip(&self.inverse_diagonal) {
            *value *= inverse;
        }
        v[STEPS - 2] -= self.first_below[STEPS - 1] * v[STEPS - 1];
        for i in (0..STEPS - 2).rev() {
            v[i] -= self.first_below[i + 1] * v[i + 1] + self.second_below[i + 2] * v[i + 2];
        }
        v
    }
}

/// Returns the fitted curvature at each of the 40 displacements, per metre.
///
/// The matrix is that of a chain of springs, each node tied to the ground by (v·dt)². Eliminating from the end with the
/// ties as unknowns adds positive numbers only, so that the tiny tie of a standing car loses no digits.
pub(crate) fn curvatures(poses: &[PoseSe2; STATES], speeds: &[f64; STEPS]) -> [f64; STEPS] {
    let spring = CURVATURE_RATE_PENALTY / (DT_S * DT_S);
    let mut ties = [0.0; STEPS];
    let mut rhs = [0.0; STEPS];
    for i in 0..STEPS {
        let step_m = speeds[i] * DT_S;
        ties[i] = step_m * step_m;
        rhs[i] = step_m * wrap(poses[i + 1].heading_rad - poses[i].heading_rad);
    }
    ties[0] += FIRST_CURVATURE_PENALTY;
    let mut shares = [0.0; STEPS];
    for i in (1..STEPS).rev() {
        shares[i] = 1.0 / (ties[i] + spring);
        ties[i - 1] += spring * ties[i] * shares[i];
        rhs[i - 1] += spring * rhs[i] * shares[i];
    }
    rhs[0] /= ties[0];
    for i in 1..STEPS {
        rhs[i] = (rhs[i] + spring * rhs[i - 1]) * shares[i];
    }
    rhs
}
