//! What can go wrong with the bus itself; a message that does not arrive is no error.

use std::fmt;

/// Says what the bus could not do.
#[derive(Debug, thiserror::Error)]
pub enum BusError {
    /// A setting is refused.
    #[error("bus setting {field} is {value:?}: {problem}")]
    Setting {
        /// Which setting.
        field: &'static str,
        /// Its value.
        value: String,
        /// What is wrong.
        problem: String,
    },
    /// Zenoh refused.
    #[error("bus cannot {doing}: {problem}")]
    Zenoh {
        /// What was being done.
        doing: &'static str,
        /// What Zenoh says.
        problem: String,
    },
    /// The operating system gave no random bytes or no port.
    #[error("bus cannot {doing}")]
    System {
        /// What was being done.
        doing: &'static str,
        /// What the system says.
        source: std::io::Error,
    },
}

/// Turns Zenoh's boxed errors into ours.
pub(crate) fn zenoh<E: fmt::Display>(doing: &'static str) -> impl Fn(E) -> BusError {
    move |error| BusError::Zenoh { doing, problem: error.to_string() }
}
