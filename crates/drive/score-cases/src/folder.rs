//! A folder of case files to one object of answers, in order of file names.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use crate::case::answer_case;
use crate::error::ScoreCaseError;
use crate::fields::MAX_CASE_BYTES;

/// The list of cases beside them, which is no case.
const INDEX: &str = "index.json";

/// The answers of a folder.
#[derive(Debug)]
pub struct Answers {
    /// Case id → answer; a case that failed has `{"error": text}`.
    pub value: Value,
    /// The cases that failed, with file and reason.
    pub failures: Vec<(PathBuf, ScoreCaseError)>,
}

/// Answers all cases of a folder, or of its subfolder `cases` where there is one.
///
/// # Errors
/// [`ScoreCaseError`] if the folder cannot be read, holds no case, or two cases share an id. A case that cannot be
/// answered is no error here: its answer says why.
pub fn answers(folder: &Path) -> Result<Answers, ScoreCaseError> {
    let mut values = Map::new();
    let mut failures = Vec::new();
    for path in case_files(folder)? {
        let (id, answer) = match read(&path).and_then(|text| answer_case(&text)) {
            Ok((id, answer)) => (id, answer),
            Err(error) => {
                let stem = path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
                let answer = json!({ "error": text_of(&error) });
                failures.push((path.clone(), error));
                (stem, answer)
            }
        };
        if values.contains_key(&id) {
            return Err(ScoreCaseError::Twice { id, path });
        }
        values.insert(id, answer);
    }
    Ok(Answers { value: Value::Object(values), failures })
}

/// As [`answers`], the object alone.
///
/// # Errors
/// As [`answers`].
pub fn answer(folder: &Path) -> Result<Value, ScoreCaseError> {
    answers(folder).map(|answers| answers.value)
}

fn text_of(error: &ScoreCaseError) -> String {
    let mut text = error.to_string();
    let mut source = std::error::Error::source(error);
    while let Some(cause) = source {
        text += &format!(": {cause}");
        source = cause.source();
    }
    text
}

fn case_files(folder: &Path) -> Result<Vec<PathBuf>, ScoreCaseError> {
    let inner = folder.join("cases");
    let folder = if inner.is_dir() { inner } else { folder.to_path_buf() };
    let failed = |source| ScoreCaseError::Read { path: folder.clone(), source };
    let mut files = Vec::new();
    for entry in fs::read_dir(&folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        let is_case = path.extension().is_some_and(|extension| extension == "json")
            && path.file_name().is_some_and(|name| name != INDEX);
        if is_case {
            files.push(path);
        }
    }
    if files.is_empty() {
        return Err(ScoreCaseError::NoCases { path: folder });
    }
    files.sort();
    Ok(files)
}

fn read(path: &Path) -> Result<String, ScoreCaseError> {
    let failed = |source| ScoreCaseError::Read { path: path.to_path_buf(), source };
    let bytes = fs::metadata(path).map_err(failed)?.len();
    if bytes > MAX_CASE_BYTES {
        return Err(ScoreCaseError::TooLarge { path: path.to_path_buf(), bytes });
    }
    fs::read_to_string(path).map_err(failed)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CASE: &str = r#"{"schema": "collision_type/1", "case_id": "pair", "pairs": [{
        "ego": {"x": 0, "y": 0, "heading": 0, "speed": 5},
        "object": {"type": "VEHICLE", "x": 6, "y": 0, "heading": 0, "length": 4, "width": 2, "speed": 3}}]}"#;

    fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("a folder");
        for (name, text) in files {
            let path = folder.path().join(name);
            fs::create_dir_all(path.parent().expect("inside")).expect("a folder");
            fs::write(path, text).expect("a file");
        }
        folder
    }

    #[test]
    fn a_folder_and_its_cases_are_found() {
        let expected = json!({ "pair": { "pairs": [{ "expected": "ACTIVE_FRONT_COLLISION" }] } });
        for name in ["a.json", "cases/a.json"] {
            let folder = folder(&[(name, CASE), ("index.json", "[]"), ("README.md", "")]);
            assert_eq!(answer(folder.path()).expect("a case"), expected);
        }
        assert!(matches!(answer(folder(&[]).path()), Err(ScoreCaseError::NoCases { .. })));
        assert!(matches!(
            answer(folder(&[("a.json", CASE), ("b.json", CASE)]).path()),
            Err(ScoreCaseError::Twice { .. })
        ));
    }

    #[test]
    fn a_bad_case_says_why_and_spoils_no_other() {
        let long = CASE.replace("\"length\": 4", "\"length\": \"four\"");
        for (text, says) in [
            ("{", "cannot be read: EOF"),
            (r#"{"schema": "x/9", "case_id": "c"}"#, "schema \"x/9\" is not known"),
            (r#"{"schema": "comfort/1", "case_id": "c"}"#, "missing field `states`"),
            (long.as_str(), "field \"pairs[0].object.length\" cannot be read: invalid type"),
            (&CASE.replace("VEHICLE", "TRAM"), "field \"pairs[0].object.type\" has the value \"TRAM\""),
            (r#"{"schema": "comfort/1", "case_id": "c", "states": [[0,0,0,0,0,0,0,0,0,0,0]]}"#, "has 1 states"),
        ] {
            let folder = folder(&[("bad.json", text), ("good.json", CASE)]);
            let answers = answers(folder.path()).expect("a folder");
            let error = answers.value["bad"]["error"].as_str().expect("an error").to_owned();
            assert!(error.contains(says), "{error:?} does not say {says:?}");
            assert!(answers.value["pair"]["pairs"].is_array());
            assert!(answers.failures.len() == 1 && answers.failures[0].0.ends_with("bad.json"));
        }
    }
}
