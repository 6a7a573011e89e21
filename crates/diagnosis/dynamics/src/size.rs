//! How large an effect of known value is in a log, in floor units: which cases a score may fairly demand, and in which cells
//! the effect shows.

use std::collections::BTreeMap;
use std::path::Path;

use ds_diagnosis::{CaseError, meta};
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

/// Folder of a world's twins: the same drives with the same noise without the effects.
const TWINS: &str = "without";

/// Reads a case of a world with its twin; `None` where it has none.
///
/// # Errors
/// If the case or its twin cannot be read.
pub fn with_twin(world: &Path, name: &str) -> Result<Option<[Case; 2]>, CaseError> {
    let twin = world.join(TWINS).join(name);
    if !twin.join(meta::FILE).exists() {
        return Ok(None);
    }
    Ok(Some([Case::read(&world.join(name))?, Case::read(&twin)?]))
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

/// Root mean square difference of residuals in floor units, by channel and drive.
pub type CellSizes = BTreeMap<(Channel, usize), f64>;

/// Returns by how much a case differs from its twin in each channel of each drive, in units of the twin's floor; channels
/// that were not recorded are absent. `None` where the two were not cut into the same windows.
#[must_use]
pub fn twin_cells(case: &Case, twin: &Case) -> Option<CellSizes> {
    // one floor for both: what an effect does to the noise is part of what it does
    let case = Case { noise: twin.noise, ..case.clone() };
    let drives: Vec<usize> = (0..case.drives.len()).collect();
    let mut found = CellSizes::new();
    for part in [Part::Ego, Part::Following] {
        let [a, b] = [&case, twin].map(|c| PartModel::new(c, part, &drives, &[]));
        if a.tags.len() != b.tags.len() {
            return None;
        }
        found.extend(apart(&a, &a.residuals(&a.space.usual()), &b.residuals(&b.space.usual())));
    }
    Some(found)
}

/// Returns the largest root mean square difference of two residuals over channels and drives.
fn largest(model: &PartModel<'_>, a: &[f64], b: &[f64]) -> Option<f64> {
    apart(model, a, b).into_values().reduce(f64::max)
}

/// Returns the root mean square difference of two residuals, where both were measured.
fn apart(model: &PartModel<'_>, a: &[f64], b: &[f64]) -> CellSizes {
    let mut sums: BTreeMap<(Channel, usize), (f64, f64)> = BTreeMap::new();
    // what was not measured is exactly zero
    for ((tag, a), b) in model.tags.iter().zip(a).zip(b).filter(|((_, a), b)| **a != 0.0 && **b != 0.0) {
        let sum = sums.entry((tag.channel, tag.drive)).or_default();
        sum.0 += (a - b).powi(2);
        sum.1 += 1.0;
    }
    sums.into_iter().map(|(cell, (square, count))| (cell, (square / count).sqrt())).collect()
}

#[cfg(test)]
mod tests {
    use ds_effect::Plant;

    use super::*;
    use crate::synthetic;

    #[test]
    fn a_case_differs_from_its_twin_where_its_effect_shows() {
        let case = |edit: &dyn Fn(&mut Plant)| {
            let folder = tempfile::tempdir().expect("a folder");
            synthetic::write_case(folder.path(), 9, edit).expect("the case can be written");
            Case::read(folder.path()).expect("a case")
        };
        let twin = case(&|_| {});
        let biased = case(&|plant| plant.sensors.gyro_bias_rad_s += 0.02);
        let sizes = twin_cells(&biased, &twin).expect("equal windows");
        let beyond: Vec<&(Channel, usize)> =
            sizes.iter().filter(|(_, size)| **size > 1.0).map(|(cell, _)| cell).collect();
        let gyro: Vec<(Channel, usize)> = (0..twin.drives.len()).map(|drive| (Channel::YawRate, drive)).collect();
        assert!(beyond.iter().all(|cell| cell.0 != Channel::Speed), "{sizes:?}");
        assert!(gyro.iter().all(|cell| beyond.contains(&cell)), "{sizes:?}");
        let alike = twin_cells(&twin, &twin).expect("equal windows");
        assert!(alike.len() > gyro.len() && alike.values().all(|size| *size == 0.0), "{alike:?}");
    }
}
