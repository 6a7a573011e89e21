//! Results that others have published: values with source, setting and data, and why they are not comparable with ours.
//! They stand in a block of their own and enter no ranking.

use std::path::{Path, PathBuf};

use serde::Deserialize;

use crate::file::{self, FileError};
use crate::table::{Table, Value};

/// The file.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Published {
    /// The format's version, 1.
    pub version: u32,
    /// The results.
    #[serde(default)]
    pub result: Vec<PublishedResult>,
}

/// One published value.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PublishedResult {
    /// Who drove.
    pub policy: String,
    /// What was measured, such as `DS`.
    pub metric: String,
    /// The value, as it was published.
    pub value: String,
    /// On which set, ranked by whom.
    pub setting: String,
    /// From which data.
    pub data: String,
    /// Where it stands.
    pub source: String,
    /// Why it is not comparable with what this program drives.
    pub not_comparable: String,
}

impl Published {
    /// Reads the file.
    ///
    /// # Errors
    /// [`FileError`] if it cannot be read, is of another version, or a value has no reason.
    pub fn load(path: &Path) -> Result<Self, FileError> {
        let shape =
            |at: &str, problem: String| FileError::Shape { at: at.to_owned(), problem, path: PathBuf::from(path) };
        let bytes = file::read(path)?;
        let text = std::str::from_utf8(&bytes).map_err(|error| shape(".", error.to_string()))?;
        let published: Self = toml::from_str(text).map_err(|error| shape(".", error.to_string()))?;
        if published.version != 1 {
            return Err(shape("version", format!("{} is not 1", published.version)));
        }
        for (index, result) in published.result.iter().enumerate() {
            if result.not_comparable.trim().is_empty() || result.source.trim().is_empty() {
                return Err(shape(
                    &format!("result[{index}]"),
                    "source and not_comparable must not be empty".to_owned(),
                ));
            }
        }
        Ok(published)
    }

    /// Returns the block of published results.
    #[must_use]
    pub fn table(&self) -> Table {
        let row = |r: &PublishedResult| {
            let cells = [&r.policy, &r.metric, &r.value, &r.setting, &r.data, &r.source, &r.not_comparable];
            cells.map(Value::text).to_vec()
        };
        Table {
            id: "published",
            title: "Published by others",
            note: "As published, with other scenarios, weights and renderers: not comparable with the tables above and not \
                   ranked with them."
                .to_owned(),
            columns: vec!["policy", "metric", "value", "setting", "data", "source", "not comparable because"],
            rows: self.result.iter().map(row).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_file_is_sound_and_a_value_without_reason_is_refused() {
        let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs/benchmark/published.toml");
        let published = Published::load(&shipped).expect("sound");
        assert_eq!(published.table().rows.len(), published.result.len());
        assert!(published.result.iter().any(|result| result.policy == "DrivoR"));
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("published.toml");
        let line = "policy='a'\nmetric='DS'\nvalue='1'\nsetting='s'\ndata='d'\nsource='x'\nnot_comparable=' '\n";
        std::fs::write(&path, format!("version=1\n[[result]]\n{line}")).expect("written");
        assert!(Published::load(&path).expect_err("no reason").to_string().contains("result[0]"));
    }
}
