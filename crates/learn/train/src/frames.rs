//! Clip sets as frames, for the stages that work on pixels.

use ds_clips::{Clip, ClipSet};
use ds_space::Draws;

use crate::config::TrainConfig;
use crate::error::TrainError;

/// Frames of clip sets, not encoded.
pub(crate) struct Frames(Vec<ClipSet>);

/// Draws a set and a clip of it, each clip of all sets alike, given the clips of each set.
pub(crate) fn pick(counts: impl Iterator<Item = usize> + Clone, draws: &Draws) -> Result<(usize, usize), TrainError> {
    let total: usize = counts.clone().sum();
    if total == 0 {
        return Err(TrainError::empty_sets());
    }
    let mut clip = draws.below(0, total as u64) as usize;
    for (set, count) in counts.enumerate() {
        if clip < count {
            return Ok((set, clip));
        }
        clip -= count;
    }
    unreachable!("the draw is below the sum of all counts")
}

impl Frames {
    pub(crate) fn open(config: &TrainConfig, names: &[String]) -> Result<Self, TrainError> {
        let open = |name: &String| Ok(ClipSet::open(config.set(name)?)?);
        Ok(Self(names.iter().map(open).collect::<Result<_, TrainError>>()?))
    }

    fn pick(&self, draws: &Draws) -> Result<(&ClipSet, usize), TrainError> {
        let (set, clip) = pick(self.0.iter().map(ClipSet::len), draws)?;
        Ok((&self.0[set], clip))
    }

    /// Draws a clip and `count` consecutive frames of it, or all if it has fewer.
    pub(crate) fn draw(&self, draws: &Draws, count: usize) -> Result<Clip, TrainError> {
        let (set, clip) = self.pick(draws)?;
        let frames = set.info(clip).frames;
        let count = count.min(frames);
        Ok(set.read(clip, draws.below(1, (frames - count + 1) as u64) as usize, count)?)
    }

    /// Reads the first `count` frames, or all if there are fewer, of every clip.
    pub(crate) fn beginnings(&self, count: usize) -> impl Iterator<Item = Result<Clip, TrainError>> {
        let of = move |set: &ClipSet, clip| Ok(set.read(clip, 0, count.min(set.info(clip).frames))?);
        self.0.iter().flat_map(move |set| (0..set.len()).map(move |clip| of(set, clip)))
    }

    /// Draws a clip and its first `count` frames, or all if it has fewer.
    pub(crate) fn first(&self, draws: &Draws, count: usize) -> Result<Clip, TrainError> {
        let (set, clip) = self.pick(draws)?;
        Ok(set.read(clip, 0, count.min(set.info(clip).frames))?)
    }
}
