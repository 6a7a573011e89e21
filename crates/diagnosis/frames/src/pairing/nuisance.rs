//! What the generator alone does: mean and covariance of the statistics over effect-free pairs, and how far one such pair
//! may lie from the others. Learned from a folder of cases; without one, wide values that practice draws gave.

use std::path::Path;

use nalgebra::{DMatrix, DVector};

use crate::case::FrameCase;
use crate::error::SightError;
use crate::pairing::edges;
use crate::pairing::looks::{ALL, MOVED, OWN, Stream, beyond, own};
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
    /// Inverse covariance.
    pub precision: DMatrix<f64>,
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
    pub fn learn(folder: &Path) -> Result<Self, SightError> {
        let mut cases: Vec<_> = std::fs::read_dir(folder)
            .map_err(|source| CaseError::Read { path: folder.to_path_buf(), source })?
            .filter_map(|e| e.ok().map(|e| e.path()))
            .filter(|p| Kind::of(p) == Kind::Frames)
            .collect();
        cases.sort();
        if cases.len() < settings::FEWEST_NUISANCE {
            let found = cases.len();
            return Err(SightError::TooFewNuisance { found, needed: settings::FEWEST_NUISANCE, path: folder.into() });
        }
        let mut rows = Vec::new();
        let mut gaps = [0.0; 2];
        for path in &cases {
            let case = FrameCase::read(path)?;
            let scene = Scene::new(&case);
            rows.push(statistics(&scene, case.pairing.unwrap_or(Pairing::SameLayout)).0);
            for (sum, own) in gaps.iter_mut().zip(crate::how_far::plain_gap(&case)?) {
                *sum += own / cases.len() as f64;
            }
        }
        Ok(Self::of(rows, gaps))
    }

    /// Summarises the statistics of effect-free pairs.
    #[must_use]
    pub fn of(rows: Vec<DVector<f64>>, gap: [f64; 2]) -> Self {
        let all: Vec<&DVector<f64>> = rows.iter().collect();
        let (mean, precision) = moments(&all);
        let left_out = (0..rows.len())
            .map(|k| {
                let others: Vec<&DVector<f64>> = (0..rows.len()).filter(|i| *i != k).map(|i| &rows[i]).collect();
                let (mean, _) = moments(&others);
                &rows[k] - mean
            })
            .collect();
        Self { count: rows.len(), mean, precision, rows: left_out, gap }
    }

    /// The generator of nobody: wide values for streams without effect-free pairs.
    #[must_use]
    pub fn assumed() -> Self {
        let mean = DVector::zeros(ALL);
        let precision = DMatrix::from_diagonal(&DVector::from_fn(ALL, |k, _| 1.0 / (3.0 * least(k)).powi(2)));
        Self { count: 0, mean, precision, rows: Vec::new(), gap: [0.0; 2] }
    }
}

/// Returns the statistics of a scene and what its edges tell.
#[must_use]
pub fn statistics(scene: &Scene<'_>, pairing: Pairing) -> (DVector<f64>, Option<edges::Moved>) {
    let paired = pairing != Pairing::Unpaired;
    let moved = paired.then(|| edges::measured(scene.case));
    // what is late is no other statistic's business
    let simulated = Stream::of(scene, false);
    let simulated = match &moved {
        Some(moved) => simulated.aged(&moved.late.ages),
        None => simulated,
    };
    let mut x = beyond(scene, &simulated, &own(scene, &simulated), &Stream::of(scene, true), paired);
    if let Some(moved) = &moved {
        for (x, v) in x[MOVED..].iter_mut().zip(&moved.values) {
            *x = *v;
        }
    }
    (DVector::from_column_slice(&x), moved)
}

/// Spread that a statistic has at least, whatever few pairs say.
fn least(k: usize) -> f64 {
    match k {
        0..=6 => 0.25,
        7..OWN => 0.06,
        OWN..MOVED => 0.03,
        _ => 0.3,
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
    let precision = covariance.try_inverse().unwrap_or_else(|| DMatrix::identity(ALL, ALL));
    (mean, precision)
}
