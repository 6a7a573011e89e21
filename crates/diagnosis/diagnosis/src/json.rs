//! Files of JSON: what cannot be understood is refused by its key, what is written is read back to the bit.

use std::path::Path;

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_path_to_error::{Error, Track};

use crate::error::CaseError;

/// Reads a value from a file.
///
/// # Errors
/// If the file cannot be read or is not such a value; the error names the key.
pub fn read<T: DeserializeOwned>(path: &Path) -> Result<T, CaseError> {
    let text = std::fs::read_to_string(path).map_err(|source| CaseError::Read { path: path.to_path_buf(), source })?;
    parse(&text).map_err(|source| CaseError::Json { path: path.to_path_buf(), source })
}

/// Reads a value from text.
pub(crate) fn parse<T: DeserializeOwned>(text: &str) -> Result<T, Error<serde_json::Error>> {
    let mut reader = serde_json::Deserializer::from_str(text);
    let value = serde_path_to_error::deserialize(&mut reader)?;
    reader.end().map_err(|error| Error::new(Track::new().path(), error))?;
    Ok(value)
}

/// Writes a value into a file, in a folder that is made where it is not there.
///
/// # Errors
/// If the file cannot be written.
pub fn write<T: Serialize>(value: &T, path: &Path) -> Result<(), CaseError> {
    let failed = |source| CaseError::Write { path: path.to_path_buf(), source };
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(failed)?;
    }
    let text = serde_json::to_string_pretty(value).map_err(|error| failed(error.into()))?;
    std::fs::write(path, text + "\n").map_err(failed)
}
