//! Cases of several clips, each with several seeds of the generator: `meta.json` names the folders of the clips, and the
//! `meta.json` of each clip those of its simulated streams. A clip is the unit of every test; what seeds of one clip differ
//! by is the generator's own scatter.
//!
//! Clips are read one after the other, so that a case of many takes no more memory than one of a few.

pub mod bias;
pub mod flips;
pub mod judge;
pub mod readout;
pub mod remains;
pub mod stack;

use std::path::{Path, PathBuf};

use ds_diagnosis::meta::FrameMeta;

use crate::case::FrameCase;
use crate::error::FramesError;
use crate::settings;

/// A case of several clips.
#[derive(Debug, Clone)]
pub struct ClipCase {
    /// Its name.
    pub name: String,
    /// Its clips.
    pub clips: Vec<Clip>,
    /// Folder of effect-free pairs of the same generator, where the case names one.
    pub nuisance: Option<PathBuf>,
}

/// One clip of a case.
#[derive(Debug, Clone)]
pub struct Clip {
    /// Its folder.
    pub folder: PathBuf,
    /// Its simulated streams, relative to its folder.
    pub seeds: Vec<PathBuf>,
}

impl ClipCase {
    /// Tells whether a case folder is of this kind.
    #[must_use]
    pub fn is(folder: &Path) -> bool {
        FrameMeta::read(folder).is_ok_and(|meta| !meta.clips.is_empty() || !meta.seeds.is_empty())
    }

    /// Reads which clips and seeds there are; pictures are read by [`Clip::streams`].
    ///
    /// # Errors
    /// If a description is missing or spoiled, or a clip has too few seeds.
    pub fn read(folder: &Path) -> Result<Self, FramesError> {
        let meta = FrameMeta::read(folder)?;
        let folders = match meta.clips.as_slice() {
            [] => vec![folder.to_path_buf()],
            clips => clips.iter().map(|clip| folder.join(clip)).collect(),
        };
        let clips: Vec<Clip> = folders.into_iter().map(Clip::read).collect::<Result<_, _>>()?;
        Ok(Self { name: meta.case, clips, nuisance: meta.nuisance.map(|n| folder.join(n)) })
    }
}

impl Clip {
    fn read(folder: PathBuf) -> Result<Self, FramesError> {
        let seeds = FrameMeta::read(&folder)?.seeds;
        if seeds.len() < settings::FEWEST_SEEDS {
            return Err(FramesError::TooFewSeeds { found: seeds.len(), needed: settings::FEWEST_SEEDS, path: folder });
        }
        Ok(Self { folder, seeds })
    }

    /// Reads the clip with its first seed.
    ///
    /// # Errors
    /// If a file is missing or spoiled.
    pub fn first(&self) -> Result<FrameCase, FramesError> {
        FrameCase::of_stream(&self.folder, &self.seeds[0])
    }

    /// Reads the clip once per seed.
    ///
    /// # Errors
    /// If a file is missing or spoiled, or seeds do not show the same frames.
    pub fn streams(&self) -> Result<Vec<FrameCase>, FramesError> {
        let streams: Vec<FrameCase> =
            self.seeds.iter().map(|seed| FrameCase::of_stream(&self.folder, seed)).collect::<Result<_, _>>()?;
        let count = |case: &FrameCase| case.fit.len() + case.held.len();
        let expected = streams.iter().map(count).max().unwrap_or(0);
        for (stream, seed) in streams.iter().zip(&self.seeds) {
            if count(stream) < expected {
                let path = self.folder.join(seed);
                return Err(FramesError::MissingFrames { found: count(stream), expected, path });
            }
        }
        Ok(streams)
    }
}
