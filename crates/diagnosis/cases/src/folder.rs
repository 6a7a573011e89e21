//! Folders of cases: which lie at some paths, and under which name each is written.

use std::path::{Path, PathBuf};

use ds_diagnosis::meta::FILE;

use crate::error::{CasesError, at};
use crate::logs;

/// Returns the case folders among some paths: those with a `meta.json`, and those in folders without one.
///
/// # Errors
/// If a path cannot be read or holds no case.
pub fn folders(paths: &[PathBuf]) -> Result<Vec<PathBuf>, CasesError> {
    let mut found = Vec::new();
    for path in paths {
        if path.join(FILE).exists() {
            found.push(path.clone());
            continue;
        }
        let entries = std::fs::read_dir(path).map_err(at(path))?;
        let mut inner: Vec<PathBuf> =
            entries.flatten().map(|entry| entry.path()).filter(|inner| inner.join(FILE).exists()).collect();
        if inner.is_empty() {
            return Err(CasesError::NoCase { path: path.clone() });
        }
        inner.sort();
        found.extend(inner);
    }
    Ok(found)
}

/// Returns the name under which each case is written: its folder's, after that of the folder above where two are alike.
#[must_use]
pub fn names(cases: &[PathBuf]) -> Vec<String> {
    let shared = |case: &Path| cases.iter().filter(|other| name(other) == name(case)).count() > 1;
    let long = |case: &Path| match case.canonicalize().ok().as_deref().and_then(Path::parent) {
        Some(above) => format!("{}-{}", name(above), name(case)),
        None => name(case),
    };
    cases.iter().map(|case| if shared(case) { long(case) } else { name(case) }).collect()
}

/// Returns the name of a folder; the vehicle logs of a run, which lie in `RUN/real`, are called after the run.
#[must_use]
pub fn name(case: &Path) -> String {
    let run = if case.ends_with("real") && logs::are_logs(case) { case.canonicalize().ok() } else { None };
    let case = run.as_deref().and_then(Path::parent).unwrap_or(case);
    case.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_else(|| "case".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cases_of_one_name_are_kept_apart() {
        let root = tempfile::tempdir().expect("a folder");
        let cases = ["car/case_01", "camera/case_01", "car/case_02"].map(|case| root.path().join(case));
        cases.iter().for_each(|case| std::fs::create_dir_all(case).expect("a folder"));
        assert_eq!(names(&cases), ["car-case_01", "camera-case_01", "case_02"]);
    }
}
