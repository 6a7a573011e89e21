//! What is wrong with a message, named by message and field.

use ds_space::Digest;
use ds_topic::{Slot, Topic};

/// Says why bytes are refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum WireError {
    /// The message is longer than its kind may be; nothing was decoded.
    #[error("{message} has {bytes} bytes, the limit is {most}")]
    TooLong {
        /// Which message.
        message: &'static str,
        /// Its length.
        bytes: usize,
        /// The limit.
        most: usize,
    },
    /// A list is longer than it may be; nothing was decoded.
    #[error("{message}.{field} has more than {most} elements")]
    TooMany {
        /// Which message.
        message: &'static str,
        /// Which list.
        field: &'static str,
        /// The limit.
        most: usize,
    },
    /// The bytes are not protobuf of this message.
    #[error("{message} cannot be decoded: {problem}")]
    Decode {
        /// Which message.
        message: &'static str,
        /// What the decoder says.
        problem: String,
    },
    /// A field does not hold what it should.
    #[error("{message}{} {problem}", dotted(.path))]
    Field {
        /// Which message.
        message: &'static str,
        /// The way to the field, such as `agents[3].pose.x_m`; empty for the message as a whole.
        path: String,
        /// What is wrong, with the value.
        problem: String,
    },
    /// The message belongs to another topic.
    #[error("{slot} came where topic {wanted:?} was wanted")]
    Topic {
        /// The slot in its header.
        slot: Slot,
        /// The topic that was wanted.
        wanted: Topic,
    },
    /// The digest in the header is not the one of the body.
    #[error("{slot} says content {stated:?}, its fields give {found:?}")]
    Content {
        /// The slot in its header.
        slot: Slot,
        /// The digest in the header.
        stated: Digest,
        /// The digest of the fields.
        found: Digest,
    },
}

/// Puts a dot in front of a name, none in front of an index.
fn dotted(path: &str) -> String {
    let dot = if path.is_empty() || path.starts_with('[') { "" } else { "." };
    format!("{dot}{path}")
}

/// A refused field, on its way up to the message that holds it.
#[derive(Debug, Clone, PartialEq)]
pub struct FieldError {
    path: String,
    problem: String,
}

impl FieldError {
    /// Refuses a field.
    pub fn new(field: &str, problem: impl Into<String>) -> Self {
        Self { path: field.to_owned(), problem: problem.into() }
    }

    /// Puts the field's parent in front.
    #[must_use]
    pub fn below(self, parent: &str) -> Self {
        Self { path: format!("{parent}{}", dotted(&self.path)), problem: self.problem }
    }

    /// Puts the list and the index of the element in front.
    #[must_use]
    pub fn within(self, list: &str, index: usize) -> Self {
        self.below(&format!("{list}[{index}]"))
    }

    /// Names the message.
    #[must_use]
    pub fn of(self, message: &'static str) -> WireError {
        WireError::Field { message, path: self.path, problem: self.problem }
    }
}
