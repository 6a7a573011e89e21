//! How a parameter scatters over healthy logs: θᵢ ~ N(μ, s²) with estimates of known precision, s² under an inverse-gamma
//! prior of four degrees of freedom at the library's spread.
//!
//! The mean may lie far from the library's: a vehicle of another family has traits of its own.

use ds_effect::Nuisance;

/// Degrees of freedom of the library's spread.
const FREEDOM: f64 = 4.0;
/// Part of the library's variance from log to log of one vehicle; the rest is from vehicle to vehicle.
const WITHIN: f64 = 0.5;
/// How much farther than the library's vehicles one of another family may lie from their mean, and how likely that is.
const FOREIGN: [(f64, f64); 6] = [(1.0, 0.7), (2.0, 0.15), (4.0, 0.1), (8.0, 0.05), (16.0, 0.02), (32.0, 0.01)];

/// An estimate from one log, freed of the prior under which it was made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Value.
    pub mean: f64,
    /// One over its variance; 0 where the log says nothing.
    pub precision: f64,
}

/// Returns what a further log of the same kind will have, from the estimates of others.
#[must_use]
pub(crate) fn spread(estimates: &[Estimate], library: Nuisance) -> Nuisance {
    let telling: Vec<&Estimate> = estimates.iter().filter(|e| e.precision > 0.0).collect();
    if telling.is_empty() {
        return library;
    }
    let variance = library.sd * library.sd;
    let of = |(far, prior): (f64, f64)| {
        let (logs, found) = marginal(&telling, library.mean, (1.0 - WITHIN) * variance * far * far, WITHIN * variance);
        (logs + prior.ln(), found)
    };
    let all = FOREIGN.map(of);
    all.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)).map_or(library, |best| best.1)
}

/// Returns the log evidence of a spread of vehicle means about a centre, and mean and spread of a further log.
fn marginal(telling: &[&Estimate], centre: f64, of_vehicles: f64, within: f64) -> (f64, Nuisance) {
    let step = 1.15f64.ln();
    let grid: Vec<(f64, f64, f64)> = (-22..38)
        .map(|k| {
            let s2 = within * (2.0 * f64::from(k) * step).exp();
            let (mut precision, mut pull) = (1.0 / of_vehicles, centre / of_vehicles);
            let mut log = -0.5 * of_vehicles.ln() - 0.5 * FREEDOM * (s2.ln() - within.ln() + within / s2);
            for e in telling {
                let p = 1.0 / (s2 + 1.0 / e.precision);
                precision += p;
                pull += p * (e.mean);
                log += 0.5 * p.ln() - 0.5 * p * (e.mean - centre).powi(2);
            }
            let mu = pull / precision;
            log += 0.5 * precision * (mu - centre).powi(2) - 0.5 * precision.ln();
            (log, mu, s2 + 1.0 / precision)
        })
        .collect();
    let best = grid.iter().map(|g| g.0).fold(f64::NEG_INFINITY, f64::max);
    let (mut total, mut means, mut variances) = (0.0, 0.0, 0.0);
    for (log, mu, variance) in grid {
        let weight = (log - best).exp();
        total += weight;
        means += weight * mu;
        variances += weight * variance;
    }
    (best + total.ln(), Nuisance { mean: means / total, sd: (variances / total).sqrt() })
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIBRARY: Nuisance = Nuisance { mean: 0.0, sd: 1.0 };

    fn of(means: &[f64], precision: f64) -> Nuisance {
        let estimates: Vec<Estimate> = means.iter().map(|mean| Estimate { mean: *mean, precision }).collect();
        spread(&estimates, LIBRARY)
    }

    #[test]
    fn logs_that_say_nothing_leave_the_library() {
        assert_eq!(of(&[3.0, 4.0], 0.0), LIBRARY);
        let weak = of(&[3.0], 1e-3);
        assert!(weak.mean.abs() < 0.1 && (0.9..1.3).contains(&weak.sd), "{weak:?}");
    }

    #[test]
    fn a_trait_moves_the_mean_and_many_logs_narrow_the_spread() {
        let three = of(&[5.0, 5.1, 4.9], 1e4);
        let ten = of(&[5.0, 5.1, 4.9, 5.0, 5.05, 4.95, 5.0, 5.1, 4.9, 5.0], 1e4);
        assert!((three.mean - 5.0).abs() < 0.3 && (ten.mean - 5.0).abs() < 0.1, "{three:?} {ten:?}");
        assert!(ten.sd < 0.5 && three.sd < 0.9 && ten.sd < three.sd, "{three:?} {ten:?}");
        assert!(of(&[-4.0, 0.0, 4.0], 1e4).sd > 2.0);
    }
}
