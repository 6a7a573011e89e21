//! The anchor: frames that real cameras recorded, looked at by the same policies. Only beside it do distances from a rendered real
//! set say how near anything is to recordings.
//!
//! The unit is the distance of two recorded sets. Recorded frames are few, so covariances are shrunk towards their diagonals, all by the share that
//! the first recorded set asks for (`ds_stats::shrinkage`); such distances are not those of the other tables. The sets hold other moments, so
//! nothing is paired, and they have no intervals: a few consecutive frames are no sample of drives.

use std::collections::BTreeMap;

use ds_fidelity::mean_pooled;
use ds_stats::{Fitted, shrinkage};
use nalgebra::DMatrix;

use super::config::StudyConfig;
use super::features::{Rows, matrix};
use super::found::Found;
use super::outcome::{Anchor, AnchorOf};
use super::panel::Member;
use super::source::Source;
use crate::error::EvaluationError;

/// Distances below this share of a set's variance are rounding.
const LEAST_UNIT: f64 = 1e-9;

/// Looks at all recorded sets: features by set and policy.
///
/// # Errors
/// If a frame cannot be read or a policy cannot look at it.
pub(super) fn look(config: &StudyConfig, panel: &mut [Member]) -> Result<Vec<Vec<DMatrix<f64>>>, EvaluationError> {
    let mut sets = Vec::new();
    for recorded in &config.recorded {
        let frames = recorded.read(&config.path(&recorded.frames))?;
        let camera = recorded.camera(&frames[0]);
        let mut found = Vec::new();
        for member in panel.iter_mut() {
            let mut rows: Rows = Vec::new();
            for frame in &frames {
                let context = member.context(&camera, frame, &recorded.name)?;
                rows.push(mean_pooled(context.tokens.values(), context.tokens.shape()[1]));
            }
            found.push(matrix(&rows));
        }
        sets.push(found);
    }
    Ok(sets)
}

/// Measures all sets from the first recorded one and from the study's real set, in units of the first two recorded ones.
///
/// # Errors
/// If features cannot be compared, or both recorded sets look the same.
pub(super) fn of(found: &Found<'_>, recorded: &[Vec<DMatrix<f64>>]) -> Result<Anchor, EvaluationError> {
    let config = found.config;
    let unit = [0, 1].map(|at: usize| config.recorded[at].name.clone());
    let mut policies = BTreeMap::new();
    for (k, sets) in found.sets.iter().take(found.policies).enumerate() {
        let share = shrinkage(&recorded[0][k]);
        let fit = |rows: &DMatrix<f64>| Fitted::of(rows, share);
        let (first, reference) = (fit(&recorded[0][k])?, fit(&sets.real.all())?);
        let apart = first.frechet(&fit(&recorded[1][k])?)?;
        if apart <= LEAST_UNIT * first.variance() {
            let rule = format!("{:?} and {:?} look the same to {}: no unit", unit[0], unit[1], sets.name);
            return Err(EvaluationError::config("recorded", rule));
        }
        let mut all = BTreeMap::from([(Source::reference().name().to_owned(), reference.clone())]);
        for (set, rows) in config.recorded.iter().zip(recorded).skip(1) {
            all.insert(set.name.clone(), fit(&rows[k])?);
        }
        for (source, rows) in config.sources.iter().zip(&sets.others) {
            all.insert(source.name().to_owned(), fit(&rows.all())?);
        }
        let from = |origin: &Fitted| -> Result<BTreeMap<String, f64>, EvaluationError> {
            all.iter().map(|(name, other)| Ok((name.clone(), origin.frechet(other)? / apart))).collect()
        };
        let table = AnchorOf {
            control: sets.control,
            features: recorded[0][k].ncols(),
            shrinkage: share,
            unit: apart / first.variance(),
            recorded_to: from(&first)?,
            reference_to: from(&reference)?,
        };
        policies.insert(sets.name.clone(), table);
    }
    let mean = |of: &dyn Fn(&AnchorOf) -> &BTreeMap<String, f64>| {
        let panel: Vec<_> = policies.values().filter(|table| !table.control).map(of).collect();
        let one = |name: &String| panel.iter().map(|table| table[name]).sum::<f64>() / panel.len() as f64;
        panel[0].keys().map(|name| (name.clone(), one(name))).collect()
    };
    let frames = config.recorded.iter().zip(recorded);
    Ok(Anchor {
        unit,
        frames: frames.map(|(set, rows)| (set.name.clone(), rows[0].nrows())).collect(),
        recorded_to: mean(&|table| &table.recorded_to),
        reference_to: mean(&|table| &table.reference_to),
        policies,
    })
}
