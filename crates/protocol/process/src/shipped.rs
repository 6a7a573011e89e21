//! The files that come with the program: scenarios, configurations and weights. They are named as in a checkout and looked
//! for in the current folder, then in `share/dreamstream` beside the folder of the installed program.

use std::path::{Path, PathBuf};

use clap::builder::{PathBufValueParser, TypedValueParser};

/// Returns the parser of an argument that may name a file that comes with the program.
#[must_use]
pub fn parser() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().map(|path| find(&path))
}

/// Returns where a file is; the path as it is if it is nowhere.
#[must_use]
pub fn find(path: &Path) -> PathBuf {
    find_in(path, share().as_deref())
}

/// Returns what an error says of a path that is nowhere: the path, and where else it was looked for.
#[must_use]
pub fn describe(path: &Path) -> String {
    match share() {
        Some(share) if path.is_relative() => format!("{} (nor is it in {})", path.display(), share.display()),
        _ => path.display().to_string(),
    }
}

fn find_in(path: &Path, share: Option<&Path>) -> PathBuf {
    let installed = share.filter(|_| path.is_relative() && !path.exists()).map(|share| share.join(path));
    installed.filter(|path| path.exists()).unwrap_or_else(|| path.to_owned())
}

fn share() -> Option<PathBuf> {
    let program = std::env::current_exe().ok()?.canonicalize().ok()?;
    Some(program.parent()?.parent()?.join("share/dreamstream"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_is_taken_from_here_then_from_the_installed_files_else_as_it_is() {
        let share = tempfile::tempdir().expect("a temporary folder");
        std::fs::write(share.path().join("model.toml"), "").expect("a file");
        std::fs::write(share.path().join("Cargo.toml"), "").expect("a file");
        let check = |path: &str, expected: &Path| {
            assert_eq!(find_in(Path::new(path), Some(share.path())), expected);
            assert_eq!(find_in(Path::new(path), None), Path::new(path));
        };
        check("model.toml", &share.path().join("model.toml"));
        check("Cargo.toml", Path::new("Cargo.toml"));
        check("absent.toml", Path::new("absent.toml"));
        check("/model.toml", Path::new("/model.toml"));
    }
}
