//! Aligns the streams: age of the content, then displacement coarse to fine, then offsets and geometry for any model.
//!
//! The displacement field is measured once, with pitch, yaw, roll, focal length, position and distortion free as carriers; every
//! geometry hypothesis is then a small fit to that field. Units px.

use ds_effect::picture::Picture;
use ds_effect::{FrameChain, find_frame};

use crate::blocks::blocks;
use crate::geometry::{Chosen, Fit, Loose, Point, fit, moves};
use crate::lag;
use crate::scene::{Model, Scene};
use crate::settings;

/// Effects that carry the alignment, in the order in which they become free.
const CARRIERS: [&str; 6] =
    ["mount_pitch", "mount_yaw", "mount_roll", "focal_error", "mount_position", "radial_distortion"];

/// Ages of all frames and how sure they are.
#[derive(Debug, Clone)]
pub struct Ages {
    /// ln residual variance of each frame (row) at each age (column), relative to age 0.
    pub gain: Vec<Vec<f64>>,
    /// Best age of each frame.
    pub best: Vec<usize>,
    /// Median whole-pixel offset in full size that the coarse search found, px.
    pub start: [f64; 2],
}

/// Finds the age of the content of each frame.
#[must_use]
pub fn ages(scene: &Scene<'_>) -> Ages {
    let half: Vec<(Picture, Picture)> =
        scene.small.iter().map(|(a, b)| (a.grey().shrunk(2), b.grey().shrunk(2))).collect();
    let starts: Vec<[f64; 2]> = half.iter().map(|(a, b)| lag::coarse_shift(a, b, 3)).collect();
    let median = |d: usize| {
        let mut values: Vec<f64> = starts.iter().map(|s| s[d]).collect();
        ds_stats::quantile(&mut values, 0.5)
    };
    let start = [median(0), median(1)];
    let small: Vec<(Picture, Picture)> = scene.small.iter().map(|(a, b)| (a.grey(), b.grey())).collect();
    let mut gain = Vec::new();
    let mut best = Vec::new();
    for k in 0..small.len() {
        let base = lag::mismatch(&small[k].0, &small[k].1, start.map(|s| 2.0 * s)).0;
        let mut row = vec![0.0];
        for age in 1..=lag::OLDEST.min(k) {
            let there = lag::mismatch(&small[k - age].0, &small[k].1, start.map(|s| 2.0 * s)).0;
            // two levels² of noise: frames of a standing vehicle say nothing
            row.push(((base + 2.0) / (there + 2.0)).ln());
        }
        let age = (0..row.len()).max_by(|a, b| row[*a].total_cmp(&row[*b])).unwrap_or(0);
        best.push(if row[age] > settings::AGE_GAIN { age } else { 0 });
        gain.push(row);
    }
    Ages { gain, best, start: start.map(|s| s * 8.0) }
}

/// The measured displacement of all frames.
pub struct Field {
    /// Points of each frame.
    pub points: Vec<Vec<Point>>,
}

/// Measures the displacement of every frame whose content has the given ages.
#[must_use]
pub fn field(scene: &Scene<'_>, ages: &[usize], start: [f64; 2]) -> Field {
    let camera = scene.case.camera;
    let mut model = Model { ages: ages.to_vec(), ..Model::nominal(scene.frames.len()) };
    let mut effects: Chosen = CARRIERS.iter().filter_map(|id| find_frame(id)).map(|e| (e, e.neutral())).collect();
    effects[0].1[0] = (start[1] / camera.fy).atan().to_degrees();
    effects[1].1[0] = (-start[0] / camera.fx).atan().to_degrees();
    let loose = Loose { constant_px: 0.3, frame_px: 0.3 };
    let mut points = Vec::new();
    for (round, (coarse, free)) in [(true, 3), (true, 5), (true, 5), (false, 6), (false, 6)].into_iter().enumerate() {
        let (carrying, rest) = effects.split_at(free);
        let chain = FrameChain::new(&effects);
        points = (0..scene.frames.len()).map(|k| frame_points(scene, &model, &chain, k, coarse)).collect();
        let found = fit(scene.case, &scene.frames, &points, &carrying.to_vec(), loose);
        model.shifts = found.shifts;
        effects = found.effects.into_iter().chain(rest.iter().cloned()).collect();
        if round == 4 {
            break;
        }
    }
    Field { points }
}

fn frame_points(scene: &Scene<'_>, model: &Model, chain: &FrameChain, k: usize, coarse: bool) -> Vec<Point> {
    let context = scene.case.context(scene.frames[k], 1, scene.case.depth_m.as_deref());
    let (rendered, real, factor) = if coarse {
        let small = scene.case.context(scene.frames[k], settings::SMALL, scene.small_depth_m.as_deref());
        let shift = model.shifts[k].map(|s| s / settings::SMALL as f64);
        let source = scene.small[k.saturating_sub(model.ages[k])].0.grey();
        let placed = crate::warp::Grid::new(chain, &small, shift).apply(&source);
        (placed, scene.small[k].1.grey(), settings::SMALL)
    } else {
        (scene.placed_full(model, chain, k), scene.grey[k].1.clone(), 1)
    };
    let size = if coarse { 8 } else { settings::BLOCK_PX };
    let (f, half) = (factor as f64, (factor as f64 - 1.0) / 2.0);
    blocks(&rendered, &real, size)
        .into_iter()
        .map(|b| {
            let at = b.at.map(|v| v * f + half);
            let det = (b.info[0] + 0.5) * (b.info[2] + 0.5) - b.info[1] * b.info[1];
            let step = [
                ((b.info[2] + 0.5) * b.pull[0] - b.info[1] * b.pull[1]) / det,
                ((b.info[0] + 0.5) * b.pull[1] - b.info[1] * b.pull[0]) / det,
            ];
            // beyond two pixels the linear step is no measure
            let (size, most) = (step[0].hypot(step[1]), 2.0);
            let step = if size > most { step.map(|s| s * most / size) } else { step };
            let trust = if size > most { 0.1 } else { 1.0 };
            let from = chain.source_of(&context, at);
            let offset = [0, 1].map(|d| from[d] - at[d] + model.shifts[k][d] + step[d] * f);
            Point { at, offset, info: b.info.map(|i| trust * i / (f * f)) }
        })
        .collect()
}

/// Returns the effects that carry the alignment at their estimates.
#[must_use]
pub fn carried(scene: &Scene<'_>, field: &Field) -> Chosen {
    let effects: Chosen = CARRIERS.iter().filter_map(|id| find_frame(id)).map(|e| (e, e.neutral())).collect();
    fit(scene.case, &scene.frames, &field.points, &effects, Loose { constant_px: 0.3, frame_px: 0.3 }).effects
}

/// Fits the geometry effects of a model to the field, with offsets held to the nuisance.
#[must_use]
pub fn geometry(scene: &Scene<'_>, field: &Field, effects: &Chosen) -> Fit {
    let moving: Chosen = effects.iter().filter(|(e, _)| moves(e)).cloned().collect();
    let loose = Loose { constant_px: settings::CONSTANT_SHIFT_PX, frame_px: settings::FRAME_SHIFT_PX };
    let mut found = fit(scene.case, &scene.frames, &field.points, &moving, loose);
    for shift in &mut found.shifts {
        *shift = shift.map(|s| s.clamp(-settings::MOST_SHIFT_PX, settings::MOST_SHIFT_PX));
    }
    found
}
