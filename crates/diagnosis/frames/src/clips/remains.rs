//! How far a correction shrinks the gap over all clips of a case, and in which tiles it does; the first seed of each clip
//! stands for the simulated side.

use ds_diagnosis::schema::{Cell, Shrink};
use ds_space::Draws;
use ds_stats::sign_flip;
use rayon::prelude::*;

use crate::clips::ClipCase;
use crate::error::FramesError;
use crate::how_far::{Compared, Correction, shrinks};
use crate::loss::TILES;
use crate::pairing::verdict::{cell, tiles};

/// What a correction leaves.
pub struct Remains {
    /// Shrink on the frames of the fit.
    pub fit: Vec<Shrink>,
    /// Shrink on those kept from it.
    pub held: Vec<Shrink>,
    /// Tiles that the correction touches.
    pub cells: Vec<Cell>,
}

/// Measures a correction; the floors (rms difference, feature distance) are those of effect-free pairs.
///
/// # Errors
/// If a file is missing or spoiled, or features are not finite.
pub fn measured(case: &ClipCase, correction: &Correction, floors: [f64; 2]) -> Result<Remains, FramesError> {
    let clips = case.clips.par_iter().map(|clip| {
        let stream = clip.first()?;
        let [fit, held] = [&stream.fit, &stream.held].map(|frames| {
            let frames: Vec<_> = frames.iter().collect();
            Compared::of(&stream, correction, &frames, floors)
        });
        let span = [stream.fit[0].time_secs, stream.fit[stream.fit.len() - 1].time_secs];
        Ok((fit, held, tiles(&stream, correction), span))
    });
    let clips: Vec<_> = clips.collect::<Result<Vec<_>, FramesError>>()?;
    let mut cells: Vec<Cell> = (0..TILES)
        .filter_map(|t| {
            let over: Vec<[f64; 2]> = clips.iter().map(|(_, _, tiles, _)| tiles[t]).collect();
            let span = clips.first().map_or([0.0; 2], |clip| clip.3);
            cell(t, &over, span, &|over| sign_flip(over, &Draws::from_seed(13, "tiles")).map_or(1.0, |chance| chance.p))
        })
        .collect();
    ds_diagnosis::schema::correct(&mut cells, TILES);
    cells.sort_by(|a, b| b.effect_size.total_cmp(&a.effect_size));
    let (fit, held): (Vec<Compared>, Vec<Compared>) = clips.into_iter().map(|(fit, held, ..)| (fit, held)).unzip();
    Ok(Remains { fit: shrinks(fit, floors, "fit")?, held: shrinks(held, floors, "heldout")?, cells })
}

/// Measures a correction on some frames of every clip, as data `unseen`.
///
/// # Errors
/// As [`measured`].
pub fn unseen(
    case: &ClipCase,
    correction: &Correction,
    floors: [f64; 2],
    wanted: &(dyn Fn(u64) -> bool + Sync),
) -> Result<Vec<Shrink>, FramesError> {
    let clips = case.clips.par_iter().map(|clip| {
        let stream = clip.first()?;
        let frames: Vec<_> = stream.fit.iter().chain(&stream.held).filter(|f| wanted(f.number)).collect();
        Ok(Compared::of(&stream, correction, &frames, floors))
    });
    shrinks(clips.collect::<Result<_, FramesError>>()?, floors, "unseen")
}
