//! How strict a licence of scenarios is, and whether what it covers may be passed on.
//!
//! Four ranks: public domain, attribution, share alike, no commercial use. A licence that is not known here counts as the
//! strictest and is not passed on: nobody loses a right by not being listed.

/// Licences in order of strictness; those of a row are equally strict.
const RANKS: [&[&str]; 4] = [
    &["CC0-1.0", "PDDL-1.0"],
    &["Apache-2.0", "MIT", "BSD-2-Clause", "BSD-3-Clause", "CC-BY-4.0", "CDLA-Permissive-2.0"],
    &["CC-BY-SA-4.0", "ODbL-1.0"],
    &["CC-BY-NC-4.0", "CC-BY-NC-SA-4.0"],
];
/// The first rank that is not passed on: its conditions bind whoever takes the set, so users build it themselves.
const KEPT_FROM: usize = 3;

/// Returns the rank of a licence, from 0; one that is not known has the highest.
fn rank(licence: &str) -> usize {
    RANKS.iter().position(|row| row.contains(&licence)).unwrap_or(RANKS.len())
}

/// Returns the strictest of some licences, the first by name among equals; empty for none.
#[must_use]
pub fn strictest<'a>(licences: impl IntoIterator<Item = &'a str>) -> &'a str {
    licences.into_iter().max_by_key(|licence| (rank(licence), std::cmp::Reverse(*licence))).unwrap_or_default()
}

/// Says whether scenarios under a licence may be passed on with a set.
#[must_use]
pub fn redistributable(licence: &str) -> bool {
    rank(licence) < KEPT_FROM
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_strictest_rules_and_the_unknown_is_kept() {
        for (licences, expected, passed_on) in [
            (&["Apache-2.0"][..], "Apache-2.0", true),
            (&["Apache-2.0", "CC0-1.0"], "Apache-2.0", true),
            (&["CC-BY-4.0", "Apache-2.0"], "Apache-2.0", true),
            (&["CC0-1.0", "CC-BY-NC-SA-4.0", "MIT"], "CC-BY-NC-SA-4.0", false),
            (&["CC-BY-NC-4.0", "my own terms"], "my own terms", false),
            (&[""], "", false),
        ] {
            assert_eq!(strictest(licences.iter().copied()), expected, "{licences:?}");
            assert_eq!(redistributable(expected), passed_on, "{expected:?}");
        }
    }
}
