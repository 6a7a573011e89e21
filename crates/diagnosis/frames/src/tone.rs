//! Fits effects that edit values to the small pictures: robust Gauss-Newton with numeric derivatives, several effects at
//! once. Small pictures average noise and texture away; what is left of texture weighs less.

use ds_effect::frame::FrameEffect;
use ds_effect::picture::Picture;
use nalgebra::{DMatrix, DVector};

use crate::geometry::with_values;
use crate::loss;
use crate::scene::{Model, Scene};

/// Effects that are fitted here.
pub const KNOWN: [&str; 7] =
    ["gamma", "white_balance", "vignetting", "fog_haze", "night_illumination", "exposure_lag", "rollout_drift"];

/// Rounds of the fit.
const ROUNDS: usize = 7;
/// Frames looked at.
const FRAMES: usize = 6;

/// Fits the values of the named effects of a model; the others stay.
#[must_use]
pub fn fit(scene: &Scene<'_>, model: &Model, placed: &[Picture], ids: &[&str]) -> (Model, f64) {
    let named = |e: &FrameEffect| ids.contains(&e.id);
    let free: Vec<_> = model.effects.iter().filter(|(e, _)| named(e)).cloned().collect();
    let slabs: Vec<(f64, f64)> = free.iter().flat_map(|(e, _)| e.parameters.iter().map(|p| p.slab)).collect();
    let mut values: Vec<f64> = free.iter().flat_map(|(_, v)| v.clone()).collect();
    let with = |values: &[f64]| {
        let mut out = model.clone();
        for (effect, own) in with_values(&free, values) {
            out.set(effect, own);
        }
        out
    };
    // an effect that remembers needs every frame, the others some
    let timed = ids.contains(&"exposure_lag");
    let count = if timed { placed.len() } else { placed.len().min(FRAMES) };
    let frames: Vec<usize> =
        (0..count).map(|k| (2 * k + 1) * placed.len() / (2 * count)).filter(|k| *k >= model.blind).collect();
    let residual = |values: &[f64]| residuals(scene, &scene.some_small_of(&with(values), placed, &frames), &frames);
    let mut now = residual(&values);
    let mut cost = robust(&now);
    let mut damping = 1e-3f64;
    for _ in 0..ROUNDS {
        let columns: Vec<(Vec<f32>, f64)> = (0..values.len())
            .map(|k| {
                let width = slabs[k].1 - slabs[k].0;
                let step = if values[k] + 0.01 * width > slabs[k].1 { -0.01 } else { 0.01 } * width;
                let mut there = values.clone();
                there[k] += step;
                (residual(&there), step)
            })
            .collect();
        let n = values.len();
        let (mut h, mut g) = (DMatrix::<f64>::zeros(n, n), DVector::<f64>::zeros(n));
        for (i, r) in now.iter().enumerate() {
            let w = 1.0 / (1.0 + f64::from(r * r) / 4.0);
            for a in 0..n {
                let da = f64::from(columns[a].0[i] - r) / columns[a].1;
                g[a] += w * da * f64::from(*r);
                for b in 0..=a {
                    h[(a, b)] += w * da * f64::from(columns[b].0[i] - r) / columns[b].1;
                }
            }
        }
        h.fill_upper_triangle_with_lower_triangle();
        let mut better = false;
        for _ in 0..3 {
            let mut damped = h.clone();
            for k in 0..n {
                damped[(k, k)] += damping * h[(k, k)] + 1e-9;
            }
            let Some(step): Option<DVector<f64>> = damped.cholesky().map(|c| c.solve(&g)) else { break };
            let there: Vec<f64> =
                values.iter().zip(step.iter()).zip(&slabs).map(|((v, s), b)| (v - s).clamp(b.0, b.1)).collect();
            let trial = residual(&there);
            let trial_cost = robust(&trial);
            if trial_cost < cost {
                better = cost - trial_cost > 1e-4 * cost;
                (values, now, cost) = (there, trial, trial_cost);
                damping *= 0.3;
                break;
            }
            damping = damping.max(1e-3) * 10.0;
        }
        if !better {
            break;
        }
    }
    (with(&values), cost)
}

/// Returns the standard deviation of the first value of an effect, from how frames or tiles (whichever disagree more) pull
/// at a fit of the named effects that has come to rest: (H^-1) (sum of g g') (H^-1).
#[must_use]
pub fn error(scene: &Scene<'_>, model: &Model, placed: &[Picture], ids: &[&str], of: &str) -> f64 {
    let free: Vec<_> = model.effects.iter().filter(|(e, _)| ids.contains(&e.id)).cloned().collect();
    let slabs: Vec<(f64, f64)> = free.iter().flat_map(|(e, _)| e.parameters.iter().map(|p| p.slab)).collect();
    let values: Vec<f64> = free.iter().flat_map(|(_, v)| v.clone()).collect();
    let mut before = free.iter().take_while(|(e, _)| e.id != of).map(|(_, v)| v.len());
    let first: usize = before.by_ref().sum();
    let frames: Vec<usize> = (model.blind..placed.len()).collect();
    let residual = |values: &[f64]| {
        let mut trial = model.clone();
        for (effect, own) in with_values(&free, values) {
            trial.set(effect, own);
        }
        residuals(scene, &scene.some_small_of(&trial, placed, &frames), &frames)
    };
    let now = residual(&values);
    let n = values.len();
    let columns: Vec<Vec<f32>> = (0..n)
        .map(|k| {
            let step = 0.01 * (slabs[k].1 - slabs[k].0) * if values[k] + 0.01 > slabs[k].1 { -1.0 } else { 1.0 };
            let mut there = values.clone();
            there[k] += step;
            residual(&there).iter().zip(&now).map(|(t, r)| (t - r) / step as f32).collect()
        })
        .collect();
    let (width, height, c) = (placed[0].width, placed[0].height, placed[0].channels);
    let mut h = DMatrix::<f64>::zeros(n, n);
    let mut pulls = [vec![DVector::<f64>::zeros(n); frames.len()], vec![DVector::<f64>::zeros(n); loss::TILES]];
    for (i, r) in now.iter().enumerate() {
        let w = 1.0 / (1.0 + f64::from(r * r) / 4.0);
        let at = i / c % (width * height);
        let tile = loss::tile(at % width, at / width, width, height);
        for a in 0..n {
            let da = f64::from(columns[a][i]);
            pulls[0][i / (c * width * height)][a] += w * da * f64::from(*r);
            pulls[1][tile][a] += w * da * f64::from(*r);
            for b in 0..n {
                h[(a, b)] += w * da * f64::from(columns[b][i]);
            }
        }
    }
    let Some(inverse) = h.try_inverse() else { return 0.0 };
    let spread = |pulls: &[DVector<f64>]| {
        let m = pulls.len() as f64;
        let mean = pulls.iter().fold(DVector::zeros(n), |s, p| s + p) / m;
        let moved = pulls.iter().map(|p| (&inverse * (p - &mean))[first].powi(2)).sum::<f64>();
        (moved * m / (m - 1.0).max(1.0)).sqrt()
    };
    spread(&pulls[0]).max(spread(&pulls[1]))
}

/// Residuals of small pictures over their expected size; nuisance gain taken out.
#[must_use]
pub fn residuals(scene: &Scene<'_>, rendered: &[Picture], frames: &[usize]) -> Vec<f32> {
    let mut out = Vec::new();
    for (p, k) in rendered.iter().zip(frames) {
        let q = &scene.small[*k].1;
        let gain = loss::gain(p, q);
        let c = p.channels;
        for y in 0..p.height {
            for x in 0..p.width {
                let k = (y * p.width + x) * c;
                let right = k + c * usize::from(x + 1 < p.width);
                let below = k + c * p.width * usize::from(y + 1 < p.height);
                for d in 0..c {
                    let a = p.data[k + d];
                    let slope = (p.data[right + d] - a).abs() + (p.data[below + d] - a).abs();
                    out.push((q.data[k + d] - gain * a) / (1.0 + 0.12 * slope));
                }
            }
        }
    }
    out
}

/// Student-t cost of residuals.
#[must_use]
pub fn robust(residuals: &[f32]) -> f64 {
    residuals.iter().map(|r| f64::from((1.0 + r * r / 4.0).ln())).sum()
}
