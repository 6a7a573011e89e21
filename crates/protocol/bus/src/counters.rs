//! What the bus has done and lost, by name.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};

macro_rules! counters {
    ($(#[doc = $doc:literal] $name:ident),+ $(,)?) => {
        /// Counts of one session; never reset.
        #[derive(Debug, Default)]
        pub struct Counters {
            $(#[doc = $doc] pub(crate) $name: AtomicU64,)+
        }

        impl Counters {
            /// Returns all counts, sorted by name.
            #[must_use]
            pub fn snapshot(&self) -> BTreeMap<&'static str, u64> {
                self.list().into_iter().map(|(name, _, value)| (name, value)).collect()
            }

            /// Lists all counts: name, meaning, value.
            #[must_use]
            pub fn list(&self) -> Vec<(&'static str, &'static str, u64)> {
                vec![$((stringify!($name), $doc.trim_ascii(), self.$name.load(Ordering::Relaxed)),)+]
            }
        }
    };
}

counters! {
    /// Messages pushed.
    pushes,
    /// Pushes left out because the settings say so.
    withheld_pushes,
    /// Messages received.
    received,
    /// Received messages dropped because their queue was full.
    dropped,
    /// Received messages or queries that could not be read.
    unreadable,
    /// Pulls sent.
    pulls,
    /// Pulls that brought nothing.
    empty_pulls,
    /// Queries received.
    asked,
    /// Queries dropped because their queue was full.
    dropped_asks,
}

/// Adds one.
pub(crate) fn count(counter: &AtomicU64) {
    counter.fetch_add(1, Ordering::Relaxed);
}
