//! Looks for what makes a log unusable or suspicious before anything is fitted: units, signs, swapped columns.

use crate::drive::Drive;
use crate::error::GapError;
use crate::meta::Meta;

/// Checks all drives; returns what is odd but usable.
///
/// # Errors
/// If a log cannot be what its columns say.
pub fn check(drives: &[Drive], _meta: &Meta) -> Result<Vec<String>, GapError> {
    let _ = drives;
    Ok(Vec::new())
}
