//! `plan`: how many cells, frames and hours a benchmark has, and how much of it is left over all its shards.

use anyhow::{Context, Result};
use ds_benchmark::{Progress, Sheet};
use ds_process::terminal::answer;

use crate::cli::PlanArgs;
use crate::overall::duration;
use crate::{Ended, ask};

/// Runs `plan`.
///
/// # Errors
/// If a manifest or a folder is refused.
pub(crate) fn run(args: &PlanArgs) -> Result<Ended> {
    let (sheet, sets) = ask::sheet(&args.what)?;
    ask::check(&sheet)?;
    let cells = sheet.cells(&sets)?;
    let machines = args.machines.unwrap_or_else(|| u32::try_from(args.done.len()).unwrap_or(u32::MAX).max(1));
    let frames: u64 = cells.values().map(|(cell, _)| u64::from(cell.last)).sum();
    let (largest, rate) = (cells.len().div_ceil(machines as usize), args.rate);
    sets.iter().for_each(crate::describe);
    let hours = frames as f64 / rate / 3600.0;
    answer(&format!(
        "{} cells ({} arms, {} seeds), {frames} frames; {hours:.2} h at {rate} frames/s on one machine, {:.2} h on {machines}, \
         {largest} cells in the largest shard",
        cells.len(),
        sheet.arms().len(),
        sheet.seeds.len(),
        hours / f64::from(machines),
    ));
    if args.done.is_empty() {
        return Ok(Ended::Complete);
    }
    // Whoever drives several episodes at a time took the longer for each.
    let mut workers = 1;
    for folder in args.done.iter().filter(|folder| folder.join(ds_benchmark::sheet::FILE).exists()) {
        let (there, _) = Sheet::load(folder).with_context(|| format!("--done {}", folder.display()))?;
        workers = workers.max(there.place.workers);
    }
    let progress = Progress::of(&cells, &args.done, machines)?;
    let (left, frames) = (progress.left, progress.frames);
    let (secs, source) = match progress.secs(workers) {
        Some(secs) => (secs, format!("the measured rate, {workers} episodes at a time on each machine")),
        None => (
            frames as f64 / rate / f64::from(machines),
            format!("{rate} frames/s, for nothing has ended by which to tell"),
        ),
    };
    let (time, cells) = (duration(secs), progress.cells);
    answer(&format!("all shards: {left} of {cells} cells are left, {frames} frames; {time} on {machines} at {source}"));
    Ok(Ended::Complete)
}
