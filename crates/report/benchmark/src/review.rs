//! What people say of variants: a file of verdicts for each reviewer beside the manifest, `SET.REVIEWER.verdicts.json`.
//!
//! A verdict is kept under the digest of the adversary, so a variant that was made anew is unreviewed again. A variant
//! that any reviewer rejects is rejected; one that somebody accepts and nobody rejects is accepted.

pub mod page;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::file::{self, FileError};
use crate::manifest::{Entry, Manifest, Recipe};

/// The format's name in files.
const FORMAT: &str = "dreamstream-verdicts";
/// The format's version.
const VERSION: u32 = 1;
/// How files of verdicts end.
const SUFFIX: &str = ".verdicts.json";
/// The longest name of a reviewer and the longest reason, in bytes.
const LONGEST: [usize; 2] = [40, 200];

/// What a reviewer says of a variant.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Verdict {
    /// The entry, for readers.
    pub name: String,
    /// Whether it may stay.
    pub accepted: bool,
    /// Why not; empty if it may.
    #[serde(default)]
    pub reason: String,
}

/// All verdicts of a reviewer on a set.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Verdicts {
    /// `dreamstream-verdicts`.
    format: String,
    /// The format's version.
    version: u32,
    /// The set's name.
    pub set: String,
    /// Who says it.
    pub reviewer: String,
    /// By digest of the adversary.
    verdicts: BTreeMap<String, Verdict>,
}

/// Why a verdict is none.
#[derive(Debug, thiserror::Error)]
pub enum VerdictError {
    /// The name of a reviewer becomes part of a file's name.
    #[error("reviewer {0:?} is not 1 to 40 letters, digits, - or _")]
    Reviewer(String),
    /// The set has no such entry.
    #[error("set {set:?} has no entry {name:?}")]
    Unknown {
        /// The set.
        set: String,
        /// The name.
        name: String,
    },
    /// The entry has no adversary.
    #[error("entry {0:?} has no adversary to review")]
    Plain(String),
    /// A rejection has no reason, or a long one.
    #[error("entry {0:?} is rejected without a reason of 1 to 200 bytes: write NAME=REASON")]
    Reason(String),
    /// An entry is accepted and rejected, or rejected twice.
    #[error("entry {0:?} is given two verdicts")]
    Twice(String),
}

impl Verdicts {
    /// Reads what a reviewer has said of a set whose manifest lies in `folder`; nothing yet where there is no file.
    ///
    /// # Errors
    /// [`FileError`] if the file is damaged or is of another set, reviewer or format.
    pub fn of(folder: &Path, set: &Manifest, reviewer: &str) -> Result<Self, FileError> {
        let path = Self::path(folder, set, reviewer);
        if !path.exists() {
            let (format, set, reviewer) = (FORMAT.to_owned(), set.name.clone(), reviewer.to_owned());
            return Ok(Self { format, version: VERSION, set, reviewer, verdicts: BTreeMap::new() });
        }
        let told = Self::load(&path)?;
        let refuse = |field: &str, value: &str, rule| {
            Err(FileError::Value { field: field.to_owned(), value: format!("{value:?}"), rule, path: path.clone() })
        };
        if told.set != set.name {
            return refuse("set", &told.set, "not the set that the file is named after");
        }
        if told.reviewer != reviewer {
            return refuse("reviewer", &told.reviewer, "not whom the file is named after");
        }
        Ok(told)
    }

    /// Reads a file of verdicts, wherever it lies.
    ///
    /// # Errors
    /// [`FileError`] if the file is damaged or is of another format.
    pub fn load(path: &Path) -> Result<Self, FileError> {
        let told: Self = file::read_json(path)?;
        if told.format != FORMAT || told.version != VERSION {
            let (field, value) = ("format".to_owned(), format!("{:?} {}", told.format, told.version));
            let rule = "not a format that this program reads";
            return Err(FileError::Value { field, value, rule, path: path.to_owned() });
        }
        Ok(told)
    }

    /// Returns where the verdicts lie.
    #[must_use]
    pub fn path(folder: &Path, set: &Manifest, reviewer: &str) -> PathBuf {
        folder.join(format!("{}.{reviewer}{SUFFIX}", set.name))
    }

    /// Takes verdicts: names to accept, and names to reject with the reason; earlier ones on the same variants go.
    ///
    /// # Errors
    /// [`VerdictError`] names the first that is none; nothing is taken then.
    pub fn take(&mut self, set: &Manifest, accept: &[String], reject: &[(String, String)]) -> Result<(), VerdictError> {
        let known = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if self.reviewer.is_empty() || self.reviewer.len() > LONGEST[0] || !self.reviewer.chars().all(known) {
            return Err(VerdictError::Reviewer(self.reviewer.clone()));
        }
        let accepted = accept.iter().map(|name| (name, true, ""));
        let rejected = reject.iter().map(|(name, reason)| (name, false, reason.trim()));
        let (mut taken, mut seen) = (Vec::new(), BTreeSet::new());
        for (name, accepted, reason) in accepted.chain(rejected) {
            let entry = set.entries.iter().find(|entry| entry.name == *name);
            let unknown = || VerdictError::Unknown { set: set.name.clone(), name: name.clone() };
            let digest = entry.ok_or_else(unknown)?.adversary_digest.clone();
            let digest = digest.ok_or_else(|| VerdictError::Plain(name.clone()))?;
            if !accepted && (reason.is_empty() || reason.len() > LONGEST[1]) {
                return Err(VerdictError::Reason(name.clone()));
            }
            if !seen.insert(name) {
                return Err(VerdictError::Twice(name.clone()));
            }
            taken.push((digest, Verdict { name: name.clone(), accepted, reason: reason.to_owned() }));
        }
        self.verdicts.extend(taken);
        Ok(())
    }

    /// Writes the verdicts beside the manifest, in one step.
    ///
    /// # Errors
    /// [`FileError::Write`].
    pub fn save(&self, folder: &Path, set: &Manifest) -> Result<(), FileError> {
        file::write_json(self, &Self::path(folder, set, &self.reviewer))
    }

    fn on(&self, entry: &Entry) -> Option<&Verdict> {
        self.verdicts.get(entry.adversary_digest.as_ref()?)
    }
}

/// Where a variant stands.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Standing {
    /// Nobody said anything of this adversary.
    Unreviewed,
    /// Somebody accepts it, nobody rejects it.
    Accepted,
    /// Why it is rejected.
    Rejected(String),
}

/// What all reviewers say of a set.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Review {
    /// The set's name.
    pub set: String,
    /// The reviewers, in order of their names.
    pub by: Vec<Verdicts>,
}

impl Review {
    /// Reads all verdicts on a set whose manifest lies in `folder`; none where the folder is not there.
    ///
    /// # Errors
    /// [`FileError`] as for [`Verdicts::of`].
    pub fn beside(folder: &Path, set: &Manifest) -> Result<Self, FileError> {
        let mut reviewers = BTreeSet::new();
        for file in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            let name = file.file_name();
            let whole = name.to_str().and_then(|name| name.strip_prefix(&set.name)?.strip_prefix('.'));
            let reviewer = whole.and_then(|name| name.strip_suffix(SUFFIX)).filter(|who| !who.contains('.'));
            reviewers.extend(reviewer.map(str::to_owned));
        }
        let by = reviewers.iter().map(|who| Verdicts::of(folder, set, who)).collect::<Result<_, _>>()?;
        Ok(Self { set: set.name.clone(), by })
    }

    /// Takes what a reviewer says, in the place of what the same one was known to say.
    pub fn hear(&mut self, said: Verdicts) {
        self.by.retain(|by| by.reviewer != said.reviewer);
        self.by.push(said);
        self.by.sort_by(|a, b| a.reviewer.cmp(&b.reviewer));
    }

    /// Returns where a variant stands.
    #[must_use]
    pub fn standing(&self, entry: &Entry) -> Standing {
        let said: Vec<(&str, &Verdict)> =
            self.by.iter().filter_map(|by| Some((by.reviewer.as_str(), by.on(entry)?))).collect();
        let rejected = said.iter().filter(|(_, verdict)| !verdict.accepted);
        let reasons: Vec<String> = rejected.map(|(who, verdict)| format!("{} ({who})", verdict.reason)).collect();
        match (said.is_empty(), reasons.is_empty()) {
            (true, _) => Standing::Unreviewed,
            (_, true) => Standing::Accepted,
            (_, false) => Standing::Rejected(reasons.join("; ")),
        }
    }

    /// Counts accepted, rejected and unreviewed variants.
    #[must_use]
    pub fn counts(&self, set: &Manifest) -> [usize; 3] {
        let standings: Vec<Standing> = set.entries.iter().map(|entry| self.standing(entry)).collect();
        let accepted = standings.iter().filter(|standing| **standing == Standing::Accepted).count();
        let unreviewed = standings.iter().filter(|standing| **standing == Standing::Unreviewed).count();
        [accepted, standings.len() - accepted - unreviewed, unreviewed]
    }

    /// Returns of each pair of reviewers who both judged some variants: their names, how many, and kappa.
    #[must_use]
    pub fn agreement(&self, set: &Manifest) -> Vec<([&str; 2], usize, Option<f64>)> {
        let mut found = Vec::new();
        for (index, a) in self.by.iter().enumerate() {
            for b in &self.by[index + 1..] {
                let both = set.entries.iter().filter_map(|entry| Some((a.on(entry)?.accepted, b.on(entry)?.accepted)));
                let both: Vec<(bool, bool)> = both.collect();
                if !both.is_empty() {
                    found.push(([a.reviewer.as_str(), b.reviewer.as_str()], both.len(), ds_stats::kappa(&both)));
                }
            }
        }
        found
    }

    /// Returns the accepted variants as a set of its own, to be reported beside the whole; nothing if there are none.
    #[must_use]
    pub fn accepted(&self, set: &Manifest) -> Option<Manifest> {
        let [accepted, rejected, unreviewed] = self.counts(set);
        let entries = set.entries.iter().filter(|entry| self.standing(entry) == Standing::Accepted).cloned().collect();
        let left = [("rejected by review", rejected), ("unreviewed", unreviewed)];
        let rejected = left.map(|(reason, count)| (reason.to_owned(), count as u64)).into();
        let recipe = Recipe { candidates: set.entries.len() as u64, rejected, ..set.recipe.clone() };
        (accepted > 0).then(|| Manifest::new(&format!("{} (accepted)", set.name), set.kind, recipe, entries))
    }

    /// Says in a line where the set stands.
    #[must_use]
    pub fn told(&self, set: &Manifest) -> String {
        let [accepted, rejected, unreviewed] = self.counts(set);
        let mut told = format!("reviewed: {accepted} accepted, {rejected} rejected, {unreviewed} unreviewed");
        for ([a, b], count, kappa) in self.agreement(set) {
            let kappa = kappa.map_or("not defined: both say the same of all".to_owned(), |kappa| format!("{kappa:.2}"));
            told += &format!("; kappa of {a} and {b} on {count}: {kappa}");
        }
        told
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::manifest::Kind;
    use crate::manifest::tests::entry;

    fn set(names: &[&str], made: &str) -> Manifest {
        let entries = names
            .iter()
            .map(|name| Entry { adversary_digest: Some(format!("{made}{name}")), ..entry(name, "Apache-2.0") });
        Manifest::new("some", Kind::Behavior, Recipe::default(), entries.collect())
    }

    fn give(folder: &Path, set: &Manifest, who: &str, accept: &[&str], reject: &[(&str, &str)]) {
        let mut verdicts = Verdicts::of(folder, set, who).expect("sound");
        let accept: Vec<String> = accept.iter().map(|name| (*name).to_owned()).collect();
        let reject: Vec<_> = reject.iter().map(|(name, why)| ((*name).to_owned(), (*why).to_owned())).collect();
        verdicts.take(set, &accept, &reject).expect("sound verdicts");
        verdicts.save(folder, set).expect("written");
    }

    #[test]
    fn verdicts_follow_the_adversary_and_two_reviewers_are_compared() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let set_a = set(&["a", "b", "c", "d"], "");
        assert_eq!(Review::beside(folder.path(), &set_a).expect("none").counts(&set_a), [0, 0, 4]);
        give(folder.path(), &set_a, "anna", &["a", "b"], &[("c", "appears from nowhere")]);
        give(folder.path(), &set_a, "ben", &["a"], &[("b", "too fast"), ("c", "no road")]);
        let review = Review::beside(folder.path(), &set_a).expect("sound");
        assert_eq!(review.counts(&set_a), [1, 2, 1]);
        assert_eq!(review.standing(&set_a.entries[1]), Standing::Rejected("too fast (ben)".to_owned()));
        let accepted = review.accepted(&set_a).expect("one is accepted");
        assert_eq!((accepted.name.as_str(), accepted.entries.len()), ("some (accepted)", 1));
        // Agreed on 2 of 3; by chance 2/3 · 1/3 + 1/3 · 2/3 = 4/9.
        let agreement = review.agreement(&set_a);
        assert_eq!((agreement[0].0, agreement[0].1), (["anna", "ben"], 3));
        assert!(agreement[0].2.is_some_and(|kappa| (kappa - 0.4).abs() < 1e-12), "{agreement:?}");
        // Verdicts from elsewhere stand beside those of others, and in the place of the same reviewer's.
        let elsewhere = tempfile::tempdir().expect("a temporary folder");
        give(elsewhere.path(), &set_a, "ben", &["a", "b"], &[]);
        let path = Verdicts::path(elsewhere.path(), &set_a, "ben");
        let mut heard = review.clone();
        heard.hear(Verdicts::load(&path).expect("sound"));
        assert_eq!((heard.by.len(), heard.counts(&set_a)), (2, [2, 1, 1]));
        let foreign = std::fs::read_to_string(&path).expect("readable").replace("dreamstream-verdicts", "letters");
        std::fs::write(&path, foreign).expect("written");
        let error = Verdicts::load(&path).expect_err("foreign").to_string();
        assert!(error.contains("letters") && error.contains("ben.verdicts.json"), "{error}");
        // Made anew, all are unreviewed again.
        let anew = set(&["a", "b", "c", "d"], "anew");
        assert_eq!(Review::beside(folder.path(), &anew).expect("sound").counts(&anew), [0, 0, 4]);
    }

    #[test]
    fn what_is_no_verdict_is_refused_and_nothing_is_taken() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let set = set(&["a", "b"], "");
        let refused = |who: &str, accept: &[&str], reject: &[(&str, &str)]| {
            let mut verdicts = Verdicts::of(folder.path(), &set, who).expect("none yet");
            let accept: Vec<String> = accept.iter().map(|name| (*name).to_owned()).collect();
            let reject: Vec<_> = reject.iter().map(|(name, why)| ((*name).to_owned(), (*why).to_owned())).collect();
            let error = verdicts.take(&set, &accept, &reject).expect_err("refused").to_string();
            assert!(verdicts.verdicts.is_empty());
            error
        };
        assert!(refused("anna", &["a", "x"], &[]).contains("\"x\""));
        assert!(refused("anna", &["a"], &[("b", " ")]).contains("NAME=REASON"));
        assert!(refused("anna", &["a"], &[("a", "both")]).contains("two verdicts"));
        assert!(refused("../x", &["a"], &[]).contains("../x"));
        give(folder.path(), &set, "anna", &["a"], &[]);
        std::fs::rename(Verdicts::path(folder.path(), &set, "anna"), Verdicts::path(folder.path(), &set, "ben"))
            .expect("moved");
        let error = Review::beside(folder.path(), &set).expect_err("another reviewer").to_string();
        assert!(error.contains("\"reviewer\"") && error.contains("some.ben.verdicts.json"), "{error}");
    }
}
