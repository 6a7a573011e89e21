//! How much of some drives lies beyond the ranges on which laws were found.

use std::collections::BTreeMap;

use ds_dynamics::case::{Case, PartModel};
use ds_dynamics::space::Part;
use ds_effect::law::Expression;
use ds_effect::{Law, Port};

use crate::terms::Signals;

/// Returns the share of the samples of some drives at which a signal that the laws read lies beyond the range on which they were
/// found, where a clamped signal counts as at its end and a table is nil; `None` where the laws name no range or the drives are
/// none. Slip is not recorded and counts as within.
#[must_use]
pub fn extrapolated_share(case: &Case, laws: &[Law], drives: &[usize]) -> Option<f64> {
    let mut ranges: BTreeMap<&'static str, [f64; 2]> = BTreeMap::new();
    let of_laws = laws.iter().flat_map(|law| law.terms()).flat_map(|term| term.expression.domains());
    for (name, range) in of_laws.filter_map(|(name, range)| Some((name, range?))) {
        let known = ranges.entry(name).or_insert(range);
        *known = [known[0].min(range[0]), known[1].max(range[1])];
    }
    if ranges.is_empty() {
        return None;
    }
    let follows = laws.iter().any(|law| law.port() == Port::Follower);
    let part = if follows { Part::Following } else { Part::Ego };
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
