//! How large an effect of known value is in a log, in floor units: which cases a score may fairly demand.

use std::collections::BTreeMap;

use ds_effect::Channel;

use crate::case::{Case, PartModel};
use crate::fit::Model;
use crate::space::Part;

/// Returns the largest root mean square, over channels and drives to fit, of what an effect of a reported value changes
/// in the residuals; `None` for effects that change no mean or are not in the library.
#[must_use]
pub fn effect_size(case: &Case, id: &str, value: f64) -> Option<f64> {
    let part = Part::of(ds_effect::find(id)?);
    let model = PartModel::new(case, part, &case.meta.split().0, &[]);
    let k = model.space.of(model.space.find(id)?)[0];
    let parameter = model.space.coordinates[k].parameter;
    let usual = model.space.usual();
    let mut with = usual.clone();
    let searched = parameter.searched(value, case.meta.nominal.mass);
    with[k] = if parameter.neutral.is_finite() { usual[k] + searched - parameter.neutral } else { searched };
    largest(&model, &model.residuals(&usual), &model.residuals(&with))
}

/// Returns the same of a case against its twin, the same drives with the same noise in a world without the effect: the size
/// of what no library contains.
#[must_use]
pub fn twin_size(case: &Case, twin: &Case) -> Option<f64> {
    let sizes = [Part::Ego, Part::Following].map(|part| {
        let [a, b] = [case, twin].map(|c| PartModel::new(c, part, &c.meta.split().0, &[]));
        let same = a.tags.len() == b.tags.len();
        same.then(|| largest(&a, &a.residuals(&a.space.usual()), &b.residuals(&b.space.usual()))).flatten()
    });
    sizes.into_iter().flatten().fold(None, |most, size| Some(size.max(most.unwrap_or(0.0))))
}

/// Returns the largest root mean square difference of two residuals over channels and drives.
fn largest(model: &PartModel<'_>, a: &[f64], b: &[f64]) -> Option<f64> {
    let mut sums: BTreeMap<(Channel, usize), (f64, f64)> = BTreeMap::new();
    for ((tag, a), b) in model.tags.iter().zip(a).zip(b) {
        let sum = sums.entry((tag.channel, tag.drive)).or_default();
        sum.0 += (a - b).powi(2);
        sum.1 += 1.0;
    }
    sums.values()
        .map(|(square, count)| (square / count).sqrt())
        .fold(None, |most, size| Some(size.max(most.unwrap_or(0.0))))
}
