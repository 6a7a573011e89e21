//! What the generator alone does: mean and covariance of the statistics over effect-free pairs, and how far one such pair
//! may lie from the others. Learned from a folder of cases; without one, wide values that practice draws gave.

use std::path::Path;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::case::FrameCase;
use crate::clips::readout::{Readout, beyond_simulated};
use crate::clips::{Clip, ClipCase};
use crate::error::FramesError;
use crate::pairing::looks::{ALL, MOVED, OWN};
use crate::pairing::paths;
use crate::pairing::statistics::{Scope, statistics};
use crate::scene::Scene;
use crate::settings;
use ds_diagnosis::CaseError;
use ds_diagnosis::meta::{Kind, Pairing};

/// What effect-free pairs look like.
#[derive(Debug, Clone)]
pub struct Nuisance {
    /// Pairs seen.
    pub count: usize,
    /// Mean.
    pub mean: DVector<f64>,
    /// Symmetric root of the inverse covariance: brings a deviation to units of the spread.
    pub root: DMatrix<f64>,
    /// Statistics of each clip with several seeds, means over these.
    pub clips: Vec<DVector<f64>>,
    /// By how much more each effect does to real frames of such clips than to simulated ones.
    pub signatures: Vec<paths::Path>,
    /// Statistics of each pair without its own part in the mean, for thresholds.
    pub rows: Vec<DVector<f64>>,
    /// Root mean square difference and feature distance between the streams.
    pub gap: [f64; 2],
}

impl Nuisance {
    /// Learns from the cases of a folder (or one case).
    ///
    /// # Errors
    /// If a case cannot be read, or there are too few.
    pub fn learn(folder: &Path) -> Result<Self, FramesError> {
        let mut cases: Vec<_> = std::fs::read_dir(folder)
            .map_err(|source| CaseError::Read { path: folder.to_path_buf(), source })?
            .filter_map(|e| e.ok().map(|e| e.path()))
            .filter(|p| Kind::of(p) == Kind::Frames)
            .collect();
        cases.sort();
        let mut rows = Vec::new();
        let mut gaps: Vec<[f64; 2]> = Vec::new();
        let mut seeded: Vec<Clip> = Vec::new();
        for path in &cases {
            if ClipCase::is(path) {
                seeded.extend(ClipCase::read(path)?.clips);
            } else {
                let case = FrameCase::read(path)?;
                let scene = Scene::new(&case);
                rows.push(statistics(&scene, Scope::of(case.pairing.unwrap_or(Pairing::SameLayout))).0);
                gaps.push(crate::how_far::plain_gap(&case)?);
            }
        }
        let read: Vec<Readout> = seeded.par_iter().map(|clip| Readout::of(clip, None)).collect::<Result<_, _>>()?;
        gaps.extend(read.iter().map(|clip| clip.gap));
        let clips: Vec<DVector<f64>> = read.iter().map(Readout::mean).collect();
        // a pair has no statistics by layers
        rows.extend(clips.iter().map(|row| row.rows(0, ALL).into_owned()));
        if rows.len() < settings::FEWEST_NUISANCE {
            let found = rows.len();
            return Err(FramesError::TooFewNuisance { found, needed: settings::FEWEST_NUISANCE, path: folder.into() });
        }
        let gap = [0, 1].map(|k| gaps.iter().map(|gap| gap[k]).sum::<f64>() / gaps.len() as f64);
        let tried = &seeded[..seeded.len().min(settings::SIGNATURE_CLIPS)];
        let signatures: Vec<Vec<paths::Path>> = tried.par_iter().map(beyond_simulated).collect::<Result<_, _>>()?;
        Ok(Self { clips, signatures: paths::mean(&signatures), ..Self::of(rows, gap) })
    }

    /// Summarises the statistics of effect-free pairs.
    #[must_use]
    pub fn of(rows: Vec<DVector<f64>>, gap: [f64; 2]) -> Self {
        let all: Vec<&DVector<f64>> = rows.iter().collect();
        let (mean, covariance) = moments(&all);
        let root = inverse_root(covariance);
        let left_out = (0..rows.len())
            .map(|k| {
                let others: Vec<&DVector<f64>> = (0..rows.len()).filter(|i| *i != k).map(|i| &rows[i]).collect();
                let (mean, _) = moments(&others);
                &rows[k] - mean
            })
            .collect();
        Self { count: rows.len(), mean, root, clips: Vec::new(), signatures: Vec::new(), rows: left_out, gap }
    }

    /// The generator of nobody: wide values for streams without effect-free pairs.
    #[must_use]
    pub fn assumed() -> Self {
        let mean = DVector::zeros(ALL);
        let root = DMatrix::from_diagonal(&DVector::from_fn(ALL, |k, _| 1.0 / (3.0 * least(k))));
        Self { count: 0, mean, root, clips: Vec::new(), signatures: Vec::new(), rows: Vec::new(), gap: [0.0; 2] }
    }
}

/// Spread that a statistic has at least, whatever few pairs say.
#[must_use]
pub fn least(k: usize) -> f64 {
    match k {
        0..=6 => 0.25,
        7..OWN => 0.06,
        OWN..MOVED => 0.03,
        MOVED..ALL => 0.3,
        // by layers: brightness of four, then logarithms
        _ if k < ALL + 4 => 0.25,
        _ => 0.06,
    }
}

fn moments(rows: &[&DVector<f64>]) -> (DVector<f64>, DMatrix<f64>) {
    let n = rows.len() as f64;
    let mean = rows.iter().fold(DVector::zeros(ALL), |sum, r| sum + *r) / n;
    let mut covariance = DMatrix::<f64>::zeros(ALL, ALL);
    for row in rows {
        let d = *row - &mean;
        covariance += &d * d.transpose() / (n - 1.0);
    }
    // few pairs: most of what correlates does so by chance
    let keep = n / (n + 3.0 * settings::FEWEST_NUISANCE as f64);
    let widen = (n + 1.0) / (n - 1.0);
    for a in 0..ALL {
        for b in 0..ALL {
            covariance[(a, b)] *= if a == b { widen } else { keep };
        }
        covariance[(a, a)] += least(a).powi(2);
    }
    (mean, covariance)
}

/// Returns the symmetric root of the inverse of a covariance.
#[must_use]
pub fn inverse_root(covariance: DMatrix<f64>) -> DMatrix<f64> {
    let parts = covariance.symmetric_eigen();
    let scales = parts.eigenvalues.map(|variance| 1.0 / variance.max(1e-12).sqrt());
    &parts.eigenvectors * DMatrix::from_diagonal(&scales) * parts.eigenvectors.transpose()
}
