//! What the stages share: the step of a batch, PSNR.

use ds_nn::step::Step;
use ds_nn::team::Team;
use ds_raster::RgbImage;

use crate::config::StageConfig;
use crate::error::TrainError;

/// Computes the step of an update: the mean over `accumulate` micro-batches of `clips` clips, each clip by a worker of
/// its own and counted on from micro-batch to micro-batch. The sum is taken clip by clip, so that two micro-batches give
/// the bits of one batch of twice as many clips; no more than the gradients of one micro-batch and their sum are held.
pub(crate) fn mean_step(
    team: &Team,
    stage: &StageConfig,
    step: impl Fn(u64) -> Result<Step, TrainError> + Sync,
) -> Result<Step, TrainError> {
    let [step] = mean_steps(team, stage, |clip| Ok([step(clip)?]))?;
    Ok(step)
}

/// Computes the steps of several networks that learn from the same clips, as [`mean_step`] does of one.
pub(crate) fn mean_steps<const N: usize>(
    team: &Team,
    stage: &StageConfig,
    steps: impl Fn(u64) -> Result<[Step; N], TrainError> + Sync,
) -> Result<[Step; N], TrainError> {
    let mut sums: Option<[Step; N]> = None;
    for part in 0..stage.accumulate {
        for made in team.run(stage.clips, |clip| steps((part * stage.clips + clip) as u64)) {
            let made = made?;
            match &mut sums {
                None => sums = Some(made),
                Some(sums) => sums.iter_mut().zip(&made).for_each(|(sum, made)| sum.gather(made)),
            }
        }
    }
    Ok(sums.expect("an update has at least one clip").map(|sum| sum.over(stage.batch())))
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
