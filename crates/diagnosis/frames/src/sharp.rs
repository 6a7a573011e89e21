//! Fits effects that change fine detail (blurs, washing, encoder loss) on full pictures: a grid of values, then a parabola.

use ds_effect::frame::FrameEffect;

use crate::loss::{self, Loss};
use crate::scene::{Model, Placed, Scene};

/// Values tried for each effect.
#[must_use]
pub fn grid(id: &str) -> &'static [&'static [f64]] {
    match id {
        "defocus" => &[&[0.6], &[0.9], &[1.4], &[2.1], &[3.2]],
        "motion_blur" => &[&[6.0], &[12.0], &[20.0], &[32.0]],
        "jpeg_loss" => &[&[15.0], &[25.0], &[35.0], &[50.0], &[65.0], &[78.0]],
        "texture_washing" => {
            &[&[0.3, 8.0], &[0.6, 8.0], &[0.9, 8.0], &[0.3, 16.0], &[0.6, 16.0], &[0.9, 16.0], &[0.8, 30.0]]
        }
        _ => &[],
    }
}

/// Returns the best model with this effect added, and its loss.
#[must_use]
pub fn fit(scene: &Scene<'_>, model: &Model, placed: &Placed, effect: &'static FrameEffect) -> (Model, Loss) {
    let try_values = |values: &[f64]| {
        let mut trial = model.clone();
        trial.set(effect, values.to_vec());
        (loss::fine_only(scene, &trial, placed), trial)
    };
    let grid = grid(effect.id);
    let mut tried: Vec<(f64, f64, Model)> = grid
        .iter()
        .map(|v| {
            let (loss, trial) = try_values(v);
            (v[0], loss, trial)
        })
        .collect();
    let best = (0..tried.len()).min_by(|a, b| tried[*a].1.total_cmp(&tried[*b].1)).unwrap_or(0);
    let rest = grid[best][1..].to_vec();
    let same: Vec<usize> = (0..grid.len()).filter(|k| grid[*k][1..] == rest[..]).collect();
    let at = same.iter().position(|k| *k == best).unwrap_or(0);
    if at > 0 && at + 1 < same.len() {
        let [a, b, c] = [same[at - 1], best, same[at + 1]].map(|k| (tried[k].0.ln(), tried[k].1));
        let vertex = parabola(a, b, c).exp();
        let mut values = vec![vertex];
        values.extend(&rest);
        let (loss, trial) = try_values(&values);
        if loss < tried[best].1 {
            tried[best] = (vertex, loss, trial);
        }
    }
    let (_, _, model) = tried.swap_remove(best);
    let loss = loss::measure(scene, &model, placed);
    (model, loss)
}

/// Moves the first value of an effect to where the finest band likes it best, by halved steps.
#[must_use]
pub fn refined(scene: &Scene<'_>, mut model: Model, placed: &Placed, effect: &'static FrameEffect) -> Model {
    let slab = effect.parameters[0].slab;
    let mut best = loss::fine_only(scene, &model, placed);
    for step in [0.16, 0.08, 0.04, 0.02] {
        for factor in [1.0 + step, 1.0 - step] {
            let mut trial = model.clone();
            let Some(mut values) = model.values(effect.id).map(<[f64]>::to_vec) else { return model };
            values[0] = (values[0] * factor).clamp(slab.0, slab.1);
            trial.set(effect, values);
            let loss = loss::fine_only(scene, &trial, placed);
            if loss < best {
                (best, model) = (loss, trial);
                break;
            }
        }
    }
    model
}

/// Returns where a parabola through three points, in either order, has its lowest value.
#[must_use]
pub fn parabola(a: (f64, f64), b: (f64, f64), c: (f64, f64)) -> f64 {
    let (left, right) = ((b.1 - a.1) / (b.0 - a.0), (c.1 - b.1) / (c.0 - b.0));
    let bend = (right - left) / (c.0 - a.0);
    if bend <= 1e-9 {
        return b.0;
    }
    (0.5 * (a.0 + b.0) - 0.5 * left / bend).clamp(a.0.min(c.0), a.0.max(c.0))
}
