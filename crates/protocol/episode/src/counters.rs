//! What a machine counts, so that nothing is dropped in silence.

use std::ops::{AddAssign, Sub};

macro_rules! counters {
    ($(#[doc = $doc:literal] $name:ident),+ $(,)?) => {
        /// Counts since the machine was made.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
        pub struct Counters {
            $(#[doc = $doc] pub $name: u64,)+
        }

        impl Counters {
            /// Lists all counts: name, meaning, value.
            #[must_use]
            pub fn list(&self) -> Vec<(&'static str, &'static str, u64)> {
                vec![$((stringify!($name), $doc.trim_ascii(), self.$name),)+]
            }
        }

        impl AddAssign for Counters {
            fn add_assign(&mut self, other: Self) {
                $(self.$name += other.$name;)+
            }
        }

        /// What a machine has counted since an earlier look at it.
        impl Sub for Counters {
            type Output = Self;
            fn sub(self, earlier: Self) -> Self {
                Self { $($name: self.$name.saturating_sub(earlier.$name),)+ }
            }
        }
    };
}

counters! {
    /// Messages that were asked for.
    pulls,
    /// Sequence numbers that were skipped by pushes (lost or overtaken).
    gaps,
    /// Messages that were there already, with equal content.
    duplicates,
    /// Messages refused because their epoch or publisher is not the assigned one.
    refused_epochs,
    /// Orders refused because a higher term is known.
    refused_terms,
    /// Orders that were sent (driver) or seen (stage) again.
    repeats,
    /// Messages dropped because the inbox was full or they lie beyond it; pulled later.
    dropped,
    /// Messages of another episode, attempt or schema version.
    foreign,
    /// Plans that came after one was accepted, from a later epoch, with other content (the first is final).
    superseded_plans,
    /// Outputs that were made while the lease had run out.
    withheld,
    /// Roles given to another instance.
    reassignments,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn looks_at_one_machine_add_up() {
        let (first, second) =
            (Counters { pulls: 2, ..Counters::default() }, Counters { pulls: 5, gaps: 1, ..Counters::default() });
        let mut sum = first;
        sum += second - first;
        assert_eq!(sum, second);
        assert_eq!(sum.list()[0], ("pulls", "Messages that were asked for.", 5));
    }
}
