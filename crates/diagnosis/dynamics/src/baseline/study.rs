//! One healthy log studied by itself: every parameter fitted under wide priors, and the residuals that are left.

use super::features::{self, FEATURES};
use super::spread::Estimate;
use crate::case::{Case, PartModel};
use crate::search::null_fit;
use crate::space::Part;
use crate::windows::BLOCKS;

/// Factor on the library's spread under which a healthy log is fitted.
const WIDE: f64 = 3.0;

/// One residual of the ego.
#[derive(Debug, Clone, Copy)]
pub struct Row {
    /// Channel, by its place in `Channel::ALL`.
    pub channel: usize,
    /// Block within the window.
    pub block: usize,
    /// Place of its features.
    pub place: usize,
    /// Measured minus simulated, in floor units of the library.
    pub residual: f64,
}

/// What one log says.
#[derive(Debug, Clone)]
pub struct Study {
    /// Estimates of every parameter of both parts, in the order of their spaces; `None` where it has no usual spread.
    pub estimates: [Vec<Option<Estimate>>; 2],
    /// Features of every block of every window.
    pub features: Vec<[f64; FEATURES]>,
    /// Residuals of the ego.
    pub rows: Vec<Row>,
    /// Residuals of the followers: channel, block and value.
    pub followers: Vec<(usize, usize, f64)>,
}

impl Study {
    /// Studies some drives of a healthy case.
    #[must_use]
    pub fn of(case: &Case, drives: &[usize]) -> Self {
        let fits = [Part::Ego, Part::Following].map(|part| {
            let mut model = PartModel::against(case, part, drives, &[], None);
            for coordinate in &mut model.space.coordinates {
                coordinate.nuisance.iter_mut().for_each(|n| n.sd *= WIDE);
            }
            let fit = null_fit(&model, None);
            (model, fit)
        });
        let estimates = fits.each_ref().map(|(model, fit)| {
            let of = |(k, coordinate): (usize, &crate::space::Coordinate)| {
                let n = coordinate.nuisance?;
                let at = fit.free.iter().position(|f| *f == k)?;
                let (variance, wide) = (fit.covariance[(at, at)], n.sd * n.sd);
                let precision = 1.0 / variance - 1.0 / wide;
                let telling = precision > 0.01 / wide;
                let mean = (fit.vector[k] / variance - n.mean / wide) / precision;
                Some(if telling { Estimate { mean, precision } } else { Estimate { mean: n.mean, precision: 0.0 } })
            };
            model.space.coordinates.iter().enumerate().map(of).collect()
        });
        let (ego, following) = (&fits[0], &fits[1]);
        let features = ego.0.records().flat_map(|r| r.anchors.iter().flat_map(|a| features::blocks(r, a))).collect();
        let sliding = ego.0.sliding(&ego.1.vector);
        let present = |z: &f64| *z != 0.0;
        let rows = ego.0.tags.iter().zip(&ego.1.residuals).filter(|(tag, z)| present(z) && !sliding[tag.window]);
        let rows = rows.map(|(tag, z)| Row {
            channel: tag.channel.index(),
            block: tag.block,
            place: tag.window * BLOCKS + tag.block,
            residual: *z,
        });
        let behind = following.0.tags.iter().zip(&following.1.residuals).filter(|(_, z)| present(z));
        Self {
            estimates,
            features,
            rows: rows.collect(),
            followers: behind.map(|(tag, z)| (tag.channel.index(), tag.block, *z)).collect(),
        }
    }
}
