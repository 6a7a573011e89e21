//! How much of some drives lies beyond the ranges on which a law was found.

use ds_dynamics::case::{Case, PartModel};
use ds_dynamics::space::Part;
use ds_effect::law::Expression;
use ds_effect::{Law, Port};

use crate::terms::Signals;

/// Returns the share of the samples of some drives at which a signal that a law reads lies beyond the range on which it was found,
/// where a clamped signal counts as at its end and a table is nil; `None` where the law names no range or the drives are none. Slip
/// is not recorded and counts as within.
#[must_use]
pub fn extrapolated_share(case: &Case, law: &Law, drives: &[usize]) -> Option<f64> {
    let ranges = law.ranges();
    if ranges.is_empty() {
        return None;
    }
    let part = if law.port() == Port::Follower { Part::Following } else { Part::Ego };
    let model = PartModel::against(case, part, drives, &[], None);
    let signals = Signals::new(&model, &model.space.neutral());
    let mut beyond: Vec<bool> = Vec::new();
    for (name, [low, high]) in ranges {
        let values = signals.values(&Expression::parse(name).ok()?);
        beyond.resize(beyond.len().max(values.len()), false);
        beyond.iter_mut().zip(values).for_each(|(out, value)| *out |= value < low || value > high);
    }
    (!beyond.is_empty()).then(|| beyond.iter().filter(|out| **out).count() as f64 / beyond.len() as f64)
}
