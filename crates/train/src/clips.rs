//! Clips: frames with their layouts and a prompt, from a source, kept in one file of equal records.
//!
//! A record holds all frames, then all layouts (8-bit RGB rows), then the prompt in 256 bytes padded with zeros.
//! Records are appended in index order; an interrupted run continues with the next index.

use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use ds_raster::RgbImage;

use crate::error::TrainError;

const PROMPT_BYTES: usize = 256;

/// Frames and layouts of consecutive ticks.
#[derive(Debug, Clone, PartialEq)]
pub struct Clip {
    /// What the camera saw.
    pub frames: Vec<RgbImage>,
    /// The layouts of the same ticks.
    pub layouts: Vec<RgbImage>,
    /// What the drive looks like, in words.
    pub prompt: String,
}

/// Makes clips by index; the same index gives the same clip.
pub trait ClipSource {
    /// Makes a clip.
    ///
    /// # Errors
    /// If rendering fails.
    fn clip(&self, index: u64) -> Result<Clip, TrainError>;
}

/// Sizes of the records of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ClipShape {
    /// Frames of a clip.
    pub frames: usize,
    /// Width, in pixels.
    pub width_px: u32,
    /// Height, in pixels.
    pub height_px: u32,
}

impl ClipShape {
    fn image_bytes(&self) -> usize {
        self.width_px as usize * self.height_px as usize * 3
    }

    fn record_bytes(&self) -> usize {
        2 * self.frames * self.image_bytes() + PROMPT_BYTES
    }
}

/// A file of clips.
#[derive(Debug, Clone)]
pub struct ClipFile {
    path: PathBuf,
    shape: ClipShape,
}

impl ClipFile {
    /// Names a file; it is made when the first clip is appended.
    #[must_use]
    pub fn new(path: &Path, shape: ClipShape) -> Self {
        Self { path: path.to_path_buf(), shape }
    }

    /// Returns the number of whole clips in the file.
    #[must_use]
    pub fn count(&self) -> u64 {
        std::fs::metadata(&self.path).map_or(0, |metadata| metadata.len() / self.shape.record_bytes() as u64)
    }

    /// Appends clips from a source until the file holds `total`; `made` is told each index.
    ///
    /// # Errors
    /// If a clip cannot be made or the file cannot be written.
    pub fn fill(&self, source: &dyn ClipSource, total: u64, made: &mut dyn FnMut(u64)) -> Result<(), TrainError> {
        let io = || TrainError::io("clip file", &self.path);
        let mut file = OpenOptions::new().create(true).append(true).open(&self.path).map_err(io())?;
        // A record cut off by an interruption is dropped.
        file.set_len(self.count() * self.shape.record_bytes() as u64).map_err(io())?;
        for index in self.count()..total {
            let clip = source.clip(index)?;
            let mut record = Vec::with_capacity(self.shape.record_bytes());
            for image in clip.frames.iter().chain(&clip.layouts) {
                record.extend_from_slice(image.rgb());
            }
            let prompt = &clip.prompt.as_bytes()[..clip.prompt.len().min(PROMPT_BYTES)];
            record.extend_from_slice(prompt);
            record.resize(self.shape.record_bytes(), 0);
            if clip.frames.len() != self.shape.frames || clip.layouts.len() != self.shape.frames {
                return Err(TrainError::Clip { index, reason: format!("it has {} frames", clip.frames.len()) });
            }
            file.write_all(&record).map_err(io())?;
            made(index);
        }
        Ok(())
    }

    /// Reads `count` frames of a clip from frame `from`.
    ///
    /// # Errors
    /// If the record cannot be read.
    pub fn read(&self, index: u64, from: usize, count: usize) -> Result<Clip, TrainError> {
        let io = || TrainError::io("clip file", &self.path);
        let image = self.shape.image_bytes();
        let mut file = File::open(&self.path).map_err(io())?;
        let mut part = |offset: usize, bytes: usize| {
            let at = index * self.shape.record_bytes() as u64 + offset as u64;
            let mut buffer = vec![0; bytes];
            file.seek(SeekFrom::Start(at)).and_then(|_| file.read_exact(&mut buffer)).map_err(io())?;
            Ok::<_, TrainError>(buffer)
        };
        let frames = part(from * image, count * image)?;
        let layouts = part((self.shape.frames + from) * image, count * image)?;
        let prompt = part(2 * self.shape.frames * image, PROMPT_BYTES)?;
        let images = |rows: &[u8]| -> Vec<RgbImage> {
            let image = |rows: &[u8]| RgbImage::new(self.shape.width_px, self.shape.height_px, rows.to_vec());
            rows.chunks_exact(image_len(self.shape)).filter_map(|rows| image(rows).ok()).collect()
        };
        let prompt = String::from_utf8_lossy(&prompt).trim_end_matches('\0').to_owned();
        Ok(Clip { frames: images(&frames), layouts: images(&layouts), prompt })
    }
}

fn image_len(shape: ClipShape) -> usize {
    shape.image_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Flat;

    impl ClipSource for Flat {
        fn clip(&self, index: u64) -> Result<Clip, TrainError> {
            #[expect(clippy::cast_possible_truncation, reason = "test indices are small")]
            let image = |k: u8| RgbImage::filled(16, 8, [index as u8, k, 7]);
            Ok(Clip {
                frames: (0..3).map(image).collect(),
                layouts: (10..13).map(image).collect(),
                prompt: format!("clip {index}"),
            })
        }
    }

    #[test]
    fn clips_come_back_as_written_and_an_interrupted_file_continues() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("clips.raw");
        let file = ClipFile::new(&path, ClipShape { frames: 3, width_px: 16, height_px: 8 });
        file.fill(&Flat, 2, &mut |_| ()).expect("fills");
        // Cut the second record short, as a killed process would.
        let half = std::fs::read(&path).expect("reads").len() - 100;
        File::options().write(true).open(&path).and_then(|f| f.set_len(half as u64)).expect("cuts");
        assert_eq!(file.count(), 1);
        let mut made = Vec::new();
        file.fill(&Flat, 3, &mut |index| made.push(index)).expect("fills");
        assert_eq!(made, [1, 2]);
        let whole = Flat.clip(2).expect("a clip");
        assert_eq!(file.read(2, 0, 3).expect("reads"), whole);
        assert_eq!(file.read(2, 1, 2).expect("reads").layouts, whole.layouts[1..]);
    }
}
