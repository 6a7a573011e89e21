//! How commands open recordings: whole, or with `--partial` what is there, which is then said.

use std::path::{Path, PathBuf};

use anyhow::{Result, anyhow};
use ds_record::{RecordError, Recording, damage};
use ds_run_report::Results;
use rayon::prelude::*;

use ds_process::terminal::answer;

/// What a command says of a recording that it refuses.
const REFUSED: &str = "`--partial` takes what is there, and says so";

/// Opens a recording; one that is not whole is refused, or with `partial` told on stdout.
///
/// # Errors
/// If it cannot be read, is no recording, or is not whole without `partial`.
pub(crate) fn open(path: &Path, partial: bool) -> Result<Recording> {
    let recording = if partial { Recording::open_partial(path) } else { Recording::open(path) };
    let recording = recording.map_err(|error| match error {
        RecordError::Damaged { .. } => anyhow!("{error}; {REFUSED}"),
        RecordError::File { .. } | RecordError::Foreign { .. } | RecordError::Unreadable { .. } => error.into(),
        error => anyhow::Error::new(error).context(path.display().to_string()),
    })?;
    if let Some(damage) = recording.damage() {
        answer(&format!("partial: {}: {damage}", path.display()));
    }
    Ok(recording)
}

/// Looks at the recordings beside a results file and returns what is wrong with them, one line each. One that is not there
/// at all was moved or stayed with its fleet, which is nothing wrong, but said.
///
/// # Errors
/// If any is not whole, without `partial`.
pub(crate) fn inspect(results: &Results, folder: &Path, partial: bool) -> Result<Vec<String>> {
    let named = results.episodes.iter().filter(|episode| !episode.recording.is_empty());
    let files: Vec<PathBuf> = named.map(|episode| folder.join(&episode.recording)).collect();
    let damages: Vec<Option<String>> = files.par_iter().map(|file| damage(file)).collect();
    let told = files.iter().zip(&damages);
    let gone: Vec<_> = told.filter(|(file, damage)| damage.is_none() && !file.exists()).collect();
    if let Some((first, _)) = gone.first() {
        let (count, all, first) = (gone.len(), files.len(), first.display());
        tracing::warn!(
            "{count} of {all} recordings are not there ({first} first): the results file alone tells of their drives"
        );
    }
    let lines: Vec<String> = damages.into_iter().flatten().collect();
    match lines.first() {
        Some(first) if !partial => {
            Err(anyhow!("{} recordings are not whole, the first is {first}; {REFUSED}", lines.len()))
        }
        _ => Ok(lines),
    }
}
