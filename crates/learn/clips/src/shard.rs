//! Shard files: the pictures of some clips, each compressed by itself, with a table at the end.
//!
//! Layout: magic, then for each clip its frames, layouts, class maps and geometry, then the table as JSON, its length (u64,
//! little-endian), the magic again. Pictures are raw rows under zstd; frames are stored as differences to the pixel on
//! their left, which packs better. A file is written under another name and renamed, so that one that exists is whole.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use ds_raster::RgbImage;
use ds_space::PoseSe2;
use serde::{Deserialize, Serialize};

use crate::clip::Clip;
use crate::error::ClipsError;
use crate::geometry;
use crate::index::ClipInfo;

const MAGIC: &[u8; 8] = b"DSCLIPS1";
const LEVEL: i32 = 3;
/// No table is larger.
const MOST_TABLE_BYTES: u64 = 1 << 28;
/// No geometry of a tick is larger.
const MOST_GEOMETRY_BYTES: usize = 1 << 26;

/// The table of a shard.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Table {
    /// Digest of the recipe.
    pub(crate) recipe: String,
    /// The clips.
    pub(crate) clips: Vec<Entry>,
}

/// One clip of a shard.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Entry {
    /// What is told of it.
    pub(crate) info: ClipInfo,
    /// Where its first picture begins.
    offset: u64,
    /// Compressed sizes of frames, layouts, class maps and geometry.
    frames: Vec<u32>,
    layouts: Vec<u32>,
    classes: Vec<u32>,
    #[serde(default)]
    geometry: Vec<u32>,
}

/// Returns the path of a shard.
pub(crate) fn path(folder: &Path, shard: usize) -> PathBuf {
    folder.join(format!("shard-{shard:05}.clips"))
}

/// Packs a clip, so that several can be packed at a time.
pub(crate) struct Packed {
    info: ClipInfo,
    bytes: Vec<u8>,
    frames: Vec<u32>,
    layouts: Vec<u32>,
    classes: Vec<u32>,
    geometry: Vec<u32>,
}

impl Packed {
    /// Packs a clip with where the ego is at each tick.
    pub(crate) fn new(clip: &Clip, egos: &[PoseSe2], info: ClipInfo) -> Result<Self, ClipsError> {
        let fail = |error: std::io::Error| ClipsError::Clip { index: info.index, reason: error.to_string() };
        let mut bytes = Vec::new();
        let mut pack = |raw: &[u8]| {
            let packed = zstd::bulk::compress(raw, LEVEL).map_err(fail)?;
            bytes.extend_from_slice(&packed);
            u32::try_from(packed.len()).map_err(|_| fail(std::io::Error::other("a picture of over 4 GiB")))
        };
        let frames =
            clip.frames.iter().map(|frame| pack(&differences(frame))).collect::<Result<Vec<_>, ClipsError>>()?;
        let layouts = clip.layouts.iter().map(|layout| pack(layout.rgb())).collect::<Result<Vec<_>, ClipsError>>()?;
        let classes = clip.classes.iter().map(|map| pack(map)).collect::<Result<Vec<_>, ClipsError>>()?;
        let geometry = egos.iter().zip(&clip.geometry).map(|(ego, seen)| pack(&geometry::packed(ego, seen)));
        let geometry = geometry.collect::<Result<Vec<_>, ClipsError>>()?;
        Ok(Self { info, bytes, frames, layouts, classes, geometry })
    }
}

/// Returns the rows with each byte less the same channel of the pixel to its left.
fn differences(image: &RgbImage) -> Vec<u8> {
    let mut rows = image.rgb().to_vec();
    for row in rows.chunks_exact_mut(3 * image.width_px() as usize) {
        for i in (3..row.len()).rev() {
            row[i] = row[i].wrapping_sub(row[i - 3]);
        }
    }
    rows
}

fn sums(mut rows: Vec<u8>, width_px: u32) -> Vec<u8> {
    for row in rows.chunks_exact_mut(3 * width_px as usize) {
        for i in 3..row.len() {
            row[i] = row[i].wrapping_add(row[i - 3]);
        }
    }
    rows
}

/// Writes a shard in one step.
pub(crate) fn write(path: &Path, recipe: &str, clips: Vec<Packed>) -> Result<(), ClipsError> {
    let io = || ClipsError::io("shard", path);
    let partial = path.with_extension("partial");
    let mut file = std::io::BufWriter::new(File::create(&partial).map_err(io())?);
    file.write_all(MAGIC).map_err(io())?;
    let (mut offset, mut table) = (MAGIC.len() as u64, Table { recipe: recipe.to_owned(), clips: Vec::new() });
    for Packed { info, bytes, frames, layouts, classes, geometry } in clips {
        file.write_all(&bytes).map_err(io())?;
        table.clips.push(Entry { info, offset, frames, layouts, classes, geometry });
        offset += bytes.len() as u64;
    }
    let table = serde_json::to_vec(&table).map_err(|error| ClipsError::broken(path, error))?;
    let written = file
        .write_all(&table)
        .and_then(|()| file.write_all(&(table.len() as u64).to_le_bytes()))
        .and_then(|()| file.write_all(MAGIC))
        .and_then(|()| file.into_inner().map_err(std::io::IntoInnerError::into_error))
        .and_then(|file| file.sync_all());
    written.map_err(io())?;
    std::fs::rename(&partial, path).map_err(io())
}

/// Reads the table of a shard.
pub(crate) fn table(path: &Path) -> Result<Table, ClipsError> {
    let io = || ClipsError::io("shard", path);
    let mut file = File::open(path).map_err(io())?;
    let length = file.metadata().map_err(io())?.len();
    let tail = 8 + MAGIC.len() as u64;
    if length < tail + MAGIC.len() as u64 {
        return Err(ClipsError::broken(path, "it is too short"));
    }
    let mut ending = [0u8; 16];
    file.seek(SeekFrom::Start(length - tail)).and_then(|_| file.read_exact(&mut ending)).map_err(io())?;
    let (size, magic) = ending.split_at(8);
    let mut bytes = [0u8; 8];
    bytes.copy_from_slice(size);
    let size = u64::from_le_bytes(bytes);
    if magic != MAGIC || size > MOST_TABLE_BYTES || size > length - tail {
        return Err(ClipsError::broken(path, "its ending is not that of a shard"));
    }
    #[expect(clippy::cast_possible_truncation, reason = "bounded above")]
    let mut table = vec![0; size as usize];
    file.seek(SeekFrom::Start(length - tail - size)).and_then(|_| file.read_exact(&mut table)).map_err(io())?;
    serde_json::from_slice(&table).map_err(|error| ClipsError::broken(path, error))
}

/// Which pictures of a tick are wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kinds {
    All,
    Layouts,
}

/// The wanted pictures of a clip.
pub(crate) struct Wanted {
    pub(crate) kinds: Kinds,
    pub(crate) width_px: u32,
    pub(crate) height_px: u32,
    pub(crate) from: usize,
    pub(crate) count: usize,
}

impl Entry {
    /// Reads frames, layouts and class maps of some ticks, of frames those that exist; or the layouts alone.
    pub(crate) fn read(&self, path: &Path, wanted: &Wanted) -> Result<Clip, ClipsError> {
        let io = || ClipsError::io("shard", path);
        let mut file = File::open(path).map_err(io())?;
        let pixels = wanted.width_px as usize * wanted.height_px as usize;
        let mut part = |streams: &[&[u32]], sizes: &[u32], bytes: Option<usize>| {
            let before: u64 = streams.iter().flat_map(|stream| stream.iter()).map(|size| u64::from(*size)).sum();
            let from = wanted.from.min(sizes.len());
            let to = (wanted.from + wanted.count).min(sizes.len());
            let skipped: u64 = sizes[..from].iter().map(|size| u64::from(*size)).sum();
            file.seek(SeekFrom::Start(self.offset + before + skipped)).map_err(io())?;
            let mut pictures = Vec::with_capacity(to - from);
            for size in &sizes[from..to] {
                let mut packed = vec![0; *size as usize];
                file.read_exact(&mut packed).map_err(io())?;
                let most = bytes.unwrap_or(MOST_GEOMETRY_BYTES);
                let raw = zstd::bulk::decompress(&packed, most).map_err(|error| ClipsError::broken(path, error))?;
                if bytes.is_some_and(|bytes| raw.len() != bytes) {
                    return Err(ClipsError::broken(path, "a picture has another size than the index says"));
                }
                pictures.push(raw);
            }
            Ok(pictures)
        };
        let layouts = part(&[&self.frames], &self.layouts, Some(3 * pixels))?;
        let (frames, classes, geometry) = match wanted.kinds {
            Kinds::All => (
                part(&[], &self.frames, Some(3 * pixels))?,
                part(&[&self.frames, &self.layouts], &self.classes, Some(pixels))?,
                part(&[&self.frames, &self.layouts, &self.classes], &self.geometry, None)?,
            ),
            Kinds::Layouts => (Vec::new(), Vec::new(), Vec::new()),
        };
        let broken = |reason: &str| ClipsError::broken(path, reason);
        let camera = self.info.camera.model().ok_or_else(|| broken("the name of its camera is no id"))?;
        let seen = |bytes: &Vec<u8>| geometry::unpacked(bytes, &camera).ok_or_else(|| broken("a geometry is broken"));
        let image = |rows: Vec<u8>| {
            RgbImage::new(wanted.width_px, wanted.height_px, rows).map_err(|error| ClipsError::broken(path, error))
        };
        Ok(Clip {
            frames: frames.into_iter().map(|rows| image(sums(rows, wanted.width_px))).collect::<Result<_, _>>()?,
            layouts: layouts.into_iter().map(image).collect::<Result<_, _>>()?,
            classes,
            geometry: geometry.iter().map(seen).collect::<Result<_, _>>()?,
            prompt: self.info.prompt.clone(),
        })
    }
}
