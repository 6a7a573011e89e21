//! The one list of id kinds. Each is a type of its own, so that one cannot stand for another.

use std::fmt;
use std::sync::Arc;

/// The longest text id that is accepted, in bytes.
pub const MAX_ID_BYTES: usize = 96;

/// Says why a text is not an id.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum IdError {
    /// The text is empty.
    #[error("{kind} is empty")]
    Empty {
        /// The kind of id that was asked for.
        kind: &'static str,
    },
    /// The text is longer than [`MAX_ID_BYTES`].
    #[error("{kind} has {bytes} bytes, the limit is {MAX_ID_BYTES}")]
    TooLong {
        /// The kind of id that was asked for.
        kind: &'static str,
        /// The length of the refused text.
        bytes: usize,
    },
    /// The text has a character that could break a topic key or a file name.
    #[error("{kind} {text:?} may hold only letters, digits, '_', '-' and '.', and not begin with '.'")]
    Character {
        /// The kind of id that was asked for.
        kind: &'static str,
        /// The refused text.
        text: String,
    },
}

fn check(kind: &'static str, text: &str) -> Result<Arc<str>, IdError> {
    if text.is_empty() {
        return Err(IdError::Empty { kind });
    }
    if text.len() > MAX_ID_BYTES {
        return Err(IdError::TooLong { kind, bytes: text.len() });
    }
    let allowed = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.');
    if text.starts_with('.') || !text.chars().all(allowed) {
        return Err(IdError::Character { kind, text: text.to_owned() });
    }
    Ok(Arc::from(text))
}

macro_rules! text_id {
    ($(#[$doc:meta])* $name:ident, $kind:literal) => {
        $(#[$doc])*
        #[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub struct $name(Arc<str>);

        impl $name {
            /// Checks that the text is safe in a topic key and a file name.
            ///
            /// # Errors
            /// [`IdError`] names what is wrong.
            pub fn new(text: &str) -> Result<Self, IdError> {
                check($kind, text).map(Self)
            }

            /// Returns the id as text.
            #[must_use]
            pub fn as_str(&self) -> &str {
                &self.0
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(&self.0)
            }
        }

        impl fmt::Debug for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "{:?}", &*self.0)
            }
        }
    };
}

text_id!(
    /// One drive of one policy through one scenario with one seed.
    EpisodeId, "episode id"
);
text_id!(
    /// A camera of the rig, unique within a scenario.
    CameraId, "camera id"
);
text_id!(
    /// A submitted set of episodes.
    RunId, "run id"
);
text_id!(
    /// One started process (or embedded service) that joined the fleet; a restart is a new instance.
    InstanceId, "instance id"
);

/// The number of a try at an episode, from 1; a new attempt starts from tick 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct AttemptId(pub u32);

/// The index of an agent in its scenario's list of tracks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct AgentId(pub u32);

impl fmt::Display for AttemptId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl fmt::Display for AgentId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refuses_what_would_break_a_topic_key() {
        for text in ["", "a/b", "a*", "..", ".hidden", "ü", "a b", &"x".repeat(97)] {
            assert!(EpisodeId::new(text).is_err(), "{text:?} was accepted");
        }
        assert_eq!(EpisodeId::new("scene-0061.s3").map(|id| id.to_string()), Ok("scene-0061.s3".to_owned()));
    }
}
