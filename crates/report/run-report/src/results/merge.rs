//! Several runs, such as the shards of one, as one.

use std::path::{Path, PathBuf};

use super::{Results, Run};

/// Why runs cannot be put together.
#[derive(Debug, thiserror::Error)]
pub enum MergeError {
    /// There is no run.
    #[error("nothing to merge")]
    Nothing,
    /// Two runs are not of one kind.
    #[error(
        "{} and {} ran with other versions, weights or settings; `--force` merges them all the same",
        first.display(),
        second.display()
    )]
    Differ {
        /// The first run.
        first: PathBuf,
        /// The run that differs from it.
        second: PathBuf,
    },
    /// One run was driven by the wall clock, the other was not.
    #[error("{} and {}: one was driven by the wall clock, the other was not; they are never one result", first.display(), second.display())]
    Clocks {
        /// The first run.
        first: PathBuf,
        /// The run that differs from it.
        second: PathBuf,
    },
    /// A folder has no path.
    #[error("path of {}", path.display())]
    Path {
        /// The folder.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
}

impl Results {
    /// Puts the episodes of several runs, each with the path it was loaded from, into one; recordings are named by whole
    /// paths.
    ///
    /// # Errors
    /// If there is none, versions, weights or settings differ and are not forced together, or only some were driven by the
    /// wall clock.
    pub fn merge(runs: Vec<(PathBuf, Self)>, force: bool) -> Result<Self, MergeError> {
        let mut runs = runs.into_iter();
        let (first, mut merged) = runs.next().ok_or(MergeError::Nothing)?;
        for (path, results) in runs {
            if results.by_wall_clock() != merged.by_wall_clock() {
                return Err(MergeError::Clocks { first, second: path });
            }
            if !force && settings(&results.run) != settings(&merged.run) {
                return Err(MergeError::Differ { first, second: path });
            }
            merged.run.wall_s += results.run.wall_s;
            merged.run.insecure |= results.run.insecure;
            merged.run.seeds.extend(results.run.seeds);
            let folder = folder_of(&path);
            let here =
                folder.canonicalize().map_err(|source| MergeError::Path { path: folder.to_path_buf(), source })?;
            merged.episodes.extend(results.episodes.into_iter().map(|mut episode| {
                if !episode.recording.is_empty() && Path::new(&episode.recording).is_relative() {
                    episode.recording = here.join(&episode.recording).display().to_string();
                }
                episode
            }));
        }
        merged.run.seeds.sort_unstable();
        merged.run.seeds.dedup();
        Ok(merged)
    }
}

/// Returns the folder of a run, given it or a file in it.
pub(crate) fn folder_of(path: &Path) -> &Path {
    if path.is_dir() { path } else { path.parent().unwrap_or(Path::new(".")) }
}

/// What runs must have in common: versions, weights, settings.
fn settings(run: &Run) -> ([&str; 5], [u32; 2], u64) {
    let Run { version, video_model_digest, policy_model_digest, agents, tracker, .. } = run;
    let texts = [version, video_model_digest, policy_model_digest, agents, tracker].map(String::as_str);
    (texts, [run.replan_period, run.history], run.horizon_secs.to_bits())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::Episode;

    fn run(scenario: &str, seed: u64, history: u32) -> Results {
        let recording = format!("recordings/{scenario}.mcap");
        Results {
            run: Run { seeds: vec![seed], history, wall_s: 1.0, ..Run::default() },
            episodes: vec![Episode { scenario: scenario.to_owned(), recording, ..Episode::default() }],
        }
    }

    #[test]
    fn shards_become_one_and_other_settings_are_refused() {
        let root = tempfile::tempdir().expect("a folder");
        let runs = |history: u32| {
            vec![(root.path().to_path_buf(), run("a", 1, 1)), (root.path().to_path_buf(), run("b", 0, history))]
        };
        let merged = Results::merge(runs(1), false).expect("one kind");
        assert_eq!((merged.run.seeds.as_slice(), merged.episodes.len()), ([0, 1].as_slice(), 2));
        assert!(Path::new(&merged.episodes[1].recording).is_absolute() && merged.run.wall_s > 1.9);
        assert!(matches!(Results::merge(runs(4), false), Err(MergeError::Differ { .. })));
        assert_eq!(Results::merge(runs(4), true).expect("forced").episodes.len(), 2);
        assert!(matches!(Results::merge(Vec::new(), true), Err(MergeError::Nothing)));
    }
}
