//! How often a folder of results was worked on, and how that ended: lines of `sessions.jsonl`. A session without an end was
//! killed. Nothing of it enters a result.

use std::fs::File;
use std::io::Write;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::file::{self, FileError};

/// The file's name in its folder.
const FILE: &str = "sessions.jsonl";

/// What is written of a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "lowercase")]
pub enum Event {
    /// It began.
    Begun {
        /// Whether the last line of the cells was torn.
        torn: bool,
    },
    /// It drove all that was left, or aborted it.
    Ended,
    /// A signal came.
    Interrupted,
}

/// Sessions of one or several folders, counted.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sessions {
    /// All.
    pub begun: usize,
    /// Those that a signal ended.
    pub interrupted: usize,
    /// Those that ended without a word.
    pub killed: usize,
    /// Those that found a torn last line.
    pub torn: usize,
}

impl Sessions {
    /// Counts the sessions of a folder; none where nothing was written. One that has not ended yet counts as killed.
    ///
    /// # Errors
    /// [`FileError`] if the file cannot be read. A line that cannot be read is skipped: it was being written.
    pub fn load(folder: &Path) -> Result<Self, FileError> {
        let path = folder.join(FILE);
        let mut all = Self::default();
        if !path.exists() {
            return Ok(all);
        }
        for line in file::read(&path)?.split(|byte| *byte == b'\n') {
            match serde_json::from_slice(line) {
                Ok(Event::Begun { torn }) => {
                    all.begun += 1;
                    all.killed += 1;
                    all.torn += usize::from(torn);
                }
                Ok(Event::Ended) => all.killed = all.killed.saturating_sub(1),
                Ok(Event::Interrupted) => {
                    all.killed = all.killed.saturating_sub(1);
                    all.interrupted += 1;
                }
                Err(_torn) => {}
            }
        }
        Ok(all)
    }

    /// Adds those of another folder.
    #[must_use]
    pub fn with(self, other: Self) -> Self {
        Self {
            begun: self.begun + other.begun,
            interrupted: self.interrupted + other.interrupted,
            killed: self.killed + other.killed,
            torn: self.torn + other.torn,
        }
    }
}

/// Appends what happened to the sessions of a folder.
///
/// # Errors
/// [`FileError::Write`].
pub fn note(folder: &Path, event: Event) -> Result<(), FileError> {
    let path = folder.join(FILE);
    let failed = |source| FileError::Write { path: path.clone(), source };
    let mut line = serde_json::to_vec(&event).map_err(|error| failed(error.into()))?;
    line.insert(0, b'\n');
    let mut file = File::options().create(true).append(true).open(&path).map_err(failed)?;
    file.write_all(&line).and_then(|()| file.sync_data()).map_err(failed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_session_without_an_end_was_killed() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        assert_eq!(Sessions::load(folder.path()).expect("no file"), Sessions::default());
        let events = [
            Event::Begun { torn: false },
            Event::Begun { torn: true },
            Event::Interrupted,
            Event::Begun { torn: false },
            Event::Ended,
        ];
        for event in events {
            note(folder.path(), event).expect("written");
        }
        let all = Sessions { begun: 3, interrupted: 1, killed: 1, torn: 1 };
        assert_eq!(Sessions::load(folder.path()).expect("sound"), all);
        assert_eq!(all.with(all).begun, 6);
    }
}
