//! A case of frame streams of either kind: one pair of streams, or several clips with several seeds each.

use std::ops::RangeInclusive;
use std::path::Path;

use ds_diagnosis::schema::{Diagnosis, Shrink};

use crate::case::FrameCase;
use crate::clips::{ClipCase, judge, remains};
use crate::diagnose::{Options, diagnose};
use crate::error::FramesError;
use crate::evaluate::{corrections, evaluate};
use crate::pairing::nuisance::Nuisance;

/// A case of frame streams.
#[derive(Debug, Clone)]
pub enum Streams {
    /// One pair of streams.
    Pair(FrameCase),
    /// Several clips.
    Clips(ClipCase),
}

impl Streams {
    /// Reads a case folder.
    ///
    /// # Errors
    /// If a file is missing, spoiled or absurd.
    pub fn read(folder: &Path) -> Result<Self, FramesError> {
        Ok(if ClipCase::is(folder) {
            Self::Clips(ClipCase::read(folder)?)
        } else {
            Self::Pair(FrameCase::read(folder)?)
        })
    }

    /// Diagnoses the case.
    ///
    /// # Errors
    /// If pictures or effect-free pairs cannot be read, or there is no distance between frames.
    pub fn diagnose(&self, options: &Options) -> Result<Diagnosis, FramesError> {
        match self {
            Self::Pair(case) => diagnose(case, options),
            Self::Clips(case) => {
                let named = match (&options.nuisance, &case.nuisance) {
                    (None, Some(folder)) => Some(Nuisance::learn(folder)?),
                    _ => None,
                };
                judge::judged(case, options.nuisance.as_ref().or(named.as_ref()), &options.without)
            }
        }
    }

    /// Measures how far a diagnosis shrinks the gap on some frames of the case, all of them if no range is given.
    ///
    /// # Errors
    /// If pictures cannot be read, or there is no distance between frames.
    pub fn evaluate(
        &self,
        diagnosis: &Diagnosis,
        frames: Option<RangeInclusive<u64>>,
    ) -> Result<Vec<Shrink>, FramesError> {
        match self {
            Self::Pair(case) => evaluate(diagnosis, case, frames),
            Self::Clips(case) => {
                let (correction, floors) = corrections(diagnosis);
                let wanted = |n: u64| frames.as_ref().is_none_or(|f| f.contains(&n));
                remains::unseen(case, &correction, floors.unwrap_or_default(), &wanted)
            }
        }
    }
}
