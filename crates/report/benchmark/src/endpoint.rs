//! Endpoints: what a benchmark is to show, declared in a file before it is driven. They are kept in the folder of results,
//! belong to what shards must agree in, and are corrected together (Holm); all other comparisons are exploratory.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::file::{self, FileError};
use crate::judge::PROFILES;
use crate::source::CONDITIONS;

/// The most endpoints of a benchmark.
const MAX_ENDPOINTS: usize = 64;

/// The file of a declaration.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
struct EndpointFile {
    version: u32,
    endpoint: Vec<Endpoint>,
}

/// Which way a difference is to go.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Direction {
    /// Above 0.
    Up,
    /// Below 0.
    Down,
}

/// The scorer of the policies themselves; all others are oracles.
pub(crate) const LEARNED: &str = "learned";
/// The profile that outcomes are of, whatever profile scores.
const OF_OUTCOMES: &str = "strict";

/// What is claimed of driving scores in a profile, or of outcomes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Endpoint {
    /// What it is called.
    pub name: String,
    /// The score profile.
    pub profile: String,
    /// Which way the difference is to go.
    pub direction: Direction,
    /// What is compared.
    #[serde(flatten)]
    pub claim: Claim,
}

/// A paired difference of driving scores, or of shares of drives.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum Claim {
    /// Policy `second` minus policy `first`, on base sets.
    Policies {
        /// Who is compared with.
        first: String,
        /// Whose gain is claimed.
        second: String,
    },
    /// Of one policy: its mean difference to the base under the conditions of axis `second` minus that of axis `first`.
    Axes {
        /// The policy.
        policy: String,
        /// `lighting`, `weather` or `surface`.
        first: String,
        /// The other axis.
        second: String,
    },
    /// Of one policy: its share of drives with a contact on set `second` minus that on set `first`, paired by base scenario; of
    /// profile `strict`, as all outcomes are.
    Contacts {
        /// The policy.
        policy: String,
        /// The set that is compared with.
        first: String,
        /// The set whose further contacts are claimed.
        second: String,
    },
    /// Of one policy whose proposals an oracle ranks: driving score against adversaries minus that of their base.
    Coverage {
        /// The policy.
        policy: String,
    },
}

/// Reads a declaration.
///
/// # Errors
/// [`FileError`] if it cannot be read, or names a profile or an axis that there is not, or contacts in another profile than
/// `strict`.
pub fn load(path: &Path) -> Result<Vec<Endpoint>, FileError> {
    let shape = |at: String, problem: String| FileError::Shape { at, problem, path: path.to_owned() };
    let bytes = file::read(path)?;
    let text = std::str::from_utf8(&bytes).map_err(|error| shape(".".to_owned(), error.to_string()))?;
    let plan: EndpointFile = toml::from_str(text).map_err(|error| shape(".".to_owned(), error.to_string()))?;
    if plan.version != 1 || plan.endpoint.is_empty() || plan.endpoint.len() > MAX_ENDPOINTS {
        let problem =
            format!("version {} with {} endpoints, not version 1 with 1 to 64", plan.version, plan.endpoint.len());
        return Err(shape("version".to_owned(), problem));
    }
    for (index, endpoint) in plan.endpoint.iter().enumerate() {
        let refuse =
            |field: &str, value: &str| Err(shape(format!("endpoint[{index}].{field}"), format!("{value:?} is none")));
        let outcome = matches!(endpoint.claim, Claim::Contacts { .. });
        if !PROFILES.contains(&endpoint.profile.as_str()) || (outcome && endpoint.profile != OF_OUTCOMES) {
            return refuse("profile", &endpoint.profile);
        }
        if let Claim::Axes { first, second, .. } = &endpoint.claim {
            let unknown = [first, second].into_iter().find(|axis| CONDITIONS.iter().all(|(known, _)| known != axis));
            if let Some(axis) = unknown {
                return refuse("axis", axis);
            }
        }
    }
    Ok(plan.endpoint)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_declaration_is_sound_and_unknown_names_are_refused() {
        let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs/benchmark/plan.toml");
        let endpoints = load(&shipped).expect("sound");
        assert!(endpoints.len() >= 3);
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("plan.toml");
        let check = |line: &str, says: &str| {
            let head = "version = 1\n[[endpoint]]\nname = 'a'\ndirection = 'up'\n";
            std::fs::write(&path, format!("{head}{line}\n")).expect("written");
            let error = load(&path).expect_err(says).to_string();
            assert!(error.contains(says) && error.contains("plan.toml"), "{error}");
        };
        check("profile = 'lenient'\nkind = 'coverage'\npolicy = 'x'", "lenient");
        check("profile = 'strict'\nkind = 'axes'\npolicy = 'x'\nfirst = 'weather'\nsecond = 'grip'", "grip");
        check("profile = 'strict'\nkind = 'wish'\npolicy = 'x'", "wish");
        let sets = "policy = 'x'\nfirst = 'replay'\nsecond = 'reactive'";
        check(&format!("profile = 'bridgesim'\nkind = 'contacts'\n{sets}"), "bridgesim");
        check("profile = 'strict'\nkind = 'coverage'\npolicy = 'x'\nsurprise = 1", "surprise");
    }
}
