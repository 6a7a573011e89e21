//! Renders the clips of a recipe into its folder, shard by shard, and goes on where an earlier run stopped.
//!
//! Clips of one scenario are made together, scenarios of a shard on all processor cores; the order in the file is that
//! of the plan. A folder that holds another recipe's clips is refused.

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use crate::error::ClipsError;
use crate::index::{ClipInfo, INDEX_FILE, Index};
use crate::make::Studio;
use crate::plan::{ClipPlan, PlannedClip};
use crate::recipe::Recipe;
use crate::shard::{self, Packed};

/// What is told while clips are made, from any thread.
pub trait Progress: Sync {
    /// So many clips are there of so many, those of earlier runs included.
    fn made(&self, clips: u64, of: u64);
    /// Something is odd about a drive, such as a missing map; said once for each shard that it has clips in.
    fn noted(&self, _line: &str) {}
    /// Says whether to stop; the shard in work is then given up.
    fn stop(&self) -> bool {
        false
    }
}

/// What a run left.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rendered {
    /// Where.
    pub folder: PathBuf,
    /// Clips that are there.
    pub clips: u64,
    /// Clips that there are to be.
    pub of: u64,
    /// Clips that this run made.
    pub made: u64,
}

/// Makes the clips that are missing and, when all are there, the index.
///
/// # Errors
/// If the folder is of another recipe, or a clip cannot be made or written.
pub fn render(recipe: &Recipe, folder: &Path, progress: &dyn Progress) -> Result<Rendered, ClipsError> {
    let plan = ClipPlan::new(recipe)?;
    let (digest, size) = (recipe.digest()?.to_string(), recipe.size()?);
    std::fs::create_dir_all(folder).map_err(ClipsError::io("folder of clips", folder))?;
    let total = plan.clips();
    let per_shard = recipe.shard_clips as u64;
    let mut infos: Vec<ClipInfo> = Vec::new();
    let mut made = 0;
    for number in 0..usize::try_from(total.div_ceil(per_shard)).unwrap_or(usize::MAX) {
        let path = shard::path(folder, number);
        if !path.exists() {
            let first = number as u64 * per_shard;
            let planned: Vec<PlannedClip> =
                (first..(first + per_shard).min(total)).map(|index| plan.clip(index)).collect();
            let Some(packed) = shard_of(recipe, size, &planned, infos.len() as u64, total, progress)? else {
                return Ok(Rendered { folder: folder.to_path_buf(), clips: infos.len() as u64, of: total, made });
            };
            made += packed.len() as u64;
            shard::write(&path, &digest, packed)?;
        }
        let table = shard::table(&path)?;
        if table.recipe != digest {
            let short = |text: &str| text.chars().take(12).collect();
            let (expected, found) = (short(&digest), short(&table.recipe));
            return Err(ClipsError::Foreign { path: folder.to_path_buf(), expected, found });
        }
        infos.extend(table.clips.into_iter().map(|entry| entry.info));
        progress.made(infos.len() as u64, total);
    }
    let clips = infos.len() as u64;
    let index = Index {
        version: 1,
        name: recipe.name.clone(),
        recipe: digest,
        split: recipe.split,
        source: recipe.source,
        width_px: size.0,
        height_px: size.1,
        shard_clips: recipe.shard_clips,
        clips: infos,
    };
    write_index(folder, &index)?;
    Ok(Rendered { folder: folder.to_path_buf(), clips, of: total, made })
}

/// Makes the clips of a shard, or `None` when told to stop.
fn shard_of(
    recipe: &Recipe,
    size: (u32, u32),
    planned: &[PlannedClip],
    before: u64,
    total: u64,
    progress: &dyn Progress,
) -> Result<Option<Vec<Packed>>, ClipsError> {
    let done = std::sync::atomic::AtomicU64::new(before);
    let scenarios: Vec<&[PlannedClip]> = planned.chunk_by(|a, b| a.scenario == b.scenario).collect();
    let make = |clips: &[PlannedClip]| -> Result<Option<Vec<Packed>>, ClipsError> {
        if progress.stop() {
            return Ok(None);
        }
        let studio = Studio::new(recipe, size, &clips[0].scenario)?;
        studio.notes().for_each(|line| progress.noted(&line));
        let mut packed = Vec::with_capacity(clips.len());
        for planned in clips {
            if progress.stop() {
                return Ok(None);
            }
            let (clip, egos, info) = studio.make(planned)?;
            packed.push(Packed::new(&clip, &egos, info)?);
            progress.made(1 + done.fetch_add(1, std::sync::atomic::Ordering::Relaxed), total);
        }
        Ok(Some(packed))
    };
    // Collected in the order of the plan, whichever thread was first.
    let parts: Vec<Option<Vec<Packed>>> =
        scenarios.par_iter().map(|clips| make(clips)).collect::<Result<_, ClipsError>>()?;
    Ok(parts.into_iter().collect::<Option<Vec<_>>>().map(|parts| parts.into_iter().flatten().collect()))
}

fn write_index(folder: &Path, index: &Index) -> Result<(), ClipsError> {
    let path = folder.join(INDEX_FILE);
    let partial = folder.join("index.partial");
    let text = serde_json::to_vec_pretty(index).map_err(|error| ClipsError::broken(&path, error))?;
    std::fs::write(&partial, text).map_err(ClipsError::io("index of clips", &path))?;
    std::fs::rename(&partial, &path).map_err(ClipsError::io("index of clips", &path))
}
