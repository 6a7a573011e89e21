//! How far the gap shrinks: rms difference and feature distance between real and simulated frames, before and after the
//! correction, beside what an effect-free twin would leave.
//!
//! Nothing is fitted to these frames but the nuisance offset of each, which makes the twin: the nominal frame moved by
//! that offset, with the noise of the case. Frames enter as they are, offsets included. Units grey levels.

use ds_diagnosis::schema::Shrink;
use ds_effect::picture::Picture;
use ds_effect::{FrameChain, frame::Act};
use ds_fidelity::features::features;
use ds_space::draw::Draws;
use ds_stats::{bootstrap::resamples, frechet};
use nalgebra::DMatrix;

use crate::blocks::blocks;
use crate::case::{Frame, FrameCase};
use crate::dirt::Map;
use crate::error::SightError;
use crate::geometry::Chosen;
use crate::scene::CHANCE;
use crate::settings;

/// Names under which a corrected model keeps the floors of streams that do not agree pixel by pixel.
pub const FLOORS: [&str; 2] = ["floor_image_rmse", "floor_feature_distance"];

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
    let mut rows = Vec::new();
    let mut sets: [Vec<Picture>; 4] = Default::default();
    for (frame, after) in corrected(case, correction, wanted) {
        let (twin, row) = compared(case, correction, frame, &after);
        rows.push(row);
        let twin = noisy(twin, frame.number, correction.noise);
        for (set, picture) in sets.iter_mut().zip([frame.real.clone(), frame.sim.clone(), after, twin]) {
            set.push(picture);
        }
    }
    if rows.is_empty() {
        return Ok(Vec::new());
    }
    let [real, sim, after, twin] = sets.map(|s| features(&s));
    let floor = distance(&twin, &sim)?;
    Ok(vec![image(&rows, data), feature([&real, &sim, &after], floor, rows.len(), data)?])
}

/// Returns the share of the image difference that the correction explains on the wanted frames.
#[must_use]
pub fn image_share(case: &FrameCase, correction: &Correction, wanted: &dyn Fn(u64) -> bool) -> f64 {
    let rows: Vec<Row> = corrected(case, correction, wanted)
        .into_iter()
        .map(|(frame, after)| compared(case, correction, frame, &after).1)
        .collect();
    if rows.is_empty() { 0.0 } else { image(&rows, "fit").share_explained }
}

/// Measures streams that do not agree pixel by pixel; the floors (rms difference, feature distance) are those of
/// effect-free pairs.
///
/// # Errors
/// If features are not finite.
pub fn generated(
    case: &FrameCase,
    correction: &Correction,
    wanted: &dyn Fn(u64) -> bool,
    floors: [f64; 2],
    data: &str,
) -> Result<Vec<Shrink>, SightError> {
    let frames: Vec<&Frame> = case.fit.iter().chain(&case.held).filter(|f| wanted(f.number)).collect();
    if frames.is_empty() {
        return Ok(Vec::new());
    }
    let after = rendered(case, correction, &frames);
    let rows: Vec<Row> = frames
        .iter()
        .zip(&after)
        .map(|(f, after)| Row {
            before: square(&f.sim, &f.real),
            after: square(after, &f.real),
            floor: floors[0] * floors[0],
        })
        .collect();
    let set = |of: &dyn Fn(&Frame) -> Picture| features(&frames.iter().map(|f| of(f)).collect::<Vec<_>>());
    let (real, sim) = (set(&|f| f.real.clone()), set(&|f| f.sim.clone()));
    let feature = feature([&real, &sim, &features(&after)], floors[1], rows.len(), data)?;
    Ok(vec![image(&rows, data), feature])
}

/// Returns the rms difference and the feature distance between the streams of a case as they are.
///
/// # Errors
/// If features are not finite.
pub fn plain_gap(case: &FrameCase) -> Result<[f64; 2], SightError> {
    let frames: Vec<&Frame> = case.held.iter().collect();
    let mean = frames.iter().map(|f| square(&f.sim, &f.real)).sum::<f64>() / frames.len().max(1) as f64;
    let set = |of: &dyn Fn(&Frame) -> Picture| features(&frames.iter().map(|f| of(f)).collect::<Vec<_>>());
    Ok([mean.sqrt(), distance(&set(&|f| f.real.clone()), &set(&|f| f.sim.clone()))?])
}

fn square(p: &Picture, q: &Picture) -> f64 {
    p.data.iter().zip(&q.data).map(|(a, b)| f64::from((a - b).powi(2))).sum::<f64>() / p.data.len() as f64
}

fn distance(a: &DMatrix<f64>, b: &DMatrix<f64>) -> Result<f64, SightError> {
    Ok(frechet(a, b, settings::SHRINKAGE)?)
}

/// The feature distance of the real stream to the simulated one before and after, with an interval over frames.
fn feature(
    [real, sim, after]: [&DMatrix<f64>; 3],
    floor: f64,
    frames: usize,
    data: &str,
) -> Result<Shrink, SightError> {
    let (before, left) = (distance(real, sim)?, distance(real, after)?);
    let per_frame = real.nrows() / frames;
    let mut shares = Vec::new();
    let draws = Draws::from_seed(7, "frame_bootstrap");
    for picks in resamples(&draws, settings::FEATURE_DRAWS, frames) {
        let picked: Vec<usize> = picks.into_iter().flat_map(|f| f * per_frame..(f + 1) * per_frame).collect();
        let [a, b, c] = [real, sim, after].map(|m| m.select_rows(picked.iter()));
        shares.push(share(distance(&a, &b)?, distance(&a, &c)?, floor));
    }
    Ok(Shrink {
        metric: "feature_distance".to_owned(),
        before,
        after: left,
        floor,
        share_explained: share(before, left, floor),
        interval90: interval(shares),
        data: data.to_owned(),
    })
}

fn image(rows: &[Row], data: &str) -> Shrink {
    let rms = |of: &dyn Fn(&Row) -> f64, picked: &[usize]| {
        (picked.iter().map(|k| of(&rows[*k])).sum::<f64>() / picked.len() as f64).sqrt()
    };
    let figures = |picked: &[usize]| [rms(&|r| r.before, picked), rms(&|r| r.after, picked), rms(&|r| r.floor, picked)];
    let all: Vec<usize> = (0..rows.len()).collect();
    let [before, after, floor] = figures(&all);
    let draws = Draws::from_seed(8, "frame_bootstrap");
    let shares = resamples(&draws, settings::BOOTSTRAP_DRAWS, rows.len())
        .map(|picked| {
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
    [ds_stats::quantile(&mut values, 0.05), ds_stats::quantile(&mut values, 0.95)]
}

/// Returns the corrected frames that are wanted; effects that act by chance, frame by frame, are left out.
fn corrected<'a>(
    case: &'a FrameCase,
    correction: &Correction,
    wanted: &dyn Fn(u64) -> bool,
) -> Vec<(&'a Frame, Picture)> {
    let foretold = |id: &str| !CHANCE.contains(&id) && id != "dropped_frames";
    let effects: Chosen = correction.effects.iter().filter(|(e, _)| foretold(e.id)).cloned().collect();
    let age = effects.iter().find(|(e, _)| matches!(e.act, Act::Age(_))).map_or(0, |(_, v)| v[0].round() as usize);
    let mut frames: Vec<&Frame> = case.fit.iter().chain(&case.held).collect();
    frames.sort_by_key(|f| f.number);
    let mut chain = FrameChain::new(&effects);
    let mut out = Vec::new();
    for (k, frame) in frames.iter().enumerate() {
        let context = case.context(frame, 1, case.depth_m.as_deref());
        if !wanted(frame.number) {
            chain.pass(&context);
            continue;
        }
        let grid = crate::warp::Grid::new(&chain, &context, correction.shift);
        let mut picture = chain.edited(grid.apply(&frames[k.saturating_sub(age)].sim), &context);
        if let Some(dirt) = &correction.dirt {
            dirt.apply(&mut picture);
        }
        picture.clip();
        out.push((*frame, picture));
    }
    out
}

/// Returns frames through every effect of a correction, those by chance included.
#[must_use]
pub fn rendered(case: &FrameCase, correction: &Correction, frames: &[&Frame]) -> Vec<Picture> {
    let mut chain = FrameChain::new(&correction.effects);
    let through = |f: &&Frame| {
        let mut picture = chain.next(&f.sim, &case.context(f, 1, case.depth_m.as_deref()));
        picture.clip();
        picture
    };
    frames.iter().map(through).collect()
}

/// Returns what the real frame would be without any effect (the nominal one with this frame's offset, before noise), and
/// the mean squares of the frame.
fn compared(case: &FrameCase, correction: &Correction, frame: &Frame, after: &Picture) -> (Picture, Row) {
    let (grey, real) = (after.grey(), frame.real.grey());
    let found = blocks(&grey, &real, settings::BLOCK_PX);
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
    let twin = grid.apply(&frame.sim);
    let floor = square(&twin, &frame.sim) + correction.noise.max(0.0);
    let row = Row { before: square(&frame.sim, &frame.real), after: square(after, &frame.real), floor };
    (twin, row)
}

/// Adds the noise of the case.
fn noisy(mut twin: Picture, seed: u64, variance: f64) -> Picture {
    let draws = Draws::from_seed(seed, "twin_noise");
    let sd = variance.max(0.0).sqrt();
    for (k, value) in (0..).zip(&mut twin.data) {
        *value = (*value + (sd * draws.normal(k)) as f32).clamp(0.0, 255.0);
    }
    twin
}
