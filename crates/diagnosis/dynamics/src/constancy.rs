//! Is an accepted effect of one size everywhere, as the library has it, or does its size go with speed, cornering, pedals
//! or the rate of steering? What is not constant is something else that the library does not contain.
//!
//! One linear step: a further coefficient multiplies the effect's part of each residual by a regime of the window, the
//! fitted coordinates give way under their priors.

use nalgebra::DVector;

use crate::case::PartModel;
use crate::fit::{Fit, Model};
use crate::settings::{KAPPA, LOOSER, NU, REGIME_SLOPE_SD, TREND_CHANGE, TREND_GAIN};
use crate::windows::Regime;

/// How the size of an effect goes with a regime.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trend {
    /// The effect.
    pub effect: &'static str,
    /// The regime.
    pub regime: &'static str,
    /// Change of the effect from the lowest to the highest tenth of the windows, as a share of its size.
    pub change: f64,
    /// Log evidence of the change.
    pub gain: f64,
}

type Pick = fn(&Regime) -> f64;

const REGIMES: [(&str, Pick); 4] = [
    ("speed", |r| r.speed_mps),
    ("lateral acceleration", |r| r.lateral_mps2),
    ("acceleration request", |r| r.accel_mps2),
    ("steering rate", |r| r.steer_rate),
];

/// Returns the telling trend of most evidence among some effects of a fit, if there is any.
#[must_use]
pub fn strongest(model: &PartModel<'_>, fit: &Fit, effects: &[usize]) -> Option<Trend> {
    let all = effects.iter().flat_map(|effect| trends(model, fit, effects, *effect));
    all.filter(|t| t.gain > TREND_GAIN && t.change.abs() > TREND_CHANGE).max_by(|a, b| a.gain.total_cmp(&b.gain))
}

/// Returns how the size of an effect of a fit goes with each regime.
fn trends(model: &PartModel<'_>, fit: &Fit, effects: &[usize], effect: usize) -> Vec<Trend> {
    let suspected: Vec<usize> = effects.iter().flat_map(|e| model.space.of(*e)).collect();
    let usual = model.space.usual();
    let mut bare = fit.vector.clone();
    model.space.of(effect).into_iter().for_each(|k| bare[k] = usual[k]);
    let part: Vec<f64> =
        fit.residuals.iter().zip(model.residuals(&bare)).map(|(with, without)| with - without).collect();
    let windows = model.regimes();
    let id = model.space.effects[effect].id;
    let of = |(regime, pick): &(&'static str, Pick)| {
        let values: Vec<f64> = windows.iter().map(pick).collect();
        let (change, gain) = change(model, fit, &suspected, &part, &values)?;
        Some(Trend { effect: id, regime, change, gain })
    };
    REGIMES.iter().filter_map(of).collect()
}

/// Returns the change of an effect from low to high values of a regime, and the log evidence of it.
fn change(model: &PartModel<'_>, fit: &Fit, suspected: &[usize], part: &[f64], values: &[f64]) -> Option<(f64, f64)> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = |share: f64| sorted.get((share * (sorted.len() as f64 - 1.0)).round() as usize).copied();
    let (low, middle, high) = (at(0.1)?, at(0.5)?, at(0.9)?);
    if high - low < 1e-9 {
        return None;
    }
    let weight = |z: f64| KAPPA * (NU + 1.0) / (NU + z * z);
    let place = |window: usize| ((values[window] - middle) / (high - low)).clamp(-1.5, 1.5);
    let column: Vec<f64> = model.tags.iter().zip(part).map(|(tag, p)| p * place(tag.window)).collect();
    let (mut pull, mut own) = (0.0, 1.0 / (REGIME_SLOPE_SD * REGIME_SLOPE_SD));
    for (c, z) in column.iter().zip(&fit.residuals) {
        pull += weight(*z) * c * z;
        own += weight(*z) * c * c;
    }
    // what the data alone say: a nuisance that its prior holds back must not be let go by way of the trend
    let count = fit.free.len();
    let (mut cross, mut slope) = (DVector::zeros(count), DVector::zeros(count));
    for (i, k) in fit.free.iter().enumerate() {
        let Some(other) = &fit.columns[*k] else { continue };
        for ((a, b), z) in column.iter().zip(other.iter()).zip(&fit.residuals) {
            cross[i] += weight(*z) * a * b;
            slope[i] += weight(*z) * b * z;
        }
    }
    let mut hessian = fit.covariance.clone().try_inverse()?;
    for (i, k) in fit.free.iter().enumerate() {
        if let (false, Some(n)) = (suspected.contains(k), model.space.coordinates[*k].nuisance) {
            hessian[(i, i)] -= (1.0 - 1.0 / (LOOSER * LOOSER)) / (n.sd * n.sd);
        }
    }
    let loose = hessian.cholesky()?;
    let (pull, left) = (pull - cross.dot(&loose.solve(&slope)), own - cross.dot(&loose.solve(&cross)));
    if left <= 0.0 {
        return None;
    }
    let gain = 0.5 * pull * pull / left - 0.5 * (left * REGIME_SLOPE_SD * REGIME_SLOPE_SD).ln();
    Some((-pull / left, gain))
}
