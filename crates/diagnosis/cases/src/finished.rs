//! Finished diagnoses in their folders, each with a note of the case that it was made from.

use std::path::{Path, PathBuf};

use ds_diagnosis::schema::FILE;

use crate::error::{CasesError, at};

/// The note beside a diagnosis: the folder of its case.
const NOTE: &str = "case.path";

/// Returns the diagnoses at a path: the file itself, that of the folder, or those of the folders in it.
///
/// # Errors
/// If the path cannot be read or holds none.
pub fn diagnoses(path: &Path) -> Result<Vec<PathBuf>, CasesError> {
    if path.is_file() {
        return Ok(vec![path.to_path_buf()]);
    }
    if path.join(FILE).is_file() {
        return Ok(vec![path.join(FILE)]);
    }
    let entries = std::fs::read_dir(path).map_err(at(path))?;
    let mut found: Vec<PathBuf> = entries.flatten().map(|entry| entry.path().join(FILE)).collect();
    found.retain(|file| file.is_file());
    if found.is_empty() {
        return Err(CasesError::NoDiagnosis { path: path.to_path_buf() });
    }
    found.sort();
    Ok(found)
}

/// Notes in the folder of a diagnosis from which case it was made.
///
/// # Errors
/// If the case is not there or the note cannot be written.
pub fn note_case(folder: &Path, case: &Path) -> Result<(), CasesError> {
    let whole = std::fs::canonicalize(case).map_err(at(case))?;
    let note = folder.join(NOTE);
    std::fs::write(&note, format!("{}\n", whole.display())).map_err(at(&note))
}

/// Returns the case that a diagnosis was made from, if it was noted.
#[must_use]
pub fn noted_case(diagnosis: &Path) -> Option<PathBuf> {
    let text = std::fs::read_to_string(diagnosis.with_file_name(NOTE)).ok()?;
    Some(PathBuf::from(text.trim_end()))
}

#[cfg(test)]
mod tests {
    use ds_diagnosis::Diagnosis;

    use super::*;

    #[test]
    fn diagnoses_are_found_with_the_case_they_were_made_from() {
        let root = tempfile::tempdir().expect("a folder");
        assert!(matches!(diagnoses(root.path()), Err(CasesError::NoDiagnosis { .. })));
        let [a, b] = ["a", "b"].map(|name| root.path().join(name));
        for folder in [&b, &a] {
            Diagnosis::blank("case").write(folder).expect("it can be written");
        }
        note_case(&a, root.path()).expect("it can be noted");
        let found = diagnoses(root.path()).expect("two of them");
        assert_eq!(found, [a.join(FILE), b.join(FILE)]);
        assert_eq!(diagnoses(&a).expect("one of them"), [a.join(FILE)]);
        assert_eq!(noted_case(&found[0]), Some(root.path().canonicalize().expect("a path")));
        assert_eq!(noted_case(&found[1]), None);
    }
}
