//! What looks wrong with a mapping or a log, in plain words with its cure.

use serde::Serialize;

/// Something that looks wrong.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct LogFinding {
    /// The file.
    pub file: String,
    /// The channel, or `time`.
    pub channel: String,
    /// What is wrong, in a few words.
    pub problem: String,
    /// What shows it.
    pub evidence: String,
    /// What to change in the mapping.
    pub proposal: String,
}

impl std::fmt::Display for LogFinding {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(out, "{}: {}: {} ({}); {}", self.file, self.channel, self.problem, self.evidence, self.proposal)
    }
}
