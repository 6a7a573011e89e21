//! 90 % intervals of estimates: what frames and tiles disagree about, what counts may be by chance, and the share by which
//! the shape of an effect in another world differs from the one assumed here (measured on practice draws).

use ds_effect::FrameEffect;
use ds_space::draw::Draws;

use crate::align;
use crate::geometry::moves;
use crate::loss;
use crate::scene::{DETAIL, Scene};
use crate::search::Search;
use crate::{settings, sharp, tone};

/// Half of a 90 % interval in standard deviations.
const HALF: f64 = 1.645;

/// Returns the interval of a chosen effect's value; of others a wide one.
#[must_use]
pub fn of(scene: &Scene<'_>, found: &Search, effect: &'static FrameEffect, values: &[f64]) -> [f64; 2] {
    let value = values[0];
    let size = (value - effect.neutral()[0]).abs();
    let chosen = found.chosen.contains(&effect.id);
    let own = if chosen { own_error(scene, found, effect, values) } else { 0.1 * size };
    let half = HALF * own.hypot(shape_share(effect.id) * size);
    let slab = effect.parameters[0].slab;
    [(value - half).max(slab.0), (value + half).min(slab.1)]
}

/// Standard deviation that these data give.
fn own_error(scene: &Scene<'_>, found: &Search, effect: &'static FrameEffect, values: &[f64]) -> f64 {
    let value = values[0];
    let counted = |n: usize| (value.clamp(0.02, 0.98) * (1.0 - value.clamp(0.02, 0.98)) / n.max(1) as f64).sqrt();
    let frames = scene.frames.len();
    let boxes = |cars: bool| -> usize {
        scene.frames.iter().map(|f| f.boxes.iter().filter(|b| !cars || b.class == "car").count()).sum()
    };
    match effect.id {
        _ if moves(effect) => {
            let fit = align::geometry(scene, &found.field, &found.model.effects);
            let mut at = 0;
            for (e, values) in &fit.effects {
                if e.id == effect.id {
                    return fit.errors[at].max(confounded(scene, effect.id));
                }
                at += values.len();
            }
            0.0
        }
        id if tone::KNOWN.contains(&id) => {
            let fitted: Vec<&str> =
                found.model.effects.iter().map(|(e, _)| e.id).filter(|id| tone::KNOWN.contains(id)).collect();
            let spread = tone::error(scene, &found.model, &found.placed.small, &fitted, effect.id);
            // the gain of every case is told from that of one colour only by the others
            if id == "white_balance" { spread.max(settings::COLOUR_ERROR) } else { spread }
        }
        id if DETAIL.contains(&id) || id == "motion_blur" => detail(scene, found, effect, value),
        "obs_latency" | "condition_delay" => 0.25,
        "dropped_frames" => counted(frames - 1),
        "object_dropout" => counted(boxes(true)),
        "identity_switch" => counted(boxes(false)),
        "object_hallucination" => (value.max(0.05) / frames as f64).sqrt(),
        // each box or object has two coordinates of its own
        "layout_misalignment" => {
            value / (2.0 * found.model.lost.iter().map(Vec::len).max().unwrap_or(1).max(2) as f64).sqrt()
        }
        // noise of every case lies within half a level² or so of the usual one
        "sensor_noise" => 0.6 / value.max(0.5),
        "temporal_flicker" => value / (2.0 * frames as f64).sqrt(),
        _ => 0.0,
    }
}

/// What the constant offset of every case leaves open of a turn of the camera, deg.
fn confounded(scene: &Scene<'_>, id: &str) -> f64 {
    let focal = match id {
        "mount_pitch" => scene.case.camera.fy,
        "mount_yaw" => scene.case.camera.fx,
        _ => return 0.0,
    };
    (settings::CONSTANT_SHIFT_PX / focal).atan().to_degrees()
}

/// Spread of the best value of an effect on fine detail over tiles drawn with repetition.
fn detail(scene: &Scene<'_>, found: &Search, effect: &'static FrameEffect, value: f64) -> f64 {
    let neutral = effect.neutral()[0];
    let steps = [0.8, 0.9, 1.0, 1.1, 1.2].map(|share| neutral + share * (value - neutral));
    let rest = found.model.values(effect.id).map_or_else(Vec::new, |v| v[1..].to_vec());
    let costs: Vec<[f64; loss::TILES]> = steps
        .iter()
        .map(|v| {
            let mut model = found.model.clone();
            let mut values = vec![*v];
            values.extend(&rest);
            model.set(effect, values);
            loss::fine_by_tile(scene, &model, &found.placed)
        })
        .collect();
    let draws = Draws::from_seed(11, "detail_interval");
    let mut squares = 0.0;
    for draw in 0..settings::TILE_DRAWS {
        let mut sums = [0.0; 5];
        for k in 0..loss::TILES as u64 {
            let tile = draws.below(draw * loss::TILES as u64 + k, loss::TILES as u64) as usize;
            for (sum, costs) in sums.iter_mut().zip(&costs) {
                *sum += costs[tile];
            }
        }
        let best = (1..4).min_by(|a, b| sums[*a].total_cmp(&sums[*b])).unwrap_or(2);
        let at = |k: usize| (steps[k], sums[k]);
        let vertex = sharp::parabola(at(best - 1), at(best), at(best + 1));
        squares += (vertex - value).powi(2);
    }
    (squares / settings::TILE_DRAWS as f64).sqrt()
}

/// Standard deviation of the estimate by the shape of the effect, as a share of its size.
fn shape_share(id: &str) -> f64 {
    match id {
        "mount_pitch" | "mount_yaw" | "mount_roll" => 0.004,
        "focal_error" | "radial_distortion" | "vignetting" => 0.012,
        "rolling_shutter" | "mount_position" | "exposure_lag" => 0.07,
        "gamma" => 0.03,
        "white_balance" => 0.05,
        "motion_blur" | "defocus" | "fog_haze" | "sensor_noise" | "night_illumination" | "temporal_flicker" => 0.08,
        "obs_latency" | "condition_delay" => 0.0,
        "lens_dirt" | "rollout_drift" => 0.13,
        "dropped_frames" => 0.05,
        "object_dropout" | "identity_switch" | "object_hallucination" => 0.12,
        "texture_washing" => 0.22,
        _ => 0.15,
    }
}
