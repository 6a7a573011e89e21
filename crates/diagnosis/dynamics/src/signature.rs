//! Which effects look alike in these data: cosines of whitened, nuisance-projected signatures, and intervals of
//! estimates by a one-step block bootstrap.

use nalgebra::{DMatrix, DVector};

use crate::bootstrap::weights;
use crate::case::PartModel;
use crate::fit::Fit;
use crate::settings::{KAPPA, NU};

/// Returns the cosine between the signatures of coordinates `a` and `b` after all other nuisances are projected out
/// under their priors; `None` if a signature is unknown or vanishes.
#[must_use]
pub fn cosine(model: &PartModel<'_>, fit: &Fit, a: usize, b: usize) -> Option<f64> {
    let known: Vec<usize> = (0..fit.columns.len()).filter(|&k| fit.columns[k].is_some()).collect();
    if !known.contains(&a) || !known.contains(&b) {
        return None;
    }
    let rest: Vec<usize> =
        known.iter().copied().filter(|&k| k != a && k != b && prior_sd(model, k).is_some()).collect();
    let order: Vec<usize> = [a, b].into_iter().chain(rest.iter().copied()).collect();
    let weight: Vec<f64> = fit.residuals.iter().map(|z| KAPPA * (NU + 1.0) / (NU + z * z)).collect();
    let columns: Vec<&Vec<f64>> = order.iter().filter_map(|&k| fit.columns[k].as_deref()).collect();
    let mut matrix = DMatrix::zeros(order.len(), order.len());
    for i in 0..order.len() {
        let weighted: Vec<f64> = columns[i].iter().zip(&weight).map(|(c, w)| c * w).collect();
        for (j, value) in products(&weighted, &columns[..=i]).into_iter().enumerate() {
            matrix[(i, j)] = value;
            matrix[(j, i)] = value;
        }
        if let (true, Some(sd)) = (i >= 2, prior_sd(model, order[i])) {
            matrix[(i, i)] += 1.0 / (sd * sd);
        }
    }
    let head = matrix.view((0, 0), (2, 2)).into_owned();
    let cross = matrix.view((0, 2), (2, rest.len())).into_owned();
    let tail = matrix.view((2, 2), (rest.len(), rest.len())).into_owned();
    let projected = head - &cross * tail.cholesky()?.solve(&cross.transpose());
    let norm = projected[(0, 0)] * projected[(1, 1)];
    (norm > 1e-6).then(|| (projected[(0, 1)] / norm.sqrt()).clamp(-1.0, 1.0))
}

/// Returns the products of a row with several; four sums go on at once, each in the order of the rows.
fn products(row: &[f64], others: &[&Vec<f64>]) -> Vec<f64> {
    let mut found = Vec::with_capacity(others.len());
    for four in others.chunks(4) {
        let of = |k: usize| &four[k.min(four.len() - 1)][..row.len()];
        let (a, b, c, d) = (of(0), of(1), of(2), of(3));
        let mut sums = [-0.0; 4];
        for (k, value) in row.iter().enumerate() {
            for (sum, other) in sums.iter_mut().zip([a[k], b[k], c[k], d[k]]) {
                *sum += value * other;
            }
        }
        found.extend_from_slice(&sums[..four.len()]);
    }
    found
}

fn prior_sd(model: &PartModel<'_>, k: usize) -> Option<f64> {
    model.space.coordinates[k].nuisance.map(|n| n.sd)
}

/// Returns the standard deviation of a coordinate's estimate over a block bootstrap of windows, by one Newton step from
/// the fit for each draw, together with the Laplace one.
#[must_use]
pub fn spread(model: &PartModel<'_>, fit: &Fit, coordinate: usize) -> f64 {
    let Some(at) = fit.free.iter().position(|k| *k == coordinate) else { return 0.0 };
    let laplace = fit.covariance[(at, at)].max(0.0);
    let windows = model.tags.last().map_or(0, |tag| tag.window + 1);
    let mut drives = vec![0; windows];
    let mut scores = vec![0.0; windows];
    // influence of a window on the estimate: row of the inverse Hessian times the window's gradient
    let row: DVector<f64> = fit.covariance.row(at).transpose();
    for (i, tag) in model.tags.iter().enumerate() {
        drives[tag.window] = tag.drive;
        let z = fit.residuals[i];
        if z == 0.0 {
            continue;
        }
        let pull = KAPPA * (NU + 1.0) / (NU + z * z) * z;
        let lever: f64 = fit
            .free
            .iter()
            .enumerate()
            .filter_map(|(j, &k)| fit.columns[k].as_ref().map(|column| row[j] * column[i]))
            .sum();
        scores[tag.window] += lever * pull;
    }
    let draws = weights(&drives, "estimate");
    let moves: Vec<f64> =
        draws.iter().map(|draw| draw.iter().zip(&scores).map(|(w, s)| (w - 1.0) * s).sum::<f64>()).collect();
    let mean = moves.iter().sum::<f64>() / moves.len() as f64;
    let boot = moves.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / moves.len() as f64;
    (laplace.max(boot)).sqrt()
}
