//! How a diagnosis draws windows anew: in blocks within their drive, or drives first and blocks within them.

use ds_space::Draws;
use ds_stats::bootstrap::{block_weights, staged_weights};

use crate::settings::BOOTSTRAP_DRAWS;

/// Windows per block: three windows span more than twice the two seconds over which residuals stay alike.
const BLOCK: usize = 3;

/// Draws of how often each window is used; `drives[w]` is the drive of window `w`, drives are contiguous.
#[must_use]
pub fn weights(drives: &[usize], purpose: &str) -> Vec<Vec<f64>> {
    block_weights(drives, BLOCK, BOOTSTRAP_DRAWS, &Draws::from_seed(1, purpose))
}

/// The same with the drives drawn as well, for what is said of drives that are still to come.
#[must_use]
pub fn weights_of_drives(drives: &[usize], purpose: &str) -> Vec<Vec<f64>> {
    staged_weights(drives, BLOCK, BOOTSTRAP_DRAWS, &Draws::from_seed(1, purpose))
}
