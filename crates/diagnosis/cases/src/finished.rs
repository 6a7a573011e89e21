//! Finished diagnoses in their folders, each with a note of the case that it was made from and of all that decided it.

use std::path::{Path, PathBuf};

use ds_diagnosis::Diagnosis;
use ds_diagnosis::schema::FILE;
use ds_space::{Digest, DigestWriter};

use crate::case::Options;
use crate::error::{CasesError, at};

/// The note beside a diagnosis: the folder of its case.
const NOTE: &str = "case.path";
/// The note of what decided it.
const INPUTS: &str = "inputs.digest";

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

/// Returns the digest of all that decides a diagnosis: the files of the case, the options and the program.
///
/// # Errors
/// If a file cannot be read.
pub fn inputs(case: &Path, options: &Options, program: &Digest) -> Result<Digest, CasesError> {
    let mut writer = DigestWriter::new();
    writer.digest(program).bool(options.quick).bool(options.discover);
    options.without.iter().for_each(|id| {
        writer.text(id);
    });
    let Options { simulator, baseline, nuisance, panel, .. } = options;
    writer.text(&format!("{simulator:?} {baseline:?}"));
    writer.text(
        &nuisance.as_ref().map(|n| format!("{} {:?} {:?}", n.count, n.mean, (&n.root, &n.clips))).unwrap_or_default(),
    );
    writer.text(&format!("{:?}", panel.policies)).digest(&panel.digest()?);
    let mut folders = vec![case.to_path_buf()];
    while let Some(folder) = folders.pop() {
        let entries = std::fs::read_dir(&folder).map_err(at(&folder))?;
        let mut paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
        paths.sort();
        for path in paths {
            if path.is_dir() {
                folders.push(path);
            } else {
                let name = path.strip_prefix(case).unwrap_or(&path).to_string_lossy().into_owned();
                writer.text(&name).digest(&Digest::of(&std::fs::read(&path).map_err(at(&path))?));
            }
        }
    }
    Ok(writer.finish())
}

/// Notes in the folder of a diagnosis what decided it.
///
/// # Errors
/// If the note cannot be written.
pub fn note_inputs(folder: &Path, inputs: &Digest) -> Result<(), CasesError> {
    let note = folder.join(INPUTS);
    std::fs::write(&note, format!("{inputs}\n")).map_err(at(&note))
}

/// Returns the diagnosis in a folder if it is whole and was decided by the same inputs.
#[must_use]
pub fn finished(folder: &Path, inputs: &Digest) -> Option<Diagnosis> {
    let noted = std::fs::read_to_string(folder.join(INPUTS)).ok()?;
    (Digest::from_hex(noted.trim_end())? == *inputs).then(|| Diagnosis::read(folder).ok()).flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_diagnosis_counts_as_finished_while_nothing_that_decided_it_has_changed() {
        let [case, folder] = [(); 2].map(|()| tempfile::tempdir().expect("a folder"));
        let (table, options) = (case.path().join("drive_0.csv"), Options::default());
        let of =
            |options: &Options, program: &[u8]| inputs(case.path(), options, &Digest::of(program)).expect("readable");
        std::fs::write(&table, "t,v").expect("written");
        let first = of(&options, b"program");
        assert!(finished(folder.path(), &first).is_none());
        Diagnosis::blank("case").write(folder.path()).expect("it can be written");
        note_inputs(folder.path(), &first).expect("it can be noted");
        assert!(finished(folder.path(), &of(&options, b"program")).is_some());
        assert!(finished(folder.path(), &of(&Options { quick: true, ..options.clone() }, b"program")).is_none());
        assert!(finished(folder.path(), &of(&options, b"another")).is_none());
        std::fs::write(&table, "t,w").expect("written");
        assert!(finished(folder.path(), &of(&options, b"program")).is_none());
        std::fs::write(folder.path().join(FILE), "{").expect("written");
        assert!(finished(folder.path(), &first).is_none(), "a torn file is no diagnosis");
    }

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
