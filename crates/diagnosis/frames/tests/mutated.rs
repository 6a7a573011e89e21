//! Mutated cases of frames: each is refused by name or can be diagnosed; never a panic, a hang or memory without bound.

use std::fs;
use std::path::Path;
use std::sync::LazyLock;

use ds_frames::{FrameCase, Options, diagnose};

/// Of the cases that can be read, one in so many is diagnosed too.
const DIAGNOSED: u64 = 10;
/// What is changed, in turn.
const FILES: [&str; 4] = ["frames.csv", "meta.json", "sim/0003.jpg", "real/0005.jpg"];

static WHOLE: LazyLock<tempfile::TempDir> = LazyLock::new(|| {
    let folder = tempfile::tempdir().expect("a temporary folder");
    crate::pair::write(folder.path(), 1, &[]);
    folder
});

fn copied(to: &Path) {
    for side in ["", "sim", "real"] {
        fs::create_dir_all(to.join(side)).expect("a folder");
        for entry in fs::read_dir(WHOLE.path().join(side)).expect("the sound case").flatten() {
            if entry.path().is_file() {
                fs::copy(entry.path(), to.join(side).join(entry.file_name())).expect("copied");
            }
        }
    }
}

#[test]
fn mutated_cases_are_refused_or_read() {
    crate::mutation::all_are_borne("mutated::mutated_cases_are_refused_or_read", |index| {
        let folder = tempfile::tempdir().expect("a temporary folder");
        copied(folder.path());
        let name = FILES[(index % 4) as usize];
        let path = folder.path().join(name);
        let whole = fs::read(&path).expect("a file");
        let changed = match std::str::from_utf8(&whole) {
            Ok(text) => crate::mutation::text(text, name, index),
            Err(_) => crate::mutation::bytes(&whole, name, index),
        };
        fs::write(&path, changed).expect("written");
        if let Ok(case) = FrameCase::read(folder.path())
            && (index / 4).is_multiple_of(DIAGNOSED)
        {
            drop(diagnose(&case, &Options::default()));
        }
    });
}
