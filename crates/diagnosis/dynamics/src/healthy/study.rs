//! Studies one healthy log by itself: every parameter fitted under wide priors, and the residuals that are left.

use crate::baseline::spread::Estimate;
use crate::baseline::study::{Row, Study};
use crate::baseline::{Spread, centre, features};
use crate::case::{Case, PartModel};
use crate::search::{likeliest_start, null_fit_from};
use crate::space::{Coordinate, Part};
use crate::windows::BLOCKS;

/// Factor on the library's spread under which a healthy log is fitted.
const WIDE: f64 = 3.0;

/// Studies some drives of a healthy case, about the library's usual values or about those found before.
pub(super) fn study(case: &Case, drives: &[usize], about: &Spread) -> Study {
    let fits = [Part::Ego, Part::Following].map(|part| {
        let mut model = PartModel::against(case, part, drives, &[], None);
        centre(&mut model.space, about);
        for coordinate in &mut model.space.coordinates {
            coordinate.nuisance.iter_mut().for_each(|n| n.sd *= WIDE);
        }
        let fit = null_fit_from(&model, likeliest_start(&model), None);
        (model, fit)
    });
    let estimates = fits.each_ref().map(|(model, fit)| {
        let of = |(k, coordinate): (usize, &Coordinate)| {
            let n = coordinate.nuisance?;
            let at = fit.free.iter().position(|f| *f == k)?;
            let (variance, wide) = (fit.covariance[(at, at)], n.sd * n.sd);
            let precision = 1.0 / variance - 1.0 / wide;
            let telling = precision > 0.01 / wide;
            // a fit at the end of its range is no middle of anything: freed of its prior it would lie anywhere beyond
            let (low, high) = coordinate.within();
            let mean = ((fit.vector[k] / variance - n.mean / wide) / precision).clamp(low, high);
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
    Study {
        estimates,
        features,
        rows: rows.collect(),
        followers: behind.map(|(tag, z)| (tag.channel.index(), tag.block, *z)).collect(),
    }
}
