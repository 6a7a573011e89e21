//! How far the gap shrinks: rms difference and feature distance between real and simulated frames, before and after the
//! correction, beside what an effect-free twin would leave.
//!
//! Nothing is fitted to these frames but the nuisance offset of each, which makes the twin: the nominal frame moved by
//! that offset, with the noise of the case. Frames enter as they are, offsets included. Units grey levels.

use ds_effect::picture::Picture;
use ds_effect::{FrameChain, frame::Act};
use ds_fidelity::{features::features, frechet};
use ds_gap::report::Shrink;
use ds_space::draw::Draws;
use nalgebra::DMatrix;

use crate::blocks::blocks;
use crate::case::{Frame, FrameCase};
use crate::dirt::Map;
use crate::error::SightError;
use crate::geometry::Chosen;
use crate::scene::CHANCE;
use crate::settings;

/// A frozen correction.
pub struct Correction {
    /// Effects with their values.
    pub effects: Chosen,
    /// Constant offset, px.
    pub shift: [f64; 2],
    /// Variance of the noise of real frames, levels².
    pub noise: f64,
    /// Map of a dirty lens.
    pub dirt: Option<Map>,
}

/// Mean squares of one frame.
struct Row {
    before: f64,
    after: f64,
    floor: f64,
}

/// Measures the frames whose numbers are `wanted`.
///
/// # Errors
/// If features are not finite.
pub fn how_far(
    case: &FrameCase,
    correction: &Correction,
    wanted: &dyn Fn(u64) -> bool,
    data: &str,
) -> Result<Vec<Shrink>, SightError> {
    let mut all: Vec<&Frame> = case.fit.iter().chain(&case.held).collect();
    all.sort_by_key(|f| f.number);
    let corrected = corrected(case, correction, &all);
    let mut rows = Vec::new();
    let mut sets: [Vec<Picture>; 4] = Default::default();
    for (frame, after) in all.iter().zip(corrected).filter(|(f, _)| wanted(f.number)) {
        let twin = twin(case, correction, frame, &after);
        let square = |p: &Picture| {
            let sum: f64 = p.data.iter().zip(&frame.real.data).map(|(a, b)| f64::from((a - b).powi(2))).sum();
            sum / p.data.len() as f64
        };
        let moved: f64 = twin.data.iter().zip(&frame.sim.data).map(|(a, b)| f64::from((a - b).powi(2))).sum();
        rows.push(Row { before: square(&frame.sim), after: square(&after), floor: moved / twin.data.len() as f64 });
        for (set, picture) in sets.iter_mut().zip([frame.real.clone(), frame.sim.clone(), after, twin]) {
            set.push(picture);
        }
    }
    if rows.is_empty() {
        return Ok(Vec::new());
    }
    let [real, sim, after, twin] = sets.map(|s| features(&s));
    let distance = |a: &DMatrix<f64>, b: &DMatrix<f64>| frechet(a, b, settings::SHRINKAGE);
    let features = [distance(&real, &sim)?, distance(&real, &after)?, distance(&twin, &sim)?];
    let per_frame = real.nrows() / rows.len();
    let mut shares = Vec::new();
    let draws = Draws::from_seed(7, "frame_bootstrap");
    for draw in 0..settings::FEATURE_DRAWS {
        let picked: Vec<usize> = (0..rows.len())
            .map(|k| draws.below(draw * rows.len() as u64 + k as u64, rows.len() as u64) as usize)
            .flat_map(|f| f * per_frame..(f + 1) * per_frame)
            .collect();
        let [a, b, c, d] = [&real, &sim, &after, &twin].map(|m| m.select_rows(picked.iter()));
        shares.push(share(distance(&a, &b)?, distance(&a, &c)?, distance(&d, &b)?));
    }
    Ok(vec![
        image(&rows, data),
        Shrink {
            metric: "feature_distance".to_owned(),
            before: features[0],
            after: features[1],
            floor: features[2],
            share_explained: share(features[0], features[1], features[2]),
            interval90: interval(shares),
            data: data.to_owned(),
        },
    ])
}

fn image(rows: &[Row], data: &str) -> Shrink {
    let rms = |of: &dyn Fn(&Row) -> f64, picked: &[usize]| {
        (picked.iter().map(|k| of(&rows[*k])).sum::<f64>() / picked.len() as f64).sqrt()
    };
    let figures = |picked: &[usize]| [rms(&|r| r.before, picked), rms(&|r| r.after, picked), rms(&|r| r.floor, picked)];
    let all: Vec<usize> = (0..rows.len()).collect();
    let [before, after, floor] = figures(&all);
    let draws = Draws::from_seed(8, "frame_bootstrap");
    let shares = (0..settings::BOOTSTRAP_DRAWS)
        .map(|draw| {
            let n = rows.len() as u64;
            let picked: Vec<usize> = (0..n).map(|k| draws.below(draw * n + k, n) as usize).collect();
            let [b, a, f] = figures(&picked);
            share(b, a, f)
        })
        .collect();
    Shrink {
        metric: "image_rmse".to_owned(),
        before,
        after,
        floor,
        share_explained: share(before, after, floor),
        interval90: interval(shares),
        data: data.to_owned(),
    }
}

fn share(before: f64, after: f64, floor: f64) -> f64 {
    if before - floor < 0.02 * floor { 0.0 } else { (1.0 - (after - floor) / (before - floor)).clamp(-1.0, 1.2) }
}

fn interval(mut values: Vec<f64>) -> [f64; 2] {
    [ds_gap::bootstrap::quantile(&mut values, 0.05), ds_gap::bootstrap::quantile(&mut values, 0.95)]
}

/// Returns the corrected stream; effects that act by chance, frame by frame, are left out.
fn corrected(case: &FrameCase, correction: &Correction, frames: &[&Frame]) -> Vec<Picture> {
    let foretold = |id: &str| !CHANCE.contains(&id) && id != "dropped_frames";
    let effects: Chosen = correction.effects.iter().filter(|(e, _)| foretold(e.id)).cloned().collect();
    let age = effects.iter().find(|(e, _)| matches!(e.act, Act::Age(_))).map_or(0, |(_, v)| v[0].round() as usize);
    let mut chain = FrameChain::new(&effects);
    let mut out = Vec::new();
    for (k, frame) in frames.iter().enumerate() {
        let context = case.context(frame, 1, case.depth_m.as_deref());
        let grid = crate::warp::Grid::new(&chain, &context, correction.shift);
        let mut picture = chain.edited(grid.apply(&frames[k.saturating_sub(age)].sim), &context);
        if let Some(dirt) = &correction.dirt {
            dirt.apply(&mut picture);
        }
        picture.clip();
        out.push(picture);
    }
    out
}

/// Returns what the real frame would be without any effect: the nominal one with this frame's offset and noise.
fn twin(case: &FrameCase, correction: &Correction, frame: &Frame, after: &Picture) -> Picture {
    let (rendered, real) = (after.grey(), frame.real.grey());
    let found = blocks(&rendered, &real, settings::BLOCK_PX);
    let (mut m, mut v) = ([1.0, 0.0, 1.0], [0.0; 2]);
    for b in found {
        m.iter_mut().zip(&b.info).for_each(|(sum, info)| *sum += info);
        v.iter_mut().zip(&b.pull).for_each(|(sum, pull)| *sum += pull);
    }
    let det = (m[0] * m[2] - m[1] * m[1]).max(1e-9);
    let step = [(m[2] * v[0] - m[1] * v[1]) / det, (m[0] * v[1] - m[1] * v[0]) / det];
    let most = settings::MOST_SHIFT_PX;
    let shift = [0, 1].map(|d| (step[d] + correction.shift[d]).clamp(-most, most));
    let grid = crate::warp::Grid::new(&FrameChain::new(&Vec::new()), &case.context(frame, 1, None), shift);
    let mut picture = grid.apply(&frame.sim);
    let draws = Draws::from_seed(frame.number, "twin_noise");
    let sd = correction.noise.max(0.0).sqrt();
    for (k, value) in (0..).zip(&mut picture.data) {
        *value = (*value + (sd * draws.normal(k)) as f32).clamp(0.0, 255.0);
    }
    picture
}
