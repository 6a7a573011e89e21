//! A signal at a port that depends on nothing recorded: one value a second of every drive, believed to be small and independent
//! (Gaussian process on a grid). Its evidence tells whether anything at that port could explain the drives; what it is, a law
//! must say.
//!
//! Windows start anew from what was measured, so that a pulse shows in the windows around it alone and a comb of pulses far
//! enough apart costs one rollout.

use ds_dynamics::fit::data_loss;
use ds_dynamics::settings::{KAPPA, NU};
use ds_effect::law::{Expression, Term};
use ds_effect::{Law, Port};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::linear::{Fitted, Rows};
use crate::port::{Base, STEP};
use crate::terms::usual;

/// Pulses of the combs by part of the loop: farther apart than a window and a pulse are long.
const COMBS: usize = 5;
const COMBS_OF_FOLLOWERS: usize = 9;
/// Seconds between pulses, and most of them in a drive.
const SPACING_SECS: f64 = 1.0;
const MOST: f64 = 300.0;
/// Middle of a window behind its anchor, s.
const MIDDLE_SECS: f64 = 0.75;
const MIDDLE_OF_FOLLOWERS_SECS: f64 = 2.0;
/// Standard deviations tried, in usual sizes of the port.
const SIZES: [f64; 3] = [0.05, 0.2, 0.8];
/// Passes of weights.
const PASSES: usize = 3;
/// Log prior against a law of terms, with the choice of the size.
const COST: f64 = 4.0;

/// The response to the pulses of one drive.
struct Pulses {
    /// One column per pulse, over the rows of the drive.
    columns: DMatrix<f64>,
}

/// A weighted solution.
struct Solved {
    evidence: f64,
    residuals: Vec<f64>,
}

/// Returns the log evidence of a free signal at a port over none.
pub(crate) fn gain(base: &Base<'_, '_>, port: Port, rows: &Rows<'_>, empty: &Fitted) -> f64 {
    let pulses = pulses(base, port, rows);
    let best = |size: &f64| {
        let mut at = empty.residuals.clone();
        let mut best = f64::NEG_INFINITY;
        for _ in 0..PASSES {
            let Some(solved) = solve(rows, &pulses, &at, *size) else { break };
            best = best.max(solved.evidence);
            at = solved.residuals;
        }
        best
    };
    SIZES.par_iter().map(best).reduce(|| f64::NEG_INFINITY, f64::max) - empty.gain - COST
}

fn pulses(base: &Base<'_, '_>, port: Port, rows: &Rows<'_>) -> Vec<Pulses> {
    let follows = port == Port::Follower;
    let (combs, middle) = if follows { (COMBS_OF_FOLLOWERS, MIDDLE_OF_FOLLOWERS_SECS) } else { (COMBS, MIDDLE_SECS) };
    let tags = &base.model.tags;
    let at = |row: usize| tags[row].secs - base.model.start_secs(tags[row].drive) + middle;
    let longest = (0..tags.len()).map(at).fold(0.0, f64::max);
    let spacing = SPACING_SECS.max(longest / MOST);
    let period = combs as f64 * spacing;
    let coefficient = STEP * usual(port, &base.model.space.plant(&base.null.vector).vehicle);
    let comb = |k: usize| -> Vec<f64> {
        let expression = Expression::pulses(k as f64 * spacing, period, spacing);
        let Ok(law) = Law::new(port, vec![Term { coefficient, expression }]) else { return Vec::new() };
        base.change(&law)
    };
    let responses: Vec<Vec<f64>> = (0..combs).into_par_iter().map(comb).collect();
    let of_drive = |range: &std::ops::Range<usize>| {
        let last = range.clone().map(at).fold(0.0, f64::max);
        let count = (last / spacing) as usize + combs + 1;
        let mut columns = DMatrix::zeros(range.len(), count);
        for (k, response) in responses.iter().enumerate().filter(|(_, r)| !r.is_empty()) {
            for row in range.clone() {
                // the one pulse of the comb that this window can feel
                let nearest = ((at(row) - k as f64 * spacing) / period).round().max(0.0) as usize;
                columns[(row - range.start, (nearest * combs + k).min(count - 1))] += response[row];
            }
        }
        let felt: Vec<usize> = (0..count).filter(|&k| columns.column(k).amax() > 0.0).collect();
        Pulses { columns: columns.select_columns(&felt) }
    };
    rows.drives.iter().map(of_drive).collect()
}

/// Solves for nuisances and pulses at some weights: the pulses of a drive are eliminated first.
fn solve(rows: &Rows<'_>, pulses: &[Pulses], at: &[f64], size: f64) -> Option<Solved> {
    let n = rows.nuisances.len();
    let precision = 1.0 / (size * size);
    let mut head = DMatrix::zeros(n, n);
    let mut pull = DVector::zeros(n);
    let mut log_det = 0.0;
    let mut eliminated = Vec::new();
    for (range, own) in rows.drives.iter().zip(pulses) {
        let count = own.columns.ncols();
        let mut matrix = DMatrix::zeros(range.len(), n + count + 1);
        for (row, z) in range.clone().zip(&at[range.clone()]) {
            let root = (KAPPA * (NU + 1.0) / (NU + z * z)).sqrt();
            let local = row - range.start;
            for (k, column) in rows.nuisances.iter().enumerate() {
                matrix[(local, k)] = root * column[row];
            }
            for k in 0..count {
                matrix[(local, n + k)] = root * own.columns[(local, k)];
            }
            matrix[(local, n + count)] = root * rows.residuals[row];
        }
        let gram = matrix.transpose() * &matrix;
        let mut block = gram.view((n, n), (count, count)).into_owned();
        (0..count).for_each(|k| block[(k, k)] += precision);
        let cross = gram.view((n, 0), (count, n)).into_owned();
        let own_pull = gram.view((n, n + count), (count, 1)).into_owned();
        let factor = block.cholesky()?;
        head += gram.view((0, 0), (n, n)) - cross.transpose() * factor.solve(&cross);
        pull += gram.view((0, n + count), (n, 1)) - cross.transpose() * factor.solve(&own_pull);
        log_det += 2.0 * factor.l().diagonal().iter().map(|d| (d * size).ln()).sum::<f64>();
        eliminated.push((factor, cross, own_pull));
    }
    for (k, spring) in rows.springs.iter().enumerate() {
        head[(k, k)] += 1.0 / (spring.sd * spring.sd);
        pull[k] += spring.offset / (spring.sd * spring.sd);
    }
    let factor = head.cholesky()?;
    let moves = -factor.solve(&pull);
    log_det += 2.0 * factor.l().diagonal().iter().map(|d| d.ln()).sum::<f64>();
    let mut residuals = rows.residuals.to_vec();
    for (column, by) in rows.nuisances.iter().zip(moves.iter()) {
        residuals.iter_mut().zip(*column).for_each(|(z, c)| *z += by * c);
    }
    let mut penalty: f64 =
        rows.springs.iter().zip(moves.iter()).map(|(s, m)| 0.5 * ((s.offset + m) / s.sd).powi(2)).sum();
    for ((range, own), (factor, cross, own_pull)) in rows.drives.iter().zip(pulses).zip(&eliminated) {
        let heights = -factor.solve(&(own_pull + cross * &moves));
        penalty += 0.5 * precision * heights.norm_squared();
        let moved = &own.columns * heights;
        residuals[range.clone()].iter_mut().zip(moved.iter()).for_each(|(z, m)| *z += m);
    }
    residuals.iter_mut().zip(rows.residuals).filter(|(_, z)| **z == 0.0).for_each(|(moved, _)| *moved = 0.0);
    let evidence = -data_loss(&residuals) - penalty - 0.5 * log_det;
    Some(Solved { evidence, residuals })
}
