//! Fits geometry effects to measured displacements: global parameters, a constant offset and one offset per frame.
//!
//! Robust least squares (Student-t, nu = 4) by Gauss-Newton; per-frame offsets are eliminated frame by frame. A block's
//! information is limited by an error that does not average out within it (resampling). Units px.

use ds_effect::FrameChain;
use ds_effect::frame::{Act, FrameEffect};
use nalgebra::{DMatrix, DVector, Matrix2, Vector2};

use crate::case::{Frame, FrameCase};
use crate::settings;

/// A measured displacement: where in the source a place of the real frame looks.
#[derive(Debug, Clone, Copy)]
pub struct Point {
    /// Place in the frame, px.
    pub at: [f64; 2],
    /// Offset to the source, px.
    pub offset: [f64; 2],
    /// Information (xx, xy, yy), 1/px².
    pub info: [f64; 3],
}

/// Effects with values.
pub type Chosen = Vec<(&'static FrameEffect, Vec<f64>)>;

/// A fit.
#[derive(Clone)]
pub struct Fit {
    /// Geometry effects with their estimates.
    pub effects: Chosen,
    /// Offset of each frame, the constant one included, px.
    pub shifts: Vec<[f64; 2]>,
    /// Negative log posterior.
    pub loss: f64,
    /// Standard errors of the parameters, in order.
    pub errors: Vec<f64>,
}

/// How far offsets may go that are no finding: standard deviations of the constant and of the per-frame part, px.
#[derive(Debug, Clone, Copy)]
pub struct Loose {
    /// Constant over the case.
    pub constant_px: f64,
    /// Per frame.
    pub frame_px: f64,
}

/// Fits the values of `effects` (starting at those given) to the points of each frame.
#[must_use]
pub fn fit(case: &FrameCase, frames: &[&Frame], points: &[Vec<Point>], effects: &Chosen, loose: Loose) -> Fit {
    let mut values: Vec<f64> = effects.iter().flat_map(|(_, v)| v.clone()).collect();
    let slabs: Vec<(f64, f64)> = effects.iter().flat_map(|(e, _)| e.parameters.iter().map(|p| p.slab)).collect();
    let mut constant = [0.0; 2];
    let mut own = vec![[0.0; 2]; frames.len()];
    let mut best: Option<Fit> = None;
    for _ in 0..settings::GEOMETRY_ROUNDS {
        let system = assemble(
            case,
            frames,
            points,
            &Guess { effects, values: &values, slabs: &slabs, constant, own: &own, loose },
        );
        let shifts = own.iter().map(|o| [o[0] + constant[0], o[1] + constant[1]]).collect();
        if best.as_ref().is_some_and(|b| system.loss > b.loss) {
            break;
        }
        let inverse =
            system.hessian.clone().try_inverse().unwrap_or_else(|| DMatrix::zeros(values.len() + 2, values.len() + 2));
        let errors = (0..values.len()).map(|k| inverse[(k, k)].max(0.0).sqrt()).collect();
        best = Some(Fit { effects: with_values(effects, &values), shifts, loss: system.loss, errors });
        let step = inverse * &system.gradient;
        for (k, (value, slab)) in values.iter_mut().zip(&slabs).enumerate() {
            *value = (*value - step[k]).clamp(slab.0, slab.1);
        }
        let global = step.clone();
        for d in 0..2 {
            constant[d] -= step[values.len() + d];
        }
        for (own, (inverse, gradient, cross)) in own.iter_mut().zip(&system.frames) {
            let back = inverse * (gradient - cross.transpose() * &global);
            for d in 0..2 {
                own[d] -= back[d];
            }
        }
    }
    best.unwrap_or_else(|| Fit {
        effects: effects.clone(),
        shifts: vec![[0.0; 2]; frames.len()],
        loss: 0.0,
        errors: vec![0.0; values.len()],
    })
}

/// Replaces the values of effects by a flat list.
#[must_use]
pub fn with_values(effects: &Chosen, values: &[f64]) -> Chosen {
    let mut rest = values;
    effects
        .iter()
        .map(|(e, v)| {
            let (own, after) = rest.split_at(v.len());
            rest = after;
            (*e, own.to_vec())
        })
        .collect()
}

/// Tells whether an effect moves pixels.
#[must_use]
pub fn moves(effect: &FrameEffect) -> bool {
    matches!(effect.act, Act::Warp(_))
}

/// Most parameters of one fit, offsets included.
const MOST: usize = 16;

struct System {
    hessian: DMatrix<f64>,
    gradient: DVector<f64>,
    frames: Vec<(Matrix2<f64>, Vector2<f64>, DMatrix<f64>)>,
    loss: f64,
}

/// Where a fit stands: effects with their values and the ranges of those, and offsets.
struct Guess<'a> {
    effects: &'a Chosen,
    values: &'a [f64],
    slabs: &'a [(f64, f64)],
    constant: [f64; 2],
    own: &'a [[f64; 2]],
    loose: Loose,
}

fn assemble(case: &FrameCase, frames: &[&Frame], points: &[Vec<Point>], guess: &Guess<'_>) -> System {
    let Guess { effects, values, slabs, constant, own, loose } = *guess;
    let size = values.len() + 2;
    let chain = FrameChain::new(&nudged(effects, values, None));
    let steps: Vec<f64> = slabs.iter().map(|s| 1e-3 * (s.1 - s.0)).collect();
    let moved: Vec<FrameChain> =
        (0..values.len()).map(|k| FrameChain::new(&nudged(effects, values, Some((k, steps[k]))))).collect();
    let mut system =
        System { hessian: DMatrix::zeros(size, size), gradient: DVector::zeros(size), frames: Vec::new(), loss: 0.0 };
    let nu = settings::NU;
    let mut hessian = [[0.0; MOST]; MOST];
    for ((frame, points), own) in frames.iter().zip(points).zip(own) {
        let context = case.context(frame, 1, case.depth_m.as_deref());
        let (mut hjj, mut gj, mut hgj) = (Matrix2::zeros(), Vector2::zeros(), DMatrix::zeros(size, 2));
        for point in points {
            let base = chain.source_of(&context, point.at);
            let miss = Vector2::new(
                base[0] - point.at[0] + constant[0] + own[0] - point.offset[0],
                base[1] - point.at[1] + constant[1] + own[1] - point.offset[1],
            );
            let info = limited(point.info);
            let misfit = (info * miss).dot(&miss);
            let weight = settings::BLOCK_SHARE * (nu + 2.0) / (nu + misfit);
            system.loss += settings::BLOCK_SHARE * 0.5 * (nu + 2.0) * (1.0 + misfit / nu).ln();
            let mut jacobian = [[0.0; MOST]; 2];
            for (k, chain) in moved.iter().enumerate() {
                let there = chain.source_of(&context, point.at);
                jacobian[0][k] = (there[0] - base[0]) / steps[k];
                jacobian[1][k] = (there[1] - base[1]) / steps[k];
            }
            (jacobian[0][size - 2], jacobian[1][size - 1]) = (1.0, 1.0);
            let weighted = info * weight;
            let slope = weighted * miss;
            for a in 0..size {
                let pulled = [0, 1].map(|d| jacobian[0][a] * weighted[(0, d)] + jacobian[1][a] * weighted[(1, d)]);
                for b in 0..=a {
                    hessian[a][b] += pulled[0] * jacobian[0][b] + pulled[1] * jacobian[1][b];
                }
                system.gradient[a] += jacobian[0][a] * slope[0] + jacobian[1][a] * slope[1];
                hgj[(a, 0)] += pulled[0];
                hgj[(a, 1)] += pulled[1];
            }
            hjj += weighted;
            gj += slope;
        }
        let tight = 1.0 / (loose.frame_px * loose.frame_px);
        hjj += Matrix2::identity() * tight;
        gj += Vector2::new(own[0], own[1]) * tight;
        system.loss += 0.5 * tight * (own[0] * own[0] + own[1] * own[1]);
        let inverse = hjj.try_inverse().unwrap_or_else(Matrix2::zeros);
        let between = DMatrix::from_column_slice(2, 2, inverse.as_slice());
        system.hessian -= &hgj * &between * hgj.transpose();
        system.gradient -= &hgj * (&between * DVector::from_column_slice(gj.as_slice()));
        system.frames.push((inverse, gj, hgj));
    }
    for (a, row) in hessian.iter().enumerate().take(size) {
        for (b, value) in row.iter().enumerate().take(a + 1) {
            system.hessian[(a, b)] += value;
            if a != b {
                system.hessian[(b, a)] += value;
            }
        }
    }
    let tight = 1.0 / (loose.constant_px * loose.constant_px);
    for (d, offset) in constant.iter().enumerate() {
        system.hessian[(size - 2 + d, size - 2 + d)] += tight;
        system.gradient[size - 2 + d] += offset * tight;
        system.loss += 0.5 * tight * offset * offset;
    }
    for (k, (value, slab)) in values.iter().zip(slabs).enumerate() {
        // a wide normal prior over the slab keeps unseen directions at rest
        let (middle, sd) = (0.5 * (slab.0 + slab.1), slab.1 - slab.0);
        let neutral = if slab.0 <= 0.0 { 0.0 } else { middle };
        system.hessian[(k, k)] += 1.0 / (sd * sd);
        system.gradient[k] += (value - neutral) / (sd * sd);
        system.loss += 0.5 * ((value - neutral) / sd).powi(2);
    }
    system
}

/// Limits a block's information by the error that does not average out within it.
fn limited(info: [f64; 3]) -> Matrix2<f64> {
    let own = settings::BLOCK_ERROR_PX * settings::BLOCK_ERROR_PX;
    let full = Matrix2::new(info[0], info[1], info[1], info[2]);
    // (info^-1 + own)^-1 = (1 + info own)^-1 info, defined even where info is singular
    (Matrix2::identity() + full * own).try_inverse().map_or(full, |m| m * full)
}

fn nudged(effects: &Chosen, values: &[f64], nudge: Option<(usize, f64)>) -> Chosen {
    let mut values = values.to_vec();
    if let Some((k, by)) = nudge {
        values[k] += by;
    }
    with_values(effects, &values)
}
