//! A set of clips for reading: opened by its folder, read by index and span of ticks.

use std::path::{Path, PathBuf};

use crate::clip::Clip;
use crate::error::ClipsError;
use crate::index::{ClipInfo, INDEX_FILE, Index};
use crate::shard::{self, Entry, Kinds, Wanted};

/// A finished set of clips.
#[derive(Debug, Clone)]
pub struct ClipSet {
    folder: PathBuf,
    index: Index,
    /// In the order of the index.
    entries: Vec<Entry>,
}

impl ClipSet {
    /// Opens the folder of a finished set.
    ///
    /// # Errors
    /// If the index or a shard is missing or broken.
    pub fn open(folder: &Path) -> Result<Self, ClipsError> {
        let path = folder.join(INDEX_FILE);
        let text = std::fs::read_to_string(&path).map_err(ClipsError::io("index of clips", &path))?;
        let index: Index = serde_json::from_str(&text).map_err(|error| ClipsError::broken(&path, error))?;
        if index.version != 1 || index.shard_clips == 0 {
            return Err(ClipsError::broken(&path, format!("version {} is not known", index.version)));
        }
        let mut entries = Vec::with_capacity(index.clips.len());
        for number in 0..index.clips.len().div_ceil(index.shard_clips) {
            let path = shard::path(folder, number);
            let table = shard::table(&path)?;
            if table.recipe != index.recipe {
                return Err(ClipsError::broken(&path, "it is of another recipe than the index"));
            }
            entries.extend(table.clips);
        }
        if entries.len() != index.clips.len() || entries.iter().zip(&index.clips).any(|(a, b)| a.info != *b) {
            return Err(ClipsError::broken(&path, "index and shards tell different clips"));
        }
        Ok(Self { folder: folder.to_path_buf(), index, entries })
    }

    /// Returns the number of clips.
    #[must_use]
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Says whether there is no clip.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Returns the index: name, recipe, size of pictures, all clips.
    #[must_use]
    pub fn index(&self) -> &Index {
        &self.index
    }

    /// Returns width and height of pictures, in pixels.
    #[must_use]
    pub fn size(&self) -> (u32, u32) {
        (self.index.width_px, self.index.height_px)
    }

    /// Returns what is told of a clip.
    ///
    /// # Panics
    /// If there is no such clip.
    #[must_use]
    pub fn info(&self, clip: usize) -> &ClipInfo {
        &self.index.clips[clip]
    }

    /// Reads `count` ticks of a clip from tick `from` on; of frames and classes those that the clip has.
    ///
    /// # Errors
    /// If there is no such clip or tick, or the shard is broken.
    pub fn read(&self, clip: usize, from: usize, count: usize) -> Result<Clip, ClipsError> {
        self.pictures(clip, from, count, Kinds::All)
    }

    /// Reads a clip as [`ClipSet::read`] does, with layouts and prompt alone: frames and classes stay empty.
    ///
    /// # Errors
    /// As [`ClipSet::read`].
    pub fn layouts(&self, clip: usize, from: usize, count: usize) -> Result<Clip, ClipsError> {
        self.pictures(clip, from, count, Kinds::Layouts)
    }

    fn pictures(&self, clip: usize, from: usize, count: usize, kinds: Kinds) -> Result<Clip, ClipsError> {
        let entry =
            self.entries.get(clip).ok_or(ClipsError::Beyond { what: "clip", asked: clip, count: self.len() })?;
        let ticks = entry.info.ticks;
        if from.checked_add(count).is_none_or(|end| end > ticks) {
            return Err(ClipsError::Beyond { what: "tick", asked: from.saturating_add(count), count: ticks });
        }
        let (width_px, height_px) = self.size();
        let path = shard::path(&self.folder, clip / self.index.shard_clips);
        entry.read(&path, &Wanted { kinds, width_px, height_px, from, count })
    }

    /// Reads a whole clip.
    ///
    /// # Errors
    /// As [`ClipSet::read`].
    pub fn whole(&self, clip: usize) -> Result<Clip, ClipsError> {
        let ticks = self.entries.get(clip).map_or(0, |entry| entry.info.ticks);
        self.read(clip, 0, ticks)
    }
}
