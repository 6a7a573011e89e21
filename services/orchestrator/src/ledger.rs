//! The ledger in an embedded database file that only one process can hold open.

use std::path::Path;

use ds_episode::fleet::{Ledger, LedgerError, Write};
use redb::{Database, ReadableDatabase, TableDefinition};

use crate::storage::Storage;

const TERM: TableDefinition<'_, &str, u64> = TableDefinition::new("term");
const ENTRIES: TableDefinition<'_, &str, &[u8]> = TableDefinition::new("entries");
const TERM_KEY: &str = "term";

/// A ledger file. The database locks it; a second orchestrator on the same file is refused at open.
#[derive(Debug)]
pub(crate) struct LedgerFile {
    database: Database,
    storage: Storage,
    /// Durable writes since it was opened.
    commits: u64,
}

fn failed(error: impl Into<redb::Error>) -> LedgerError {
    LedgerError::Storage(error.into().to_string())
}

impl LedgerFile {
    /// Opens the file, or makes an empty one.
    ///
    /// # Errors
    /// If it is locked by another process, broken or cannot be written.
    pub(crate) fn open(path: &Path, storage: Storage) -> Result<Self, LedgerError> {
        let database = Database::create(path).map_err(failed)?;
        let transaction = database.begin_write().map_err(failed)?;
        transaction.open_table(TERM).map_err(failed)?;
        transaction.open_table(ENTRIES).map_err(failed)?;
        transaction.commit().map_err(failed)?;
        Ok(Self { database, storage, commits: 0 })
    }

    /// Returns how often it was written to since it was opened.
    pub(crate) fn commits(&self) -> u64 {
        self.commits
    }

    /// Says so if the storage failed.
    fn told<T>(&self, outcome: Result<T, LedgerError>) -> Result<T, LedgerError> {
        outcome.inspect_err(|error| {
            if matches!(error, LedgerError::Storage(_)) {
                self.storage.fail(format!("ledger.redb: {error}"));
            }
        })
    }

    fn stored_term(&self) -> Result<u64, LedgerError> {
        let transaction = self.database.begin_read().map_err(failed)?;
        let table = transaction.open_table(TERM).map_err(failed)?;
        Ok(table.get(TERM_KEY).map_err(failed)?.map_or(0, |value| value.value()))
    }

    fn next_term(&self) -> Result<u64, LedgerError> {
        let term = self.stored_term()? + 1;
        let transaction = self.database.begin_write().map_err(failed)?;
        transaction.open_table(TERM).map_err(failed)?.insert(TERM_KEY, term).map_err(failed)?;
        transaction.commit().map_err(failed)?;
        Ok(term)
    }

    fn stored(&self, prefix: &str) -> Result<Vec<(String, Vec<u8>)>, LedgerError> {
        let transaction = self.database.begin_read().map_err(failed)?;
        let table = transaction.open_table(ENTRIES).map_err(failed)?;
        let mut found = Vec::new();
        for entry in table.range(prefix..).map_err(failed)? {
            let (key, value) = entry.map_err(failed)?;
            if !key.value().starts_with(prefix) {
                break;
            }
            found.push((key.value().to_owned(), value.value().to_vec()));
        }
        Ok(found)
    }

    fn write(&self, term: u64, writes: &[Write]) -> Result<(), LedgerError> {
        let current = self.stored_term()?;
        if current != term {
            return Err(LedgerError::Fenced { own: term, current });
        }
        let transaction = self.database.begin_write().map_err(failed)?;
        {
            let mut table = transaction.open_table(ENTRIES).map_err(failed)?;
            for (key, value) in writes {
                match value {
                    Some(value) => drop(table.insert(key.as_str(), value.as_slice()).map_err(failed)?),
                    None => drop(table.remove(key.as_str()).map_err(failed)?),
                }
            }
        }
        transaction.commit().map_err(failed)
    }
}

impl Ledger for LedgerFile {
    fn raise_term(&mut self) -> Result<u64, LedgerError> {
        self.told(self.next_term())
    }

    fn term(&self) -> Result<u64, LedgerError> {
        self.told(self.stored_term())
    }

    fn entries(&self, prefix: &str) -> Result<Vec<(String, Vec<u8>)>, LedgerError> {
        self.told(self.stored(prefix))
    }

    fn commit(&mut self, term: u64, writes: &[Write]) -> Result<(), LedgerError> {
        self.commits += 1;
        self.told(self.write(term, writes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_survive_and_lower_terms_are_fenced() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("ledger.redb");
        let mut ledger = LedgerFile::open(&path, Storage::default()).expect("opens");
        assert_eq!(ledger.raise_term().expect("raised"), 1);
        ledger
            .commit(1, &[("epoch/a".to_owned(), Some(vec![7])), ("other".to_owned(), Some(vec![1]))])
            .expect("term 1");
        assert!(LedgerFile::open(&path, Storage::default()).is_err(), "a second process must be refused");
        drop(ledger);
        let mut ledger = LedgerFile::open(&path, Storage::default()).expect("opens again");
        assert_eq!(ledger.raise_term().expect("raised"), 2);
        assert!(matches!(ledger.commit(1, &[]), Err(LedgerError::Fenced { own: 1, current: 2 })));
        assert_eq!(ledger.entries("epoch/").expect("reads"), vec![("epoch/a".to_owned(), vec![7])]);
        ledger.commit(2, &[("epoch/a".to_owned(), None)]).expect("term 2");
        assert!(ledger.entries("epoch/").expect("reads").is_empty());
    }
}
