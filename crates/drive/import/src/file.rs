//! Files and folders of logs, read up to a limit.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use crate::error::ImportError;

/// The largest log file that is read, in bytes.
pub const MAX_FILE_BYTES: u64 = 256 << 20;

/// Returns the wanted entries of a folder, in order.
pub(crate) fn entries(folder: &Path, wanted: &dyn Fn(&Path) -> bool) -> std::io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if wanted(&path) {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

/// Reads a file of bounded size.
pub(crate) fn bytes(path: &Path) -> Result<Vec<u8>, ImportError> {
    let unreadable = |source| ImportError::Read { path: path.to_owned(), source };
    let file = File::open(path).map_err(unreadable)?;
    let mut bytes = Vec::new();
    file.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(unreadable)?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(ImportError::TooLarge { path: path.to_owned(), limit: MAX_FILE_BYTES });
    }
    Ok(bytes)
}
