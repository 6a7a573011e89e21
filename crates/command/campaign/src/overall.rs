//! How far all shards of a benchmark are, told beside the progress of one.

use std::path::{Path, PathBuf};

use anyhow::Result;
use ds_benchmark::cell::Cells;
use ds_benchmark::sheet::At;
use ds_benchmark::{Progress, Sheet};

/// Shares of a shard after which the others are looked at anew.
const LOOKS: usize = 20;

/// What is asked for, where it is driven, and how many episodes go on at a time.
#[derive(Debug)]
pub(crate) struct Overall {
    cells: Cells<At>,
    folders: Vec<PathBuf>,
    shards: u32,
    at_a_time: u32,
    /// Cells of this shard between two looks.
    pub(crate) every: usize,
}

impl Overall {
    /// Returns what tells how far all shards are, as the folders of the others are named; each is taken to drive as many episodes at a
    /// time as this one.
    pub(crate) fn new(sheet: &Sheet, cells: &Cells<At>, out: &Path, done: &[PathBuf], left: usize) -> Self {
        let mut folders = done.to_vec();
        folders.push(out.to_owned());
        let (shards, at_a_time) = (sheet.shard.count, sheet.place.workers);
        Self { cells: cells.clone(), folders, shards, at_a_time, every: (left / LOOKS).max(1) }
    }

    /// Says how many cells are left and how long they take.
    ///
    /// # Errors
    /// If a folder is refused.
    pub(crate) fn told(&self) -> Result<String> {
        let progress = Progress::of(&self.cells, &self.folders, self.shards)?;
        let rest = progress.secs(self.at_a_time).filter(|_| progress.left > 0);
        let time = rest.map_or(String::new(), |secs| format!(", {} at the measured rate", duration(secs)));
        Ok(format!("all shards: {} of {} cells are left{time}", progress.left, progress.cells))
    }

    /// Says the same while drives go on, which a folder of others does not end; one that is refused is logged.
    pub(crate) fn seen(&self) -> Option<String> {
        self.told().inspect_err(|error| tracing::warn!("other shards: {error:#}")).ok()
    }
}

/// Returns a time in the unit that suits it.
pub(crate) fn duration(secs: f64) -> String {
    match secs {
        secs if secs < 90.0 => format!("{secs:.0} s"),
        secs if secs < 5400.0 => format!("{:.0} min", secs / 60.0),
        secs => format!("{:.1} h", secs / 3600.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_told_in_the_unit_that_suits_them() {
        for (secs, told) in [(0.4, "0 s"), (89.0, "89 s"), (90.0, "2 min"), (5399.0, "90 min"), (12_600.0, "3.5 h")] {
            assert_eq!(duration(secs), told);
        }
    }
}
