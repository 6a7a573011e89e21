//! A set of scenarios as a file, `NAME.set.json`: what is in it, under which licence, how it was made, and its digest.
//!
//! The digest is BLAKE3 over the content in the order of the fields; where files lie is no content. A manifest that is
//! changed by hand, claims a licence that its entries do not have, or names an entry twice is refused.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use ds_space::{Digest, DigestWriter};
use serde::{Deserialize, Serialize};

use crate::file::{self, FileError};
use crate::licence;

/// The format's name in files.
pub const FORMAT: &str = "dreamstream-set";
/// The format's version.
pub const VERSION: u32 = 1;
/// How manifests end.
pub const SUFFIX: &str = ".set.json";
/// The most entries of a set.
const MAX_ENTRIES: usize = 100_000;

/// What a set is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// Ordinary scenarios.
    Base,
    /// Base scenarios with an adversary.
    Behavior,
    /// Base scenarios under other conditions.
    Weather,
}

/// How a set was made.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// The command.
    pub command: String,
    /// Where scenarios come from: `town` (generated again from their names) or `files`.
    pub source: String,
    /// Digest over the settings that decide what is in the set.
    pub settings_digest: String,
    /// Version of the program.
    pub program: String,
    /// The first seed.
    pub seed: u64,
    /// Scenarios that were looked at.
    pub candidates: u64,
    /// How many of them are not in the set, by reason.
    #[serde(default)]
    pub rejected: BTreeMap<String, u64>,
}

/// One scenario of a set.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    /// The entry's name, unique in the set.
    pub name: String,
    /// The scenario file, from the manifest's folder; absent where it is made from its name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<PathBuf>,
    /// The scenario's own name.
    pub scenario: String,
    /// The scenario's digest.
    pub scenario_digest: String,
    /// The entry of the base set that this one is a change of.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub base: Option<String>,
    /// Look of the drive, as `run --appearance` takes it.
    #[serde(default = "day")]
    pub appearance: String,
    /// The log that the scenario was cut from; windows of one log are relatives.
    pub log: String,
    /// The scenario's family or class.
    pub category: String,
    /// Its licence.
    pub licence: String,
    /// Whom to name.
    pub attribution: String,
    /// The tick at which the policy takes over.
    pub hand_over: u32,
    /// The last tick that is driven and scored.
    pub last: u32,
    /// Digest of the adversary, in sets of kind `behavior`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub adversary_digest: Option<String>,
    /// Digest of the drive that survives it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub solution_digest: Option<String>,
    /// What a reviewer said.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verdict: Option<String>,
}

/// The look of an entry that names none.
fn day() -> String {
    "day".to_owned()
}

/// A set.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// [`FORMAT`].
    pub format: String,
    /// [`VERSION`].
    pub version: u32,
    /// The set's name.
    pub name: String,
    /// What it is for.
    pub kind: Kind,
    /// The strictest licence of its entries.
    pub licence: String,
    /// Whether its scenarios may be passed on.
    pub redistributable: bool,
    /// How it was made.
    pub recipe: Recipe,
    /// The scenarios, in order of their names.
    pub entries: Vec<Entry>,
    /// Digest over all above.
    pub digest: String,
}

impl Manifest {
    /// Makes a set of some entries: sorted, with licence and digest.
    #[must_use]
    pub fn new(name: &str, kind: Kind, recipe: Recipe, mut entries: Vec<Entry>) -> Self {
        entries.sort_by(|a, b| a.name.cmp(&b.name));
        let strictest = licence::strictest(entries.iter().map(|entry| entry.licence.as_str())).to_owned();
        let redistributable = licence::redistributable(&strictest);
        let (format, name) = (FORMAT.to_owned(), name.to_owned());
        let digest = String::new();
        let mut set =
            Self { format, version: VERSION, name, kind, licence: strictest, redistributable, recipe, entries, digest };
        set.digest = set.content().to_string();
        set
    }

    /// Reads and checks a manifest.
    ///
    /// # Errors
    /// [`FileError`] names file, field and value: unreadable, another format, a digest that is not the content's, a
    /// licence that is not the strictest of the entries', an entry twice.
    pub fn load(path: &Path) -> Result<Self, FileError> {
        let set: Self = file::read_json(path)?;
        set.check().map_err(refused(path))?;
        Ok(set)
    }

    /// Returns where the manifest of a set goes in a folder, before it is known what is in the set.
    ///
    /// # Errors
    /// [`FileError`] if the name is none of a file, or a set of another recipe is there.
    pub fn place(folder: &Path, name: &str, recipe: &Recipe) -> Result<PathBuf, FileError> {
        let path = folder.join(format!("{name}{SUFFIX}"));
        check_name(name).map_err(refused(&path))?;
        // What a recipe comes to is only known in the end.
        let asked = |recipe: &Recipe| Recipe { candidates: 0, rejected: BTreeMap::new(), ..recipe.clone() };
        if path.exists() && !Self::load(&path).is_ok_and(|there| asked(&there.recipe) == asked(recipe)) {
            return Err(FileError::Exists { path });
        }
        Ok(path)
    }

    /// Refuses what may not be written to a path, and touches nothing.
    ///
    /// # Errors
    /// [`FileError`] if another set is there, or the set is one that [`Self::load`] refuses.
    pub fn savable(&self, path: &Path) -> Result<(), FileError> {
        self.check().map_err(refused(path))?;
        if path.exists() && !Self::load(path).is_ok_and(|there| there.digest == self.digest) {
            return Err(FileError::Exists { path: path.to_owned() });
        }
        Ok(())
    }

    /// Writes the manifest in one step; an existing file stays unless it holds the same set.
    ///
    /// # Errors
    /// As for [`Self::savable`], and if the file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), FileError> {
        self.savable(path)?;
        file::write_json(self, path)
    }

    /// Returns the digest over the content.
    #[must_use]
    pub fn content(&self) -> Digest {
        let mut writer = DigestWriter::new();
        writer.text(&self.format).u32(self.version).text(&self.name).u32(self.kind as u32).text(&self.licence);
        writer.bool(self.redistributable);
        let recipe = &self.recipe;
        writer.text(&recipe.command).text(&recipe.source).text(&recipe.settings_digest).text(&recipe.program);
        writer.u64(recipe.seed).u64(recipe.candidates).u64(recipe.rejected.len() as u64);
        for (reason, count) in &recipe.rejected {
            writer.text(reason).u64(*count);
        }
        writer.u64(self.entries.len() as u64);
        for entry in &self.entries {
            writer.text(&entry.name).text(&entry.scenario).text(&entry.scenario_digest).text(&entry.appearance);
            writer.text(&entry.log).text(&entry.category).text(&entry.licence).text(&entry.attribution);
            writer.u32(entry.hand_over).u32(entry.last);
            for told in [&entry.base, &entry.adversary_digest, &entry.solution_digest, &entry.verdict] {
                writer.bool(told.is_some()).text(told.as_deref().unwrap_or_default());
            }
        }
        writer.finish()
    }

    /// Returns where the scenario file of an entry lies, for a manifest in `folder`; nothing where it is made from its
    /// name.
    #[must_use]
    pub fn file_of(folder: &Path, entry: &Entry) -> Option<PathBuf> {
        entry.file.as_ref().map(|file| folder.join(file))
    }

    fn check(&self) -> Result<(), Refusal> {
        let refuse = |field: &str, value: &dyn ToString, rule| Err((field.to_owned(), value.to_string(), rule));
        if self.format != FORMAT {
            return refuse("format", &self.format, "not \"dreamstream-set\"");
        }
        if self.version != VERSION {
            return refuse("version", &self.version, "not a version that this program reads");
        }
        check_name(&self.name)?;
        if self.entries.is_empty() || self.entries.len() > MAX_ENTRIES {
            return refuse("entries", &self.entries.len(), "not 1 to 100,000 entries");
        }
        let strictest = licence::strictest(self.entries.iter().map(|entry| entry.licence.as_str()));
        if self.licence != strictest {
            return refuse("licence", &self.licence, "not the strictest of the entries' licences");
        }
        if self.redistributable != licence::redistributable(strictest) {
            return refuse("redistributable", &self.redistributable, "not what the licence says");
        }
        let mut names = BTreeSet::new();
        for (index, entry) in self.entries.iter().enumerate() {
            entry.check().map_err(|(field, value, rule)| (format!("entries[{index}].{field}"), value, rule))?;
            if !names.insert(&entry.name) {
                return refuse(&format!("entries[{index}].name"), &entry.name, "a name that another entry has");
            }
        }
        let content = self.content();
        if self.digest != content.to_string() {
            let value = format!("{} (the content's is {content})", self.digest);
            return refuse("digest", &value, "not the digest of the content: the file was changed or damaged");
        }
        Ok(())
    }
}

/// Field, value, and what it breaks.
type Refusal = (String, String, &'static str);

/// Returns what makes the error of a file of a refusal.
fn refused(path: &Path) -> impl FnOnce(Refusal) -> FileError {
    move |(field, value, rule)| FileError::Value { field, value, rule, path: path.to_owned() }
}

fn check_name(name: &str) -> Result<(), Refusal> {
    if name.is_empty() || name.contains(['/', '\\', '\0']) {
        return Err(("name".to_owned(), format!("{name:?}"), "not the name of a file"));
    }
    Ok(())
}

impl Entry {
    fn check(&self) -> Result<(), Refusal> {
        let refuse = |field: &str, value: &str, rule| Err((field.to_owned(), value.to_owned(), rule));
        for (field, value) in [("name", &self.name), ("scenario", &self.scenario), ("log", &self.log)] {
            if value.is_empty() || value.len() > 256 {
                return refuse(field, value, "not 1 to 256 bytes of text");
            }
        }
        if Digest::from_hex(&self.scenario_digest).is_none() {
            return refuse("scenario_digest", &self.scenario_digest, "not 64 hexadecimal digits");
        }
        if self.hand_over >= self.last {
            return refuse("hand_over", &self.hand_over.to_string(), "not before the last tick");
        }
        Ok(())
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) fn entry(name: &str, licence: &str) -> Entry {
        Entry {
            name: name.to_owned(),
            scenario: name.to_owned(),
            scenario_digest: Digest::of(name.as_bytes()).to_string(),
            appearance: day(),
            log: name.to_owned(),
            category: "cut-in".to_owned(),
            licence: licence.to_owned(),
            hand_over: 20,
            last: 100,
            ..Entry::default()
        }
    }

    pub(crate) fn set(names: &[&str]) -> Manifest {
        let entries = names.iter().map(|name| entry(name, "Apache-2.0")).collect();
        Manifest::new("some", Kind::Base, Recipe { source: "town".to_owned(), ..Recipe::default() }, entries)
    }

    fn refused(change: impl FnOnce(&mut serde_json::Value)) -> String {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("some.set.json");
        let mut value = serde_json::to_value(set(&["a", "b"])).expect("plain values");
        change(&mut value);
        std::fs::write(&path, value.to_string()).expect("written");
        let error = Manifest::load(&path).expect_err("it must be refused").to_string();
        assert!(error.contains("some.set.json"), "{error} does not name the file");
        error
    }

    #[test]
    fn a_set_comes_back_and_is_not_overwritten_by_another() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("some.set.json");
        let (one, other) = (set(&["b", "a"]), set(&["a", "c"]));
        one.save(&path).expect("written");
        assert_eq!(Manifest::load(&path).expect("sound"), one);
        assert_eq!(one.entries[0].name, "a");
        one.save(&path).expect("the same again");
        assert!(matches!(other.save(&path), Err(FileError::Exists { .. })));
        assert_eq!(Manifest::load(&path).expect("sound"), one);
        assert_eq!(Manifest::place(folder.path(), "some", &one.recipe).expect("the same recipe"), path);
        let another = Recipe { seed: 1, ..one.recipe.clone() };
        assert!(matches!(Manifest::place(folder.path(), "some", &another), Err(FileError::Exists { .. })));
    }

    #[test]
    fn what_could_not_be_read_again_is_not_written() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("new.set.json");
        let twice = set(&["a", "a"]);
        let told = twice.save(&path).expect_err("one name twice").to_string();
        assert!(told.contains("entries[1].name") && !path.exists(), "{told}");
        for name in ["", "a/b"] {
            let told = Manifest::place(folder.path(), name, &twice.recipe).expect_err("no name of a file").to_string();
            assert!(told.contains("\"name\""), "{told}");
        }
    }

    #[test]
    fn what_was_changed_is_named() {
        let told = refused(|set| set["entries"][0]["category"] = "other".into());
        assert!(told.contains("\"digest\"") && told.contains("changed or damaged"), "{told}");
        let told = refused(|set| set["entries"][1]["licence"] = "CC-BY-NC-SA-4.0".into());
        assert!(told.contains("\"licence\"") && told.contains("Apache-2.0"), "{told}");
        let told = refused(|set| set["redistributable"] = false.into());
        assert!(told.contains("\"redistributable\""), "{told}");
        let told = refused(|set| set["version"] = 2.into());
        assert!(told.contains("\"version\"") && told.contains('2'), "{told}");
        let told = refused(|set| set["entries"][1]["name"] = "a".into());
        assert!(told.contains("entries[1].name"), "{told}");
        let told = refused(|set| set["entries"][1]["last"] = 20.into());
        assert!(told.contains("entries[1].hand_over"), "{told}");
        let told = refused(|set| set["entries"][0]["surprise"] = 1.into());
        assert!(told.contains("surprise"), "{told}");
    }

    #[test]
    fn where_files_lie_is_no_content() {
        let mut set = set(&["a"]);
        set.entries[0].file = Some("elsewhere/a.scenario.json".into());
        assert_eq!(set.content().to_string(), set.digest);
    }
}
