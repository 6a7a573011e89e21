//! Mutated case folders: each is refused by name or can be diagnosed; never a panic, a hang or memory without bound.

use std::fs;
use std::path::Path;
use std::sync::LazyLock;

use ds_dynamics::case::Case;
use ds_dynamics::{Options, diagnose, synthetic};

/// Of the cases that can be read, one in so many is diagnosed too.
const DIAGNOSED: u64 = 10;

static WHOLE: LazyLock<tempfile::TempDir> = LazyLock::new(|| {
    let folder = tempfile::tempdir().expect("a temporary folder");
    synthetic::write_case(folder.path(), 3, &|_| {}).expect("a sound case");
    folder
});

/// Reads a case one file of which is changed.
fn read_with(name: &str, index: u64) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for entry in fs::read_dir(WHOLE.path()).expect("the sound case").flatten() {
        fs::copy(entry.path(), folder.path().join(entry.file_name())).expect("copied");
    }
    let path = folder.path().join(name);
    let whole = fs::read_to_string(&path).expect("a text");
    // Most of a table is alike: a short one is hit more often where it matters.
    let whole = if index.is_multiple_of(2) { shortened(&whole) } else { whole };
    fs::write(&path, crate::mutation::text(&whole, name, index)).expect("written");
    read(folder.path(), index);
}

/// Returns the first tenth of a table, or a description as it is.
fn shortened(whole: &str) -> String {
    let lines: Vec<&str> = whole.lines().collect();
    if whole.starts_with('{') { whole.to_owned() } else { lines[..lines.len() / 10 + 1].join("\n") + "\n" }
}

fn read(folder: &Path, index: u64) {
    if let Ok(case) = Case::read(folder)
        && index.is_multiple_of(DIAGNOSED)
    {
        drop(diagnose(&case, &Options { quick: true, without: Vec::new() }));
    }
}

#[test]
fn mutated_tables_are_refused_or_read() {
    crate::mutation::all_are_borne("mutated::mutated_tables_are_refused_or_read", |index| {
        read_with(["drive_0.csv", "agents_0.csv", "drive_1.csv"][(index % 3) as usize], index);
    });
}

#[test]
fn mutated_descriptions_are_refused_or_read() {
    crate::mutation::all_are_borne("mutated::mutated_descriptions_are_refused_or_read", |index| {
        read_with("meta.json", index)
    });
}
