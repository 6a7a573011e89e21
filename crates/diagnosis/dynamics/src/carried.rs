//! The ordinary mismatch that the logs carry: what of a fit a corrected simulator takes over.
//!
//! A fit moves every nuisance a little, also where the logs say nothing of it; dozens of such moves together set a closed loop
//! apart. A nuisance stays at neutral where the evidence for that is greater than for leaving it free: the ratio of posterior to prior
//! density there (Savage and Dickey; Dickey 1971), one after the other, the most superfluous first, and all others conditioned on it
//! in the fit's normal approximation, so that of two which stand for one another one is kept.

use nalgebra::DMatrix;

use crate::fit::Fit;
use crate::space::Space;

/// Returns a fit's vector with the nuisances that the logs do not carry at neutral, given some effects as they were estimated.
#[must_use]
pub(crate) fn carried(space: &Space, fit: &Fit, effects: &[usize]) -> Vec<f64> {
    let (mut vector, mut covariance, neutral) = (fit.vector.clone(), fit.covariance.clone(), space.neutral());
    let kept: Vec<usize> = effects.iter().flat_map(|effect| space.of(*effect)).collect();
    let mut open: Vec<usize> = (0..fit.free.len())
        .filter(|&at| {
            let k = fit.free[at];
            space.coordinates[k].nuisance.is_some() && neutral[k].is_finite() && !kept.contains(&k)
        })
        .collect();
    let of_effects = (0..fit.free.len()).filter(|&at| kept.contains(&fit.free[at]));
    of_effects.for_each(|at| given(&mut covariance, at));
    // Log evidence for leaving one free over keeping it at neutral.
    let evidence = |vector: &[f64], covariance: &DMatrix<f64>, at: usize| {
        let (k, variance) = (fit.free[at], covariance[(at, at)]);
        let n = space.coordinates[k].nuisance.filter(|_| variance > 0.0)?;
        Some(log_normal(neutral[k] - n.mean, n.sd * n.sd) - log_normal(neutral[k] - vector[k], variance))
    };
    let mut dropped = Vec::new();
    loop {
        let told =
            open.iter().enumerate().filter_map(|(place, &at)| Some((place, evidence(&vector, &covariance, at)?)));
        let Some((place, _)) = told.filter(|(_, gain)| *gain < 0.0).min_by(|a, b| a.1.total_cmp(&b.1)) else { break };
        let at = open.swap_remove(place);
        let share = (neutral[fit.free[at]] - vector[fit.free[at]]) / covariance[(at, at)];
        for (other, along) in fit.free.iter().zip(covariance.column(at).iter()) {
            vector[*other] += along * share;
        }
        given(&mut covariance, at);
        dropped.push(fit.free[at]);
    }
    dropped.into_iter().for_each(|k| vector[k] = neutral[k]);
    kept.into_iter().for_each(|k| vector[k] = fit.vector[k]);
    vector
}

/// Takes what is known of all others once one coordinate is.
fn given(covariance: &mut DMatrix<f64>, at: usize) {
    let (along, variance) = (covariance.column(at).into_owned(), covariance[(at, at)]);
    if variance > 0.0 {
        *covariance -= &along * along.transpose() / variance;
    }
}

fn log_normal(apart: f64, variance: f64) -> f64 {
    -0.5 * (apart * apart / variance + (std::f64::consts::TAU * variance).ln())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::space::Part;
    use ds_diagnosis::meta::Nominal;

    fn space() -> Space {
        let nominal = r#"{"mass": 1500.0, "yaw_inertia": 2250.0, "lf": 1.2, "lr": 1.6, "cornering_stiffness_front": 8e4,
            "cornering_stiffness_rear": 9e4, "steer_lag": 0.05, "accel_lag": 0.2, "rolling_decel": 0.1, "drag_decel_per_v2": 4e-4}"#;
        let nominal: Nominal = serde_json::from_str(nominal).expect("a nominal simulator");
        Space::new(Part::Ego, &nominal, &[])
    }

    /// Returns a fit of the first free nuisances, so many deviations of their priors from neutral, and with a covariance in such units.
    fn fit(space: &Space, moved: &[f64], covariance: &[f64]) -> (Fit, Vec<f64>) {
        let neutral = space.neutral();
        let known = |k: &usize| space.coordinates[*k].nuisance.is_some_and(|n| n.mean == neutral[*k]);
        let free: Vec<usize> = (0..neutral.len()).filter(known).take(moved.len()).collect();
        let sds: Vec<f64> = free.iter().filter_map(|&k| space.coordinates[k].nuisance.map(|n| n.sd)).collect();
        let mut vector = neutral;
        free.iter().zip(&sds).zip(moved).for_each(|((&k, sd), moved)| vector[k] += sd * moved);
        let count = free.len();
        let covariance = DMatrix::from_fn(count, count, |a, b| covariance[a * count + b] * sds[a] * sds[b]);
        let found =
            Fit { vector, residuals: Vec::new(), data_loss: 0.0, evidence: 0.0, free, covariance, columns: Vec::new() };
        (found, sds)
    }

    #[test]
    fn what_the_logs_do_not_carry_stays_at_neutral() {
        let space = space();
        let neutral = space.neutral();
        let (found, _) = fit(&space, &[0.1, 1.5], &[0.04, 0.0, 0.0, 0.04]);
        let vector = carried(&space, &found, &[]);
        assert_eq!(vector[found.free[0]], neutral[found.free[0]]);
        assert_eq!(vector[found.free[1]], found.vector[found.free[1]]);
        let own = space.coordinates[found.free[0]].effect;
        let vector = carried(&space, &found, &[own]);
        assert_eq!(vector[found.free[0]], found.vector[found.free[0]], "an accepted effect keeps its estimate");
    }

    #[test]
    fn of_two_that_stand_for_one_another_one_is_kept() {
        let space = space();
        let neutral = space.neutral();
        // Their sum is known to a tenth, their difference not at all.
        let (found, sds) = fit(&space, &[0.45, 0.35], &[0.5025, -0.4975, -0.4975, 0.5025]);
        let vector = carried(&space, &found, &[]);
        let moved: Vec<f64> = found.free.iter().zip(&sds).map(|(&k, sd)| (vector[k] - neutral[k]) / sd).collect();
        assert_eq!(moved.iter().filter(|moved| **moved == 0.0).count(), 1);
        assert!((moved.iter().sum::<f64>() - 0.8).abs() < 0.02, "{moved:?}");
    }
}
