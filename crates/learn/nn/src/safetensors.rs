//! Weight files: safetensors of f32 or f16, read with every size checked against the file before anything is allocated.
//!
//! Layout: an unsigned 64-bit little-endian header length, a JSON header {name: {dtype, shape, data_offsets}} with an
//! optional `__metadata__` map of text, then the values. The header is bounded, offsets must lie in the file without
//! gaps or overlaps, and only F32 and F16 are accepted. Nothing in the file is executed.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read, Write};
use std::path::Path;

use half::f16;
use serde::{Deserialize, Serialize};

use crate::array::{Array, Weights};

/// The longest accepted header, in bytes.
pub const MAX_HEADER_BYTES: u64 = 4 << 20;
/// The largest accepted file, in bytes.
pub const MAX_FILE_BYTES: u64 = 8 << 30;

/// Says why a weights file is refused.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// Reading or writing failed.
    #[error("weights file {path:?} cannot be {doing}")]
    Io {
        /// What was being done.
        doing: &'static str,
        /// The file.
        path: String,
        /// The system's answer.
        #[source]
        source: std::io::Error,
    },
    /// The file is larger than [`MAX_FILE_BYTES`].
    #[error("weights file has {bytes} bytes, the limit is {MAX_FILE_BYTES}")]
    TooLarge {
        /// Its size.
        bytes: u64,
    },
    /// The stated header length does not fit the file or the limit.
    #[error("weights header claims {claimed} bytes, the file allows {allowed}")]
    HeaderLength {
        /// What the file says.
        claimed: u64,
        /// The most that was possible.
        allowed: u64,
    },
    /// The header is not the expected JSON.
    #[error("weights header cannot be read")]
    Header(#[source] serde_json::Error),
    /// A tensor's type is not one that is read.
    #[error("weight {name:?} has type {dtype:?}, which is not read here")]
    Type {
        /// The weight.
        name: String,
        /// Its type.
        dtype: String,
    },
    /// A tensor's offsets disagree with its shape or the file.
    #[error("weight {name:?} of shape {shape:?} claims bytes {from} to {to} of {available}")]
    Offsets {
        /// The weight.
        name: String,
        /// Its stated shape.
        shape: Vec<u64>,
        /// First byte.
        from: u64,
        /// Byte after the last.
        to: u64,
        /// Bytes of values in the file.
        available: u64,
    },
    /// Tensors overlap or leave a gap.
    #[error("weight {name:?} begins at byte {from}, {expected} expected")]
    Gap {
        /// The weight.
        name: String,
        /// Its first byte.
        from: u64,
        /// Where the one before ended.
        expected: u64,
    },
}

/// What a header says about one tensor.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Entry {
    pub(crate) dtype: String,
    pub(crate) shape: Vec<u64>,
    pub(crate) data_offsets: [u64; 2],
}

/// A checked header: the entries tile the values exactly.
pub(crate) struct Header {
    /// Text by key.
    pub(crate) metadata: BTreeMap<String, String>,
    /// Entries in the order of their values.
    pub(crate) entries: Vec<(String, Entry)>,
    /// Where the values begin in the file.
    pub(crate) start: u64,
}

impl Header {
    /// Reads the header of a file of `bytes` bytes; `size` gives the bytes of a value by type.
    pub(crate) fn read(
        file: &mut impl Read,
        bytes: u64,
        path: &Path,
        limit: u64,
        size: &dyn Fn(&str) -> Option<u64>,
    ) -> Result<Self, FileError> {
        let io = |source| FileError::Io { doing: "read", path: path.display().to_string(), source };
        let allowed = bytes.saturating_sub(8).min(limit);
        let mut length = [0; 8];
        if bytes < 8 {
            return Err(FileError::HeaderLength { claimed: 8, allowed: bytes });
        }
        file.read_exact(&mut length).map_err(io)?;
        let claimed = u64::from_le_bytes(length);
        if claimed > allowed {
            return Err(FileError::HeaderLength { claimed, allowed });
        }
        let mut header = vec![0; claimed as usize];
        file.read_exact(&mut header).map_err(io)?;
        let mut header: BTreeMap<String, serde_json::Value> =
            serde_json::from_slice(&header).map_err(FileError::Header)?;
        let metadata = match header.remove("__metadata__") {
            Some(value) => serde_json::from_value(value).map_err(FileError::Header)?,
            None => BTreeMap::new(),
        };
        let entries = check_entries(header, bytes - 8 - claimed, size)?;
        Ok(Self { metadata, entries, start: 8 + claimed })
    }
}

/// Weights with the text that a file says about them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct WeightsFile {
    /// The arrays.
    pub weights: Weights,
    /// Text by key, such as the digest of the configuration.
    pub metadata: BTreeMap<String, String>,
}

impl WeightsFile {
    /// Reads a file. Memory stays within the file's own size.
    ///
    /// # Errors
    /// [`FileError`] says what is wrong.
    pub fn read(path: &Path) -> Result<Self, FileError> {
        let io = |doing| move |source| FileError::Io { doing, path: path.display().to_string(), source };
        let file = File::open(path).map_err(io("opened"))?;
        let bytes = file.metadata().map_err(io("measured"))?.len();
        Self::parse(&mut BufReader::new(file), bytes, path)
    }

    fn parse(file: &mut impl Read, bytes: u64, path: &Path) -> Result<Self, FileError> {
        let io = |source| FileError::Io { doing: "read", path: path.display().to_string(), source };
        if bytes > MAX_FILE_BYTES {
            return Err(FileError::TooLarge { bytes });
        }
        let size = |dtype: &str| match dtype {
            "F32" => Some(4),
            "F16" => Some(2),
            _ => None,
        };
        let Header { metadata, entries, .. } = Header::read(file, bytes, path, MAX_HEADER_BYTES, &size)?;
        let mut weights = Weights::default();
        for (name, entry) in entries {
            let mut raw = vec![0; (entry.data_offsets[1] - entry.data_offsets[0]) as usize];
            file.read_exact(&mut raw).map_err(io)?;
            let values = if entry.dtype == "F16" {
                raw.chunks_exact(2).map(|b| f16::from_le_bytes([b[0], b[1]]).to_f32()).collect()
            } else {
                raw.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
            };
            let shape: Vec<usize> = entry.shape.iter().map(|side| *side as usize).collect();
            weights.insert(&name, Array::new(&shape, values));
        }
        Ok(Self { weights, metadata })
    }

    /// Writes the file beside its place, then moves it there, so that a reader never sees half of it.
    ///
    /// # Errors
    /// If the file system refuses.
    pub fn write(&self, path: &Path) -> Result<(), FileError> {
        self.write_as("F32", path)
    }

    /// Writes values rounded to half precision: half the size.
    ///
    /// # Errors
    /// As [`WeightsFile::write`].
    pub fn write_half(&self, path: &Path) -> Result<(), FileError> {
        self.write_as("F16", path)
    }

    fn write_as(&self, dtype: &str, path: &Path) -> Result<(), FileError> {
        let half = dtype == "F16";
        let io = |source| FileError::Io { doing: "written", path: path.display().to_string(), source };
        let mut header = serde_json::Map::new();
        if !self.metadata.is_empty() {
            let metadata = serde_json::to_value(&self.metadata).map_err(FileError::Header)?;
            header.insert("__metadata__".to_owned(), metadata);
        }
        let mut at = 0u64;
        for (name, array) in self.weights.iter() {
            let end = at + if half { 2 } else { 4 } * array.values().len() as u64;
            let shape = array.shape().iter().map(|side| *side as u64).collect();
            let entry = Entry { dtype: dtype.to_owned(), shape, data_offsets: [at, end] };
            header.insert(name.to_owned(), serde_json::to_value(entry).map_err(FileError::Header)?);
            at = end;
        }
        let mut header = serde_json::to_vec(&header).map_err(FileError::Header)?;
        header.resize(header.len().next_multiple_of(8), b' ');
        let partial = path.with_extension("partial");
        let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
        bytes.extend_from_slice(&header);
        for (_, array) in self.weights.iter() {
            if half {
                bytes.extend(array.values().iter().flat_map(|value| f16::from_f32(*value).to_le_bytes()));
            } else {
                bytes.extend(array.values().iter().flat_map(|value| value.to_le_bytes()));
            }
        }
        let mut file = File::create(&partial).map_err(io)?;
        file.write_all(&bytes).and_then(|()| file.sync_all()).map_err(io)?;
        std::fs::rename(&partial, path).map_err(io)
    }
}

/// Orders the entries by offset and checks that they tile the values exactly.
fn check_entries(
    header: BTreeMap<String, serde_json::Value>,
    available: u64,
    size: &dyn Fn(&str) -> Option<u64>,
) -> Result<Vec<(String, Entry)>, FileError> {
    let mut entries = Vec::new();
    for (name, value) in header {
        let entry: Entry = serde_json::from_value(value).map_err(FileError::Header)?;
        let Some(size) = size(&entry.dtype) else {
            return Err(FileError::Type { name, dtype: entry.dtype });
        };
        let [from, to] = entry.data_offsets;
        let bytes = entry.shape.iter().try_fold(size, |bytes, side| bytes.checked_mul(*side));
        if from > to || to > available || bytes != Some(to - from) {
            return Err(FileError::Offsets { name, shape: entry.shape, from, to, available });
        }
        entries.push((name, entry));
    }
    entries.sort_by(|a, b| (a.1.data_offsets, &a.0).cmp(&(b.1.data_offsets, &b.0)));
    let mut expected = 0;
    for (name, entry) in &entries {
        if entry.data_offsets[0] != expected {
            return Err(FileError::Gap { name: name.clone(), from: entry.data_offsets[0], expected });
        }
        expected = entry.data_offsets[1];
    }
    if expected != available {
        return Err(FileError::Gap { name: "(end of file)".to_owned(), from: available, expected });
    }
    Ok(entries)
}

#[cfg(test)]
mod tests;
