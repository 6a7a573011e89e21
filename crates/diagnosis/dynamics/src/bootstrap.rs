//! How a diagnosis draws windows anew: in blocks within their drive.

use ds_space::Draws;
use ds_stats::bootstrap::block_weights;

use crate::settings::BOOTSTRAP_DRAWS;

/// Windows per block: three windows span more than twice the two seconds over which residuals stay alike.
const BLOCK: usize = 3;

/// Draws of how often each window is used; `drives[w]` is the drive of window `w`, drives are contiguous.
#[must_use]
pub fn weights(drives: &[usize], purpose: &str) -> Vec<Vec<f64>> {
    block_weights(drives, BLOCK, BOOTSTRAP_DRAWS, &Draws::from_seed(1, purpose))
}
