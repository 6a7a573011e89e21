//! Fits effects that edit values to the small pictures: robust Gauss-Newton with numeric derivatives, several effects at
//! once. Small pictures average noise and texture away; what is left of texture weighs less.

use ds_effect::frame::FrameEffect;
use ds_effect::picture::Picture;
use nalgebra::{DMatrix, DVector};

use crate::geometry::with_values;
use crate::loss;
use crate::scene::{Model, Scene};

/// Rounds of the fit.
const ROUNDS: usize = 7;
/// Frames looked at.
const FRAMES: usize = 9;

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
