//! Why a bag cannot be read, by file, topic and field.

use std::path::PathBuf;

/// A bag that cannot be read, or does not hold what is asked of it.
#[derive(Debug, thiserror::Error)]
pub enum BagError {
    /// A file cannot be read.
    #[error("cannot read {path:?}")]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The container is damaged, cut off or of another kind.
    #[error("{what} at byte {at} of {path:?}")]
    Damaged {
        /// What is wrong.
        what: String,
        /// Offset in the file.
        at: u64,
        /// The file.
        path: PathBuf,
    },
    /// The MCAP library refuses the file.
    #[error("damaged MCAP {path:?}")]
    Mcap {
        /// The file.
        path: PathBuf,
        /// Why.
        source: Box<mcap::McapError>,
    },
    /// A record of an MCAP is not what its kind says.
    #[error("{what} in MCAP {path:?}")]
    Record {
        /// What is wrong.
        what: String,
        /// The file.
        path: PathBuf,
    },
    /// SQLite refuses the file.
    #[error("damaged or foreign SQLite bag {path:?}")]
    Sql {
        /// The file.
        path: PathBuf,
        /// Why.
        source: rusqlite::Error,
    },
    /// A topic's messages cannot be understood.
    #[error("topic {topic:?} of type {kind:?}: {what}")]
    Definition {
        /// The topic.
        topic: String,
        /// Its type.
        kind: String,
        /// What stands in the way.
        what: String,
    },
    /// A message does not fit its definition.
    #[error("message {number} of topic {topic:?}: {what}")]
    Message {
        /// Number of the message of that topic, from 1.
        number: u64,
        /// The topic.
        topic: String,
        /// What does not fit.
        what: String,
    },
    /// A topic is not in the bag.
    #[error("no topic {topic:?} in {path:?}, which has {found:?}")]
    NoTopic {
        /// Topic sought.
        topic: String,
        /// Topics there are, with their types.
        found: Vec<String>,
        /// The file.
        path: PathBuf,
    },
    /// A field is not in a topic's messages.
    #[error("no number {field:?} in topic {topic:?} of type {kind:?}: {what}")]
    NoField {
        /// Field sought.
        field: String,
        /// The topic.
        topic: String,
        /// Its type.
        kind: String,
        /// Where the path ends, and what there is.
        what: String,
    },
    /// There is more than any log holds.
    #[error("more than {limit} {what} in {path:?}")]
    TooLarge {
        /// What there is too much of.
        what: String,
        /// The most that is read.
        limit: usize,
        /// The file.
        path: PathBuf,
    },
}
