//! What the stages share: the step of a batch, PSNR.

use ds_nn::step::{Joins, Step};
use ds_nn::team::Team;
use ds_raster::RgbImage;
use ds_video::Backend;

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

/// Clips drawn for micro-batches, and the steps that are computed from them: on a processor clip by clip, each by a
/// worker, as [`mean_step`]; on a device all clips of a micro-batch at once, while the processor draws the next ones.
pub(crate) struct Drawn<'a, T> {
    backend: Backend,
    team: Team,
    stage: &'a StageConfig,
    /// The micro-batch after the last one that was taken, by its number since the first step.
    ahead: Option<(u64, Result<Joined<T>, TrainError>)>,
}

/// Clips that were joined, with each how many.
pub(crate) type Joined<T> = Vec<(usize, T)>;

impl<'a, T: Joins + Send + Sync> Drawn<'a, T> {
    pub(crate) fn new(backend: Backend, stage: &'a StageConfig) -> Self {
        Self { backend, team: Team::of_all_cores(), stage, ahead: None }
    }

    /// Computes the step of update `at`: the mean over its clips. `draw` makes a clip by the update and its number.
    pub(crate) fn step(
        &mut self,
        at: u32,
        draw: impl Fn(u32, u64) -> Result<T, TrainError> + Sync,
        compute: impl Fn(&T) -> Step + Sync,
    ) -> Result<Step, TrainError> {
        if !self.backend.joins() {
            return mean_step(&self.team, self.stage, |clip| Ok(compute(&draw(at, clip)?)));
        }
        let (clips, parts) = (self.stage.clips, self.stage.accumulate as u64);
        let drawn = |number: u64| -> Result<Joined<T>, TrainError> {
            let (at, part) = ((number / parts) as u32, number % parts);
            let drawn = self.team.run(clips, |clip| draw(at, part * clips as u64 + clip as u64));
            Ok(joined(drawn.into_iter().collect::<Result<_, _>>()?))
        };
        let mut sum: Option<Step> = None;
        let mut ahead = self.ahead.take();
        for number in u64::from(at) * parts..(u64::from(at) + 1) * parts {
            let made = match ahead.take() {
                Some((known, made)) if known == number => made?,
                _ => drawn(number)?,
            };
            std::thread::scope(|scope| {
                let next = scope.spawn(|| drawn(number + 1));
                for (count, joined) in &made {
                    #[expect(clippy::cast_precision_loss, reason = "a batch has few clips")]
                    let step = compute(joined).shared(*count as f32 / clips as f32);
                    match &mut sum {
                        None => sum = Some(step),
                        Some(sum) => sum.gather(&step),
                    }
                }
                ahead = Some((number + 1, next.join().expect("a draw does not panic")));
            });
        }
        self.ahead = ahead;
        Ok(sum.expect("an update has at least one clip").over(self.stage.accumulate))
    }
}

/// Joins the clips that join, in the order of their first ones.
pub(crate) fn joined<T: Joins>(mut clips: Vec<T>) -> Joined<T> {
    let mut made = Vec::new();
    while let Some(first) = clips.first() {
        let fits: Vec<bool> = clips.iter().map(|clip| first.joins(clip)).collect();
        let mut fits = fits.into_iter();
        let (together, others): (Vec<T>, Vec<T>) = clips.into_iter().partition(|_| fits.next() == Some(true));
        made.push((together.len(), T::joined(&together)));
        clips = others;
    }
    made
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
