//! What each channel leaves in each of the windows of a drive that share no sample, as far as neither the usual car of a
//! baseline nor the log so far explains it: the mean loss of the innovations, as a logarithm, and their mean.
//!
//! A window is judged by what came before it alone, so that a drive can be scored while it goes on. Windows in which tyres
//! come near their limit tell nothing, nor do those in which the car does what none of the healthy drives did.

use std::sync::Arc;

use nalgebra::DMatrix;

use super::tracker::Tracker;
use crate::baseline::Baseline;
use crate::baseline::windows::{Scored, Sensors};
use crate::case::{Case, PartModel};
use crate::fit::{Model, column, point_loss};
use crate::noise::Noise;
use crate::space::Part;
use crate::windows::{BLOCK, BLOCKS, EGO};
use ds_diagnosis::table::STEP_SECS;

/// Length of a window, s.
pub const WINDOW_SECS: f64 = (BLOCK * BLOCKS) as f64 * STEP_SECS;
/// Least loss that counts: one residual at a hundredth of its floor.
const LEAST: f64 = 1e-4;

/// Scores windows of one log one after another.
pub struct Scorer {
    baseline: Arc<Baseline>,
    sensors: Sensors,
    tracker: Option<Tracker>,
}

impl Scorer {
    /// Begins a log of the vehicle of a baseline.
    #[must_use]
    pub fn new(baseline: Arc<Baseline>) -> Self {
        let sensors = baseline.windows.as_ref().map(|windows| windows.sensors.clone()).unwrap_or_default();
        Self { baseline, sensors, tracker: None }
    }

    /// Returns the scores of those windows of some drives of a case that begin at a time or later, and how many more there are
    /// in which the car does what none of the healthy drives did.
    pub fn take(&mut self, case: &Case, drives: &[usize], from_secs: f64) -> (Vec<Scored>, usize) {
        scored(case, drives, &self.baseline, &self.sensors, &mut self.tracker, from_secs)
    }
}

/// Returns the scores of the windows of some drives of a log.
#[must_use]
pub(crate) fn scores(case: &Case, drives: &[usize], baseline: &Baseline, sensors: &Sensors) -> Vec<Scored> {
    scored(case, drives, baseline, sensors, &mut None, f64::NEG_INFINITY).0
}

fn scored(
    case: &Case,
    drives: &[usize],
    baseline: &Baseline,
    sensors: &Sensors,
    tracker: &mut Option<Tracker>,
    from_secs: f64,
) -> (Vec<Scored>, usize) {
    let apart = case.apart(Noise::from(sensors));
    let model = PartModel::against(&apart, Part::Ego, drives, &[], Some(baseline));
    let usual = model.space.usual();
    let (residuals, sliding, priors) = (model.residuals(&usual), model.sliding(&usual), model.null_priors());
    let spread = |k: usize| model.space.coordinates[k].nuisance.map(|nuisance| (k, nuisance.sd));
    let free: Vec<(usize, f64)> = (0..usual.len()).filter_map(spread).collect();
    let columns: Vec<Vec<f64>> = free.iter().map(|(k, _)| column(&model, &usual, &residuals, *k, priors[*k])).collect();
    let spreads: Vec<f64> = free.iter().map(|(_, sd)| *sd).collect();
    let tracker = tracker.get_or_insert_with(|| Tracker::new(&spreads));
    let anchors = model.records().flat_map(|record| record.anchors.iter().map(move |anchor| (record, anchor)));
    let strange: Vec<bool> = anchors.map(|(record, anchor)| baseline.is_strange(record, anchor)).collect();
    let (mut found, mut passed) = (Vec::new(), 0);
    for (place, rows) in residuals.chunks(EGO * BLOCKS).enumerate() {
        let first = place * EGO * BLOCKS;
        let tag = model.tags[first];
        if tag.secs < from_secs || sliding[tag.window] || strange[tag.window] {
            passed += usize::from(tag.secs >= from_secs && strange[tag.window]);
            continue;
        }
        let derivatives = DMatrix::from_fn(rows.len(), columns.len(), |k, c| columns[c][first + k]);
        let innovations = tracker.take(rows, &derivatives);
        let channels = innovations.chunks(BLOCKS).map(left).collect();
        found.push(Scored { drive: tag.drive, secs: tag.secs + WINDOW_SECS, channels });
    }
    (found, passed)
}

/// Returns what a channel leaves in a window.
fn left(innovations: &[f64]) -> Option<[f64; 2]> {
    let present: Vec<f64> = innovations.iter().copied().filter(|z| *z != 0.0).collect();
    let loss = ds_stats::mean(present.iter().map(|z| point_loss(*z)))?;
    let round = |value: f64| (1e4 * value).round() / 1e4;
    Some([round(loss.max(LEAST).ln()), round(ds_stats::mean(present)?)])
}
