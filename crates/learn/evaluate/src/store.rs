//! Records as files, one per rollout, named by the digest of all that they depend on.

use std::path::{Path, PathBuf};

use ds_space::Digest;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::error::EvaluationError;

/// A folder of records.
#[derive(Debug, Clone)]
pub struct Store {
    folder: PathBuf,
}

impl Store {
    /// Opens a folder, which is made if it is not there.
    ///
    /// # Errors
    /// If it cannot be made.
    pub fn open(folder: &Path) -> Result<Self, EvaluationError> {
        std::fs::create_dir_all(folder).map_err(EvaluationError::io("folder of records", folder))?;
        Ok(Self { folder: folder.to_path_buf() })
    }

    fn path(&self, key: &Digest) -> PathBuf {
        self.folder.join(format!("{key}.json"))
    }

    /// Returns the record of a key, none if it was not made yet.
    ///
    /// # Errors
    /// If the file is there and broken.
    pub fn get<T: DeserializeOwned>(&self, key: &Digest) -> Result<Option<T>, EvaluationError> {
        let path = self.path(key);
        let text = match std::fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(EvaluationError::io("record", &path)(error)),
        };
        let broken = |source| EvaluationError::Record { path: path.display().to_string(), source };
        serde_json::from_str(&text).map(Some).map_err(broken)
    }

    /// Stores the record of a key; a reader never sees half of it.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn put(&self, key: &Digest, record: &impl Serialize) -> Result<(), EvaluationError> {
        let path = self.path(key);
        let broken = |source| EvaluationError::Record { path: path.display().to_string(), source };
        let text = serde_json::to_string(record).map_err(broken)?;
        let partial = path.with_extension("partial");
        std::fs::write(&partial, text).map_err(EvaluationError::io("record", &partial))?;
        std::fs::rename(&partial, &path).map_err(EvaluationError::io("record", &path))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{Record, Seam};

    #[test]
    fn records_come_back_and_broken_ones_are_named() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let store = Store::open(folder.path()).expect("opens");
        let (key, record) =
            (Digest::of(b"a"), Record { drive: "x@0".to_owned(), glances: Vec::new(), seam: Seam::default() });
        assert_eq!(store.get::<Record>(&key).expect("reads"), None);
        store.put(&key, &record).expect("writes");
        assert_eq!(store.get(&key).expect("reads"), Some(record));
        std::fs::write(folder.path().join(format!("{key}.json")), "{").expect("spoils");
        let error = store.get::<Record>(&key).expect_err("it is broken").to_string();
        assert!(error.contains("remove it"), "{error}");
    }
}
