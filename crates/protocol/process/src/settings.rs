//! Settings of a process: one TOML file with `version = 1`, then `DREAMSTREAM_<SECTION>_<KEY>`, then flags.
//!
//! Text becomes one fully checked value before any port, device or session opens; unknown keys are errors that name
//! file, path and value.

use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;

/// The version of all settings files.
pub const VERSION: i64 = 1;
/// The largest accepted settings file, in bytes.
const MAX_FILE_BYTES: u64 = 1 << 20;

/// Says what is wrong with the settings.
#[derive(Debug, thiserror::Error)]
pub enum SettingsError {
    /// The file cannot be read.
    #[error("settings cannot be read: {path:?}")]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        #[source]
        source: std::io::Error,
    },
    /// The file is too large.
    #[error("settings hold {bytes} bytes, the limit is {MAX_FILE_BYTES}: {path:?}")]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Its size.
        bytes: u64,
    },
    /// The file is not TOML.
    #[error("settings are not TOML: {path:?}")]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Where.
        #[source]
        source: toml::de::Error,
    },
    /// The version is missing or unknown.
    #[error("settings need \"version = {VERSION}\", found {found:?}: {path:?}")]
    Version {
        /// The file.
        path: PathBuf,
        /// What stands there.
        found: Option<String>,
    },
    /// An override is not of the form `section.key=value`.
    #[error("override {text:?} is not section.key=value")]
    Override {
        /// The text.
        text: String,
    },
    /// A key is unknown or a value is of the wrong kind.
    #[error("settings refused")]
    Value(#[source] toml::de::Error),
    /// A value is out of bounds.
    #[error("setting \"{key}\" is {value}: {why}")]
    Bounds {
        /// Section and key.
        key: &'static str,
        /// The value.
        value: String,
        /// What is allowed.
        why: &'static str,
    },
}

/// Where settings come from, weakest first.
#[derive(Debug, Default)]
pub struct Sources<'a> {
    /// The settings file, if any.
    pub file: Option<&'a Path>,
    /// Environment variables as (name, value).
    pub environment: Vec<(String, String)>,
    /// Flags, each `section.key=value`.
    pub overrides: Vec<String>,
}

impl<'a> Sources<'a> {
    /// Takes the process's own environment.
    #[must_use]
    pub fn of_process(file: Option<&'a Path>, overrides: &[String]) -> Self {
        let environment = std::env::vars().filter(|(name, _)| name.starts_with(PREFIX)).collect();
        Self { file, environment, overrides: overrides.to_vec() }
    }
}

const PREFIX: &str = "DREAMSTREAM_";

/// Merges the sources over the defaults of `T`.
///
/// # Errors
/// [`SettingsError`] names file, key and value.
pub fn load<T: Serialize + DeserializeOwned + Default>(sources: &Sources<'_>) -> Result<T, SettingsError> {
    let mut table = toml::Table::try_from(T::default()).expect("default settings are a table");
    if let Some(path) = sources.file {
        merge(&mut table, read(path)?);
    }
    for (name, value) in &sources.environment {
        let lower = name.trim_start_matches(PREFIX).to_lowercase();
        if let Some((section, key)) = lower.split_once('_')
            && table.get(section).is_some_and(toml::Value::is_table)
        {
            set(&mut table, section, key, value);
        }
    }
    for text in &sources.overrides {
        let parsed = text.split_once('=').and_then(|(path, value)| path.split_once('.').map(|(s, k)| (s, k, value)));
        let (section, key, value) = parsed.ok_or_else(|| SettingsError::Override { text: text.clone() })?;
        set(&mut table, section, key, value);
    }
    table.try_into().map_err(SettingsError::Value)
}

fn read(path: &Path) -> Result<toml::Table, SettingsError> {
    let read_error = |source| SettingsError::Read { path: path.to_path_buf(), source };
    let bytes = std::fs::metadata(path).map_err(read_error)?.len();
    if bytes > MAX_FILE_BYTES {
        return Err(SettingsError::TooLarge { path: path.to_path_buf(), bytes });
    }
    let text = std::fs::read_to_string(path).map_err(read_error)?;
    let mut table: toml::Table =
        text.parse().map_err(|source| SettingsError::Syntax { path: path.to_path_buf(), source })?;
    match table.remove("version") {
        Some(toml::Value::Integer(VERSION)) => Ok(table),
        other => Err(SettingsError::Version { path: path.to_path_buf(), found: other.map(|value| value.to_string()) }),
    }
}

fn merge(into: &mut toml::Table, from: toml::Table) {
    for (key, value) in from {
        match (into.get_mut(&key), value) {
            (Some(toml::Value::Table(inner)), toml::Value::Table(outer)) => merge(inner, outer),
            (_, value) => {
                into.insert(key, value);
            }
        }
    }
}

fn set(table: &mut toml::Table, section: &str, key: &str, text: &str) {
    let value = match format!("v = {text}").parse::<toml::Table>() {
        Ok(mut parsed) => parsed.remove("v").unwrap_or_else(|| toml::Value::String(text.to_owned())),
        Err(_) => toml::Value::String(text.to_owned()),
    };
    let entry = table.entry(section).or_insert_with(|| toml::Value::Table(toml::Table::new()));
    if let toml::Value::Table(inner) = entry {
        inner.insert(key.to_owned(), value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;
    use std::error::Error;

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    struct Bus {
        port: u16,
        listen: String,
    }
    impl Default for Bus {
        fn default() -> Self {
            Self { port: 1, listen: "loopback".to_owned() }
        }
    }
    #[derive(Debug, Default, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    struct Settings {
        bus: Bus,
    }

    fn with(file: &str, environment: &[(&str, &str)], overrides: &[&str]) -> Result<Settings, SettingsError> {
        let folder = std::env::temp_dir().join(format!("settings-{}-{}", std::process::id(), Digest::name(file)));
        std::fs::write(&folder, file).expect("temporary file is written");
        let result = load(&Sources {
            file: Some(&folder),
            environment: environment.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect(),
            overrides: overrides.iter().map(|text| (*text).to_owned()).collect(),
        });
        std::fs::remove_file(&folder).expect("temporary file is removed");
        result
    }

    struct Digest;
    impl Digest {
        fn name(text: &str) -> String {
            ds_space::Digest::of(text.as_bytes()).to_string()
        }
    }

    #[test]
    fn later_sources_are_stronger() {
        let file = "version = 1\n[bus]\nport = 2\nlisten = \"file\"";
        let settings = with(file, &[("DREAMSTREAM_BUS_PORT", "3"), ("DREAMSTREAM_SLOW_TESTS", "1")], &["bus.port=4"]);
        assert_eq!(settings.expect("sound"), Settings { bus: Bus { port: 4, listen: "file".to_owned() } });
    }

    #[test]
    fn bad_settings_are_refused_by_name() {
        let cases: &[(&str, &[&str], &str)] = &[
            ("version = 1\n[bus]\nprot = 2", &[], "prot"),
            ("version = 1\n[bsu]\nport = 2", &[], "bsu"),
            ("version = 1\n[bus]\nport = 70000", &[], "70000"),
            ("version = 1\n[bus]\nport = \"x\"", &[], "port"),
            ("version = 2", &[], "version"),
            ("[bus]\nport = 2", &[], "version"),
            ("version = 1\n[bus", &[], "not TOML"),
            ("version = 1\nbus = 3", &[], "invalid type"),
            ("version = 1", &["nonsense"], "section.key=value"),
            ("version = 1", &["bus.colour=red"], "colour"),
        ];
        for (file, overrides, says) in cases {
            let error = with(file, &[], overrides).expect_err(says);
            let mut text = error.to_string();
            if let Some(source) = error.source() {
                text.push_str(&source.to_string());
            }
            assert!(text.contains(says), "{text:?} does not say {says:?}");
        }
    }
}
