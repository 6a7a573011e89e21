//! Files of a benchmark: JSON read with bounds and named refusals, written in one step.

use std::fs::File;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;

/// The largest file that is read as a whole, in bytes.
const MAX_FILE_BYTES: u64 = 256 << 20;

/// Why a file of a benchmark was refused.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// It cannot be read.
    #[error("cannot read {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// It cannot be written.
    #[error("cannot write {}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Something else is there.
    #[error("another file is there and stays: {}", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// It is too large.
    #[error("file has more than {MAX_FILE_BYTES} bytes: {}", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
    },
    /// It is not of this shape.
    #[error("file refused: at {at:?}: {problem}: {}", path.display())]
    Shape {
        /// The path inside the document.
        at: String,
        /// What is wrong.
        problem: String,
        /// The file.
        path: PathBuf,
    },
    /// A field holds what it may not.
    #[error("file refused: field {field:?} is {value}, {rule}: {}", path.display())]
    Value {
        /// The field.
        field: String,
        /// Its value.
        value: String,
        /// What it breaks.
        rule: &'static str,
        /// The file.
        path: PathBuf,
    },
}

/// Reads a file up to a limit.
///
/// # Errors
/// [`FileError`] if it cannot be read or is too large.
pub fn read(path: &Path) -> Result<Vec<u8>, FileError> {
    let unreadable = |source| FileError::Read { path: path.to_owned(), source };
    let mut bytes = Vec::new();
    File::open(path).map_err(unreadable)?.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(unreadable)?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(FileError::TooLarge { path: path.to_owned() });
    }
    Ok(bytes)
}

/// Reads a document.
///
/// # Errors
/// [`FileError`] if the file cannot be read, or is no such document.
pub fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, FileError> {
    parse_json(&read(path)?, path)
}

/// Reads the text of a document; the path is only for messages.
///
/// # Errors
/// [`FileError::Shape`].
pub fn parse_json<T: DeserializeOwned>(bytes: &[u8], path: &Path) -> Result<T, FileError> {
    let shape = |at: String, problem: String| FileError::Shape { at, problem, path: path.to_owned() };
    let mut reader = serde_json::Deserializer::from_slice(bytes);
    let value = serde_path_to_error::deserialize(&mut reader)
        .map_err(|error| shape(error.path().to_string(), error.inner().to_string()))?;
    reader.end().map_err(|error| shape(".".to_owned(), error.to_string()))?;
    Ok(value)
}

/// Writes a document in one step: readers see the old file or the whole new one.
///
/// # Errors
/// [`FileError::Write`].
pub fn write_json(value: &impl Serialize, path: &Path) -> Result<(), FileError> {
    let failed = |source| FileError::Write { path: path.to_owned(), source };
    let mut text = serde_json::to_vec_pretty(value).map_err(|error| failed(error.into()))?;
    text.push(b'\n');
    write(&text, path)
}

/// Writes a file in one step, making its folder where needed.
///
/// # Errors
/// [`FileError::Write`].
pub fn write(bytes: &[u8], path: &Path) -> Result<(), FileError> {
    let mut name = path.as_os_str().to_owned();
    name.push(".partial");
    let partial = PathBuf::from(name);
    let write = || {
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder)?;
        }
        let mut file = File::create(&partial)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        std::fs::rename(&partial, path)
    };
    write().map_err(|source| FileError::Write { path: path.to_owned(), source })
}
