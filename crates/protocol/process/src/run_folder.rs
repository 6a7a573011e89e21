//! The folder of a run: one run at a time holds it, and what an earlier run left there is kept unless told otherwise.

use std::fs::{File, TryLockError};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};

/// The file whose lock says that a run holds the folder.
const LOCK: &str = "run.lock";
/// Where earlier results go.
const EARLIER: &str = "earlier";
/// Everything that a run writes to its folder; other files there are not touched.
const WRITTEN: [&str; 14] = [
    "ledger.redb",
    "recordings",
    "scenarios",
    "pictures",
    "real",
    "results.json",
    "report.html",
    "report.json",
    "report.md",
    "tables",
    "episodes.csv",
    "episodes.arrow",
    "aggregate.csv",
    "aggregate.arrow",
];

/// What becomes of an earlier run's results.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Earlier {
    /// The run goes on from them.
    Resumed,
    /// They are deleted.
    Overwritten,
    /// They are moved to a numbered folder beside the new ones.
    Kept,
}

/// A folder that this process holds for as long as the value lives; the system gives it back when the process ends.
#[derive(Debug)]
pub struct Held {
    _lock: File,
    /// Where the results of an earlier run went, if there were any to keep.
    pub set_aside: Option<PathBuf>,
}

/// Makes the folder if need be, takes hold of it and puts earlier results out of the way.
///
/// # Errors
/// If another run holds it, or the file system refuses.
pub fn take(out: &Path, earlier: Earlier) -> Result<Held> {
    std::fs::create_dir_all(out).with_context(|| format!("create {}", out.display()))?;
    let path = out.join(LOCK);
    let failed = || format!("lock {}", path.display());
    let mut options = File::options();
    let mut lock = options.read(true).write(true).create(true).truncate(false).open(&path).with_context(failed)?;
    match lock.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => {
            let mut holder = String::new();
            lock.read_to_string(&mut holder).with_context(failed)?;
            bail!(
                "{} is in use by another run (process {}): wait for its end or give another --out; nothing was touched",
                out.display(),
                holder.trim()
            );
        }
        Err(TryLockError::Error(error)) => return Err(error).with_context(failed),
    }
    lock.set_len(0).with_context(failed)?;
    writeln!(lock, "{}", std::process::id()).with_context(failed)?;
    let set_aside = match earlier {
        Earlier::Resumed => None,
        Earlier::Overwritten => delete(out).map(|()| None)?,
        Earlier::Kept => set_aside(out)?,
    };
    Ok(Held { _lock: lock, set_aside })
}

fn delete(out: &Path) -> Result<()> {
    for name in WRITTEN {
        let path = out.join(name);
        let removed = if path.is_dir() {
            std::fs::remove_dir_all(&path)
        } else if path.exists() {
            std::fs::remove_file(&path)
        } else {
            Ok(())
        };
        removed.with_context(|| format!("remove {}", path.display()))?;
    }
    Ok(())
}

fn set_aside(out: &Path) -> Result<Option<PathBuf>> {
    let found: Vec<&str> = WRITTEN.into_iter().filter(|name| out.join(name).exists()).collect();
    if found.is_empty() {
        return Ok(None);
    }
    let all = out.join(EARLIER);
    let free = (1_u32..).map(|number| all.join(number.to_string())).find(|folder| !folder.exists());
    let folder = free.context("no free number for earlier results")?;
    std::fs::create_dir_all(&folder).with_context(|| format!("create {}", folder.display()))?;
    for name in found {
        let (from, to) = (out.join(name), folder.join(name));
        std::fs::rename(&from, &to).with_context(|| format!("move {} to {}", from.display(), to.display()))?;
    }
    Ok(Some(folder))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_run_holds_a_folder_and_earlier_results_are_kept() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let out = folder.path().join("out");
        let write = |name: &str, text: &str| {
            let path = out.join(name);
            std::fs::create_dir_all(path.parent().expect("a folder")).expect("made");
            std::fs::write(path, text).expect("written");
        };
        let read = |name: &str| std::fs::read_to_string(out.join(name)).ok();
        let held = take(&out, Earlier::Kept).expect("a fresh folder");
        write("results.json", "first");
        write("recordings/a.mcap", "recorded");
        write("notes.txt", "mine");
        let refused = take(&out, Earlier::Overwritten).expect_err("it is held").to_string();
        assert!(refused.contains("in use by another run") && refused.contains(&std::process::id().to_string()));
        assert_eq!(read("results.json").as_deref(), Some("first"));
        drop(held);
        drop(take(&out, Earlier::Resumed).expect("given back"));
        assert_eq!(read("results.json").as_deref(), Some("first"));
        drop(take(&out, Earlier::Kept).expect("given back"));
        assert_eq!(read("results.json"), None);
        assert_eq!(read("earlier/1/results.json").as_deref(), Some("first"));
        assert_eq!(read("earlier/1/recordings/a.mcap").as_deref(), Some("recorded"));
        write("results.json", "second");
        drop(take(&out, Earlier::Kept).expect("given back"));
        assert_eq!(read("earlier/2/results.json").as_deref(), Some("second"));
        write("results.json", "third");
        drop(take(&out, Earlier::Overwritten).expect("given back"));
        assert_eq!((read("results.json"), read("earlier/3/results.json")), (None, None));
        assert_eq!(read("notes.txt").as_deref(), Some("mine"));
    }
}
