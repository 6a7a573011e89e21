//! The files of a checkpoint, mapped into memory, and where each tensor lies in them.
//!
//! A checkpoint is a safetensors file, an index of several (`*.index.json`), a folder that holds one of these, or a
//! zip archive of PyTorch. Nothing is read but headers; values are read when they are asked for.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};

use ds_pickle::{PickleError, Tensor};
use memmap2::Mmap;
use serde::Deserialize;

use super::error::CheckpointError;
use super::{Format, View, pickle, zip};
use crate::safetensors;

/// The longest accepted header of a published safetensors file, in bytes.
const MAX_HEADER_BYTES: u64 = 16 << 20;
const MAX_INDEX_BYTES: u64 = 64 << 20;
const MAX_SHARDS: usize = 1_024;

/// Mapped files and the tensors in them.
pub(super) struct Files {
    pub(super) maps: Vec<Mmap>,
    pub(super) views: BTreeMap<String, View>,
}

#[derive(Deserialize)]
struct Index {
    weight_map: BTreeMap<String, String>,
}

impl Files {
    pub(super) fn open(path: &Path) -> Result<Self, CheckpointError> {
        let path = if path.is_dir() { only_checkpoint(path)? } else { path.to_path_buf() };
        let mut files = Self { maps: Vec::new(), views: BTreeMap::new() };
        if path.file_name().is_some_and(|name| name.to_string_lossy().ends_with(".index.json")) {
            files.add_shards(&path)?;
        } else {
            files.add(&path)?;
        }
        Ok(files)
    }

    fn add(&mut self, path: &Path) -> Result<(), CheckpointError> {
        let map = mapped(path)?;
        let views = if map.starts_with(b"PK\x03\x04") || map.starts_with(b"PK\x05\x06") {
            of_archive(&map, path, self.maps.len())?
        } else if map.first() == Some(&0x80) && map.get(8) != Some(&b'{') {
            let reason = "a bare pickle or an archive of PyTorch before 1.6, neither of which is read".to_owned();
            return Err(CheckpointError::Kind { reason, path: path.display().to_string() });
        } else {
            of_safetensors(&map, path, self.maps.len())?
        };
        self.maps.push(map);
        self.views.extend(views);
        Ok(())
    }

    /// Adds all shards of an index; index and shards must name the same tensors.
    fn add_shards(&mut self, path: &Path) -> Result<(), CheckpointError> {
        let fault = |reason: String| CheckpointError::Index { reason, path: path.display().to_string() };
        let text = mapped(path)?;
        if text.len() as u64 > MAX_INDEX_BYTES {
            return Err(fault(format!("it has {} bytes, at most {MAX_INDEX_BYTES} are read", text.len())));
        }
        let index: Index = serde_json::from_slice(&text).map_err(|error| fault(error.to_string()))?;
        let mut shards: Vec<&String> = index.weight_map.values().collect();
        shards.sort();
        shards.dedup();
        if shards.len() > MAX_SHARDS {
            return Err(fault(format!("it names {} files, at most {MAX_SHARDS} are read", shards.len())));
        }
        for shard in shards {
            if Path::new(shard).file_name() != Some(shard.as_ref()) {
                return Err(fault(format!("{shard:?} is no plain file name")));
            }
            let mut single = Self { maps: Vec::new(), views: BTreeMap::new() };
            single.add(&path.with_file_name(shard))?;
            for (name, view) in single.views {
                if index.weight_map.get(&name) != Some(shard) {
                    return Err(fault(format!("{shard:?} holds {name:?}, which the index does not place there")));
                }
                self.views.insert(name, View { file: self.maps.len(), ..view });
            }
            self.maps.extend(single.maps);
        }
        match index.weight_map.iter().find(|(name, _)| !self.views.contains_key(*name)) {
            Some((name, shard)) => Err(fault(format!("it places {name:?} in {shard:?}, which does not hold it"))),
            None => Ok(()),
        }
    }
}

/// Finds the one checkpoint of a folder: an index, else the only safetensors file, else the only archive.
fn only_checkpoint(folder: &Path) -> Result<PathBuf, CheckpointError> {
    let path = folder.display().to_string();
    let io = |source| CheckpointError::Io { doing: "listed", path: path.clone(), source };
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        files.push(entry.map_err(io)?.path());
    }
    files.sort();
    for ending in [".index.json", ".safetensors", ".pth"] {
        let found: Vec<&PathBuf> = files.iter().filter(|file| file.to_string_lossy().ends_with(ending)).collect();
        match found.as_slice() {
            [] => {}
            [single] => return Ok((*single).clone()),
            many => {
                let reason = format!("a folder of {} files that end in {ending}, name one", many.len());
                return Err(CheckpointError::Kind { reason, path });
            }
        }
    }
    Err(CheckpointError::Kind { reason: "a folder without weights".to_owned(), path })
}

fn mapped(path: &Path) -> Result<Mmap, CheckpointError> {
    let io = |doing| move |source| CheckpointError::Io { doing, path: path.display().to_string(), source };
    let file = File::open(path).map_err(io("opened"))?;
    // SAFETY: the map is only ever read as bytes, for which any content is valid. Another process that cuts the file
    // short while it is mapped would end this one by a signal; weights are files that nobody writes to.
    let map = unsafe { Mmap::map(&file) };
    map.map_err(io("mapped"))
}

fn of_safetensors(map: &[u8], path: &Path, file: usize) -> Result<BTreeMap<String, View>, CheckpointError> {
    let refuse = |source| CheckpointError::Safetensors { path: path.display().to_string(), source };
    let size = |dtype: &str| Format::named(dtype).map(|format| format.bytes() as u64);
    let mut reader = map;
    let header = safetensors::Header::read(&mut reader, map.len() as u64, path, MAX_HEADER_BYTES, &size);
    let header = header.map_err(refuse)?;
    let view = |entry: safetensors::Entry| {
        let shape: Vec<usize> = entry.shape.iter().map(|side| *side as usize).collect();
        let format = Format::named(&entry.dtype).expect("the header's types were checked");
        View { file, start: (header.start + entry.data_offsets[0]) as usize, format, strides: dense(&shape), shape }
    };
    Ok(header.entries.into_iter().map(|(name, entry)| (name, view(entry))).collect())
}

fn of_archive(map: &[u8], path: &Path, file: usize) -> Result<BTreeMap<String, View>, CheckpointError> {
    let place = || path.display().to_string();
    let broken = |reason: String| CheckpointError::Zip { reason, path: place() };
    let members = zip::members(map).map_err(broken)?;
    let pickles: Vec<&str> = members.keys().filter_map(|name| name.strip_suffix("data.pkl")).collect();
    let [root] = pickles.as_slice() else {
        return Err(broken(format!("it holds {} members data.pkl, one expected", pickles.len())));
    };
    if members.get(&format!("{root}byteorder")).is_some_and(|range| &map[range.clone()] != b"little") {
        return Err(broken("its values are not little-endian".to_owned()));
    }
    let stored =
        pickle::tensors(&map[members[&format!("{root}data.pkl")].clone()]).map_err(|refusal| match refusal {
            PickleError::Forbidden { module, name, .. } => {
                CheckpointError::Code { global: format!("{module}.{name}"), path: place() }
            }
            refusal => CheckpointError::Pickle { refusal, path: place() },
        })?;
    let mut views = BTreeMap::new();
    for (name, tensor) in stored {
        let dtype = tensor.storage.strip_suffix("Storage").unwrap_or_default();
        let Some(format) = Format::named(dtype) else {
            return Err(CheckpointError::Type { name, dtype: tensor.storage.to_owned() });
        };
        let member = format!("{root}data/{}", tensor.key);
        let range =
            members.get(&member).ok_or_else(|| broken(format!("weight {name:?} lies in {member:?}, absent")))?;
        let available = range.len() / format.bytes();
        if let Some(asked) = beyond(&tensor, available) {
            return Err(CheckpointError::Storage { name, shape: tensor.shape, asked, available });
        }
        let start = range.start + tensor.offset * format.bytes();
        views.insert(name, View { file, start, format, shape: tensor.shape, strides: tensor.strides });
    }
    Ok(views)
}

/// Says how many values a tensor needs if its storage has fewer, or if it repeats values to appear larger.
fn beyond(tensor: &Tensor, available: usize) -> Option<String> {
    let count = tensor.shape.iter().try_fold(1usize, |product, side| product.checked_mul(*side));
    let Some(count) = count else { return Some("more than fit an address".to_owned()) };
    if count == 0 {
        return None;
    }
    let mut steps = tensor.shape.iter().zip(&tensor.strides);
    let step = |at: usize, (side, stride): (&usize, &usize)| at.checked_add((side - 1).checked_mul(*stride)?);
    let last = steps.try_fold(tensor.offset, step);
    match last {
        Some(last) if last < available && count <= available => None,
        Some(last) => Some(last.saturating_add(1).max(count).to_string()),
        None => Some("more than fit an address".to_owned()),
    }
}

/// Returns the strides of a row-major tensor.
pub(super) fn dense(shape: &[usize]) -> Vec<usize> {
    let mut strides = vec![1usize; shape.len()];
    for axis in (1..shape.len()).rev() {
        strides[axis - 1] = strides[axis].saturating_mul(shape[axis]);
    }
    strides
}
