//! What the system tests share: where the workspace lies, which real data is present.

use std::path::{Path, PathBuf};

/// Returns the root of the workspace.
#[must_use]
pub fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Returns a folder of the real data beside the checkout, or says that the test is skipped.
#[must_use]
pub fn shared(folder: &str) -> Option<PathBuf> {
    let path = workspace().join("../shared").join(folder);
    if path.exists() {
        return Some(path);
    }
    eprintln!("skipped: ../shared/{folder} is absent");
    None
}
