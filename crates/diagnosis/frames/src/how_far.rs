//! How far the gap shrinks: rms difference and feature distance between real and simulated frames as they are, with the
//! constant offset corrected alone, and with the effects added as well, beside what an effect-free twin would leave.
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
use crate::error::FramesError;
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

impl Correction {
    /// Returns the ordinary mismatch of this correction, without its effects.
    fn mismatch(&self) -> Self {
        Self { effects: Vec::new(), shift: self.shift, noise: self.noise, dirt: None }
    }
}

/// Mean squares of one frame: nominal, with the ordinary mismatch, corrected, floor.
pub(crate) type Row = [f64; 4];

/// Measures the frames whose numbers are `wanted`.
///
/// # Errors
/// If features are not finite.
pub fn how_far(
    case: &FrameCase,
    correction: &Correction,
    wanted: &dyn Fn(u64) -> bool,
    data: &str,
) -> Result<Vec<Shrink>, FramesError> {
    let (rows, sets) = states(case, correction, wanted);
    if rows.is_empty() {
        return Ok(Vec::new());
    }
    let [real, sim, shifted, after, twin] = sets.map(|s| features(&s));
    let floor = distance(&twin, &sim)?;
    Ok(vec![image(&rows, data), feature(&real, [&sim, &shifted, &after], floor, rows.len(), data)?])
}

/// Returns what is measured on each wanted frame, and these frames: real, simulated, with the ordinary mismatch,
/// corrected, and the effect-free twin.
pub(crate) fn states(
    case: &FrameCase,
    correction: &Correction,
    wanted: &dyn Fn(u64) -> bool,
) -> (Vec<Row>, [Vec<Picture>; 5]) {
    let mut rows = Vec::new();
    let mut sets: [Vec<Picture>; 5] = Default::default();
    let shifted = corrected(case, &correction.mismatch(), wanted);
    for ((frame, after), (_, shifted)) in corrected(case, correction, wanted).into_iter().zip(shifted) {
        let (twin, row) = compared(case, correction, frame, [&shifted, &after]);
        rows.push(row);
        let twin = noisy(twin, frame.number, correction.noise);
        for (set, picture) in sets.iter_mut().zip([frame.real.clone(), frame.sim.clone(), shifted, after, twin]) {
            set.push(picture);
        }
    }
    (rows, sets)
}

/// Returns the share of the image difference that the effects explain on the wanted frames.
#[must_use]
pub fn image_share(case: &FrameCase, correction: &Correction, wanted: &dyn Fn(u64) -> bool) -> Option<f64> {
    let shifted = corrected(case, &correction.mismatch(), wanted);
    let rows: Vec<Row> = corrected(case, correction, wanted)
        .into_iter()
        .zip(shifted)
        .map(|((frame, after), (_, shifted))| compared(case, correction, frame, [&shifted, &after]).1)
        .collect();
    image((!rows.is_empty()).then_some(&rows)?, "fit").share_explained
}

/// Frames of streams that do not agree pixel by pixel, compared: as they are and with the effects added.
pub struct Compared {
    rows: Vec<Row>,
    /// Features of the real, the simulated and the corrected frames.
    features: [DMatrix<f64>; 3],
}

impl Compared {
    /// Compares some frames of a case. No ordinary mismatch is fitted to these: its state is the nominal one.
    #[must_use]
    pub fn of(case: &FrameCase, correction: &Correction, frames: &[&Frame], floors: [f64; 2]) -> Self {
        let after = rendered(case, correction, frames);
        let row = |(f, after): (&&Frame, &Picture)| {
            let before = square(&f.sim, &f.real);
            [before, before, square(after, &f.real), floors[0] * floors[0]]
        };
        let set = |of: &dyn Fn(&Frame) -> Picture| features(&frames.iter().map(|f| of(f)).collect::<Vec<_>>());
        let features = [set(&|f| f.real.clone()), set(&|f| f.sim.clone()), features(&after)];
        Self { rows: frames.iter().zip(&after).map(row).collect(), features }
    }
}

/// Measures what was compared, of one case or of several clips; the floors (rms difference, feature distance) are those of
/// effect-free pairs.
///
/// # Errors
/// If features are not finite.
pub fn shrinks(compared: Vec<Compared>, floors: [f64; 2], data: &str) -> Result<Vec<Shrink>, FramesError> {
    let compared: Vec<Compared> = compared.into_iter().filter(|part| !part.rows.is_empty()).collect();
    let rows: Vec<Row> = compared.iter().flat_map(|part| part.rows.iter().copied()).collect();
    let Some(columns) = compared.first().map(|part| part.features[0].ncols()) else { return Ok(Vec::new()) };
    let [real, sim, after] = [0, 1, 2].map(|k| {
        let parts = compared.iter().flat_map(|part| part.features[k].row_iter().collect::<Vec<_>>());
        let parts: Vec<_> = parts.collect();
        DMatrix::from_fn(parts.len(), columns, |row, column| parts[row][column])
    });
    let feature = feature(&real, [&sim, &sim, &after], floors[1], rows.len(), data)?;
    Ok(vec![image(&rows, data), feature])
}

/// Measures the wanted frames of a case whose streams do not agree pixel by pixel.
///
/// # Errors
/// As [`shrinks`].
pub fn generated(
    case: &FrameCase,
    correction: &Correction,
    wanted: &dyn Fn(u64) -> bool,
    floors: [f64; 2],
    data: &str,
) -> Result<Vec<Shrink>, FramesError> {
    let frames: Vec<&Frame> = case.fit.iter().chain(&case.held).filter(|f| wanted(f.number)).collect();
    shrinks(vec![Compared::of(case, correction, &frames, floors)], floors, data)
}

/// Returns the rms difference and the feature distance between the streams of a case as they are.
///
/// # Errors
/// If features are not finite.
pub fn plain_gap(case: &FrameCase) -> Result<[f64; 2], FramesError> {
    let frames: Vec<&Frame> = case.held.iter().collect();
    let mean = frames.iter().map(|f| square(&f.sim, &f.real)).sum::<f64>() / frames.len().max(1) as f64;
    let set = |of: &dyn Fn(&Frame) -> Picture| features(&frames.iter().map(|f| of(f)).collect::<Vec<_>>());
    Ok([mean.sqrt(), distance(&set(&|f| f.real.clone()), &set(&|f| f.sim.clone()))?])
}

fn square(p: &Picture, q: &Picture) -> f64 {
    p.data.iter().zip(&q.data).map(|(a, b)| f64::from((a - b).powi(2))).sum::<f64>() / p.data.len() as f64
}

fn distance(a: &DMatrix<f64>, b: &DMatrix<f64>) -> Result<f64, FramesError> {
    Ok(frechet(a, b, settings::SHRINKAGE)?)
}

/// The feature distance of the real stream to the simulated one in its three states, with an interval over frames.
fn feature(
    real: &DMatrix<f64>,
    states: [&DMatrix<f64>; 3],
    floor: f64,
    frames: usize,
    data: &str,
) -> Result<Shrink, FramesError> {
    let figures = |picked: Option<&[usize]>| -> Result<[f64; 4], FramesError> {
        let of = |m: &DMatrix<f64>| picked.map_or_else(|| m.clone(), |rows| m.select_rows(rows.iter()));
        let real = of(real);
        let mut found = [0.0, 0.0, 0.0, floor];
        for (k, state) in states.iter().enumerate() {
            // one state may be another
            let known = (0..k).find(|earlier| std::ptr::eq(states[*earlier], *state)).map(|earlier| found[earlier]);
            found[k] = known.map_or_else(|| distance(&real, &of(state)), Ok)?;
        }
        Ok(found)
    };
    let per_frame = real.nrows() / frames;
    let draws = Draws::from_seed(7, "frame_bootstrap");
    let drawn: Vec<[f64; 4]> = resamples(&draws, settings::FEATURE_DRAWS, frames)
        .map(|picks| {
            let picked: Vec<usize> = picks.into_iter().flat_map(|f| f * per_frame..(f + 1) * per_frame).collect();
            figures(Some(&picked))
        })
        .collect::<Result<_, _>>()?;
    Ok(Shrink::new("feature_distance", figures(None)?, &drawn, data))
}

fn image(rows: &[Row], data: &str) -> Shrink {
    let figures = |picked: &[usize]| {
        [0, 1, 2, 3].map(|k| (picked.iter().map(|row| rows[*row][k]).sum::<f64>() / picked.len() as f64).sqrt())
    };
    let draws = Draws::from_seed(8, "frame_bootstrap");
    let drawn: Vec<[f64; 4]> =
        resamples(&draws, settings::BOOTSTRAP_DRAWS, rows.len()).map(|picked| figures(&picked)).collect();
    Shrink::new("image_rmse", figures(&(0..rows.len()).collect::<Vec<_>>()), &drawn, data)
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
fn compared(
    case: &FrameCase,
    correction: &Correction,
    frame: &Frame,
    [shifted, after]: [&Picture; 2],
) -> (Picture, Row) {
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
    let [before, nuisance, after] = [&frame.sim, shifted, after].map(|picture| square(picture, &frame.real));
    (twin, [before, nuisance, after, floor])
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
