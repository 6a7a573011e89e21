//! What a diagnosis against a baseline says of the two: whether the case is what the baseline was learned for.

use ds_diagnosis::meta::Nominal;

use crate::baseline::{Baseline, digest_of};
use crate::case::Case;
use crate::drive::Drive;

/// Factor from which on a vehicle is of another size.
const OTHER_SIZE: f64 = 1.2;
/// Share of windows far from all that the healthy drives had from which on that is worth a warning.
const OUTSIDE: f64 = 0.2;

/// Says in which respects a case is not what the baseline was learned for, though nothing forbids to use it: it is one of
/// the healthy logs, its vehicle is of another size, or it is driven as none of them was.
#[must_use]
pub(crate) fn doubts(baseline: &Baseline, case: &Case) -> Vec<String> {
    let known = |drive: &&Drive| baseline.units.digest.contains(&digest_of(drive));
    let (known, all) = (case.drives.iter().filter(known).count(), case.drives.len());
    let own = (known > 0).then(|| {
        format!("the baseline was learned from {known} of the {all} drives: it calls ordinary what is wrong with them")
    });
    let Nominal { mass, lf, lr, .. } = case.meta.nominal;
    let beyond = |value: f64, [low, high]: [f64; 2]| value < low / OTHER_SIZE || value > high * OTHER_SIZE;
    let sizes = [
        ("wheelbase", "m", lf + lr, baseline.wheelbase_m.map(|wheelbase_m| [wheelbase_m; 2])),
        ("mass", "kg", mass, baseline.mass_kg),
    ];
    let other = sizes.into_iter().filter_map(|(what, unit, value, range)| {
        let [low, high] = range.filter(|range| beyond(value, *range))?;
        Some(format!("the {what} is {value:.3} {unit}, the baseline's {low:.3} to {high:.3}: is it of this vehicle?"))
    });
    let outside = baseline.outside_share(&case.ego).filter(|share| *share > OUTSIDE).map(|share| {
        format!("in {:.0} % of the windows the car does what no healthy drive of the baseline has", 100.0 * share)
    });
    own.into_iter().chain(other).chain(outside).collect()
}
