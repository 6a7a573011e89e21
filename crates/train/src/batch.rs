//! What the stages share: the step of a batch, PSNR.

use ds_nn::step::Step;
use ds_nn::team::Team;
use ds_raster::RgbImage;

use crate::error::TrainError;

/// Computes the step of a batch, each clip by a worker of its own.
pub(crate) fn mean_step(
    team: &Team,
    clips: usize,
    step: impl Fn(u64) -> Result<Step, TrainError> + Sync,
) -> Result<Step, TrainError> {
    let steps: Result<Vec<_>, _> = team.run(clips, |clip| step(clip as u64)).into_iter().collect();
    steps.map(Step::mean)
}

/// Returns the peak signal-to-noise ratio over all frames, in decibels.
pub(crate) fn psnr_db(expected: &[RgbImage], found: &[RgbImage]) -> f32 {
    let pairs = expected.iter().zip(found).flat_map(|(a, b)| a.rgb().iter().zip(b.rgb()));
    let (mut sum, mut count) = (0.0, 0.0);
    for (a, b) in pairs {
        sum += (f64::from(*a) - f64::from(*b)).powi(2);
        count += 1.0;
    }
    #[expect(clippy::cast_possible_truncation, reason = "a figure for people")]
    let psnr = (10.0 * (255.0f64.powi(2) * count / f64::max(sum, 1e-9)).log10()) as f32;
    psnr
}
