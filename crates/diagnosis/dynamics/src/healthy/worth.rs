//! What makes a baseline worth little: the same drive twice, logs of several vehicles.

use std::collections::BTreeMap;

use ds_diagnosis::CaseError;

use super::Unit;
use crate::baseline::Baseline;

/// Evidence from which on an effect that must exceed it is hardly ever seen.
const BLIND: f64 = 30.0;

/// Refuses the same drive twice: two alike have no spread.
pub(super) fn apart(units: &[Unit<'_>]) -> Result<(), CaseError> {
    let mut seen: BTreeMap<String, &str> = BTreeMap::new();
    for unit in units {
        for digest in unit.digests() {
            if let Some(one) = seen.insert(digest, &unit.name) {
                return Err(CaseError::SameLog { one: one.to_owned(), other: unit.name.clone() });
            }
        }
    }
    Ok(())
}

/// Says why a baseline may be of little worth.
pub(super) fn doubts(baseline: &Baseline) -> Vec<String> {
    let blind = baseline.detection_limits.iter().filter(|(_, gain)| **gain > BLIND).map(|(name, gain)| {
        format!("this baseline hardly sees an effect ({name} must exceed {gain:.0}): these logs are not of one vehicle")
    });
    let hashes = baseline.nominal_hash.len();
    let mixed = (hashes > 1).then(|| {
        format!("the healthy logs have {hashes} nominal simulators: what each vehicle has of its own is called ordinary of all")
    });
    blind.chain(mixed).collect()
}
