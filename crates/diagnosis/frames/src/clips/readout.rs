//! What one clip says: the statistics of the real stream beyond each simulated one, and what every effect would do to
//! them, which is tried on the clip's own frames.

use ds_effect::FrameChain;
use ds_effect::frame::FrameEffect;
use nalgebra::DVector;

use crate::case::FrameCase;
use crate::clips::Clip;
use crate::error::FramesError;
use crate::how_far::plain_gap;
use crate::pairing::paths::{Path, paths};
use crate::pairing::statistics::{Scope, statistics};
use crate::scene::Scene;
use crate::settings;

/// Statistics of a clip.
pub const COUNT: usize = Scope::Layered.count();

/// What a clip says.
pub struct Readout {
    /// Statistics of the real stream beyond each simulated one, a row per seed.
    pub rows: Vec<DVector<f64>>,
    /// Age of the content against each simulated stream: the effect with its value, if any.
    pub late: Vec<Option<(&'static FrameEffect, f64)>>,
    /// What every effect would do.
    pub paths: Vec<Path>,
    /// Root mean square difference and feature distance of the streams as they are, mean over seeds.
    pub gap: [f64; 2],
    /// What looked odd.
    pub warnings: Vec<String>,
}

impl Readout {
    /// Reads a clip; effects are tried on it where those to leave out are named.
    ///
    /// # Errors
    /// If a file is missing or spoiled.
    pub fn of(clip: &Clip, without: Option<&[String]>) -> Result<Self, FramesError> {
        let streams = clip.streams()?;
        let mut readout =
            Self { rows: Vec::new(), late: Vec::new(), paths: Vec::new(), gap: [0.0; 2], warnings: Vec::new() };
        for stream in &streams {
            let scene = scene(stream);
            let (row, moved) = statistics(&scene, Scope::Layered);
            readout.rows.push(row);
            readout.late.push(moved.and_then(|moved| moved.late.effect));
            for (sum, own) in readout.gap.iter_mut().zip(plain_gap(stream)?) {
                *sum += own / streams.len() as f64;
            }
        }
        readout.warnings.clone_from(&streams[0].warnings);
        if let Some(without) = without {
            readout.paths = tried(&other_seed(&streams), without);
        }
        Ok(readout)
    }

    /// Returns the mean of the rows.
    #[must_use]
    pub fn mean(&self) -> DVector<f64> {
        let mut sum = self.rows[0].clone();
        self.rows[1..].iter().for_each(|row| sum += row);
        sum / self.rows.len() as f64
    }
}

/// Returns the first stream with the second one's simulated frames in the place of real ones.
fn other_seed(streams: &[FrameCase]) -> FrameCase {
    let mut pair = streams[0].clone();
    pair.fit.iter_mut().zip(&streams[1].fit).for_each(|(frame, other)| frame.real.clone_from(&other.sim));
    pair
}

/// Returns what every effect does to the real frames of a stream.
fn tried(stream: &FrameCase, without: &[String]) -> Vec<Path> {
    paths(&scene(stream), &DVector::zeros(COUNT), Scope::Layered, without)
}

/// Share of the way along a displacement at which its response is measured.
const RESPONSE_SHARE: f64 = 0.25;

/// Returns by how much more every effect does to the real frames of an effect-free clip than to its simulated ones, whose
/// texture is another.
///
/// # Errors
/// If a file is missing or spoiled.
pub fn beyond_simulated(clip: &Clip) -> Result<Vec<Path>, FramesError> {
    let streams = clip.streams()?;
    let stream = &streams[0];
    let on_real = tried(stream, &[]);
    let plain = statistics(&scene(stream), Scope::Layered).0;
    // change of the statistics per unit of a parameter, once for both directions
    let mut responses: Vec<(&str, usize, DVector<f64>)> = Vec::new();
    let mut out = tried(&other_seed(&streams), &[]);
    for path in &mut out {
        let end = path.values.len() - 1;
        if path.parameter.is_none() {
            if let Some(other) = on_real.iter().find(|other| other.same_way(path)) {
                path.change.iter_mut().zip(&other.change).for_each(|(own, other)| *own = other - &*own);
            }
            continue;
        }
        let k = path.parameter.unwrap_or(0);
        let way = path.values[end][k] - path.values[0][k];
        let known = responses.iter().find(|known| known.0 == path.effect.id && known.1 == k);
        let per_unit = known.map(|known| known.2.clone()).unwrap_or_else(|| {
            let mut values = path.values[0].clone();
            values[k] += RESPONSE_SHARE * way;
            let moved = statistics(&scene(&displaced(stream, path, values)), Scope::Layered).0;
            (moved - &plain) / (RESPONSE_SHARE * way)
        });
        path.change[end] = &per_unit * way - &path.change[end];
        responses.push((path.effect.id, k, per_unit));
    }
    Ok(out)
}

/// Returns the stream with its real frames displaced.
fn displaced(stream: &FrameCase, path: &Path, values: Vec<f64>) -> FrameCase {
    let mut moved = stream.clone();
    let mut chain = FrameChain::new(&[(path.effect, values)]);
    for (frame, own) in moved.fit.iter_mut().zip(&stream.fit) {
        frame.real = chain.next(&own.real, &stream.context(own, 1, stream.depth_m.as_deref()));
    }
    moved
}

/// Makes the frames of a stream ready, more of them in full size than of a case of one pair.
#[must_use]
pub fn scene(case: &FrameCase) -> Scene<'_> {
    let mut scene = Scene::new(case);
    let count = settings::CLIP_FULL_FRAMES.min(scene.frames.len());
    scene.full = (0..count).map(|k| (2 * k + 1) * scene.frames.len() / (2 * count)).collect();
    scene
}
