//! How far a benchmark is over all its shards, and how long the rest takes at the rate of what was driven.
//!
//! The rate is the wall time of a tick, of each way of driving (policy, source, scorer) by its own drives and else by all. It is that
//! of one episode beside the others of its machine: who drives several at a time is done that much sooner.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use crate::cell::{Cell, Cells};
use crate::file::FileError;
use crate::record;
use crate::sheet::At;

/// What is left.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Cells of the benchmark.
    pub cells: usize,
    /// Cells that have not ended in any of the folders.
    pub left: usize,
    /// Frames of these.
    pub frames: u64,
    /// Wall time that those of the shard with most to do take one after the other, in seconds; nothing where nothing was driven by
    /// which to tell.
    pub longest_secs: Option<f64>,
}

/// Ticks that were driven, and the wall time that they took, in seconds.
#[derive(Debug, Clone, Copy, Default)]
struct Pace {
    ticks: f64,
    secs: f64,
}

impl Pace {
    fn add(&mut self, ticks: u32, secs: f64) {
        self.ticks += f64::from(ticks);
        self.secs += secs;
    }

    fn secs_per_tick(self) -> Option<f64> {
        (self.ticks > 0.0 && self.secs > 0.0).then(|| self.secs / self.ticks)
    }
}

/// Who drives on what, ranked by whom: what decides how long a tick takes.
fn way(cell: &Cell) -> [String; 3] {
    [cell.policy.name.clone(), cell.observation.name.clone(), cell.scorer.clone()]
}

impl Progress {
    /// Looks at folders of results that may still be written to, of so many shards; one without cells has not begun.
    ///
    /// # Errors
    /// [`FileError`] if a file is damaged, or holds records of which none is of the benchmark.
    pub fn of(cells: &Cells<At>, folders: &[PathBuf], shards: u32) -> Result<Self, FileError> {
        let mut paces: BTreeMap<[String; 3], Pace> = BTreeMap::new();
        let mut ended: BTreeSet<String> = BTreeSet::new();
        let known: BTreeSet<String> = cells.keys().map(ToString::to_string).collect();
        for folder in folders.iter().filter(|folder| folder.join(record::FILE).exists()) {
            let (mut own, mut foreign) = (0, None);
            record::read(folder, |_, record| {
                if !known.contains(&record.key) {
                    foreign.get_or_insert_with(|| record.cell.told());
                } else if record.ended() {
                    own += 1;
                    paces.entry(way(&record.cell)).or_default().add(record.episode.ticks, record.episode.wall_s);
                    ended.insert(record.key);
                } else {
                    own += 1;
                }
            })?;
            if let (0, Some(told)) = (own, foreign) {
                return Err(stranger(folder, told));
            }
        }
        let all = paces.values();
        let whole = all.fold(Pace::default(), |a, b| Pace { ticks: a.ticks + b.ticks, secs: a.secs + b.secs });
        let secs_per_tick = |cell: &Cell| {
            let own = paces.get(&way(cell)).and_then(|pace| pace.secs_per_tick());
            own.or_else(|| whole.secs_per_tick())
        };
        let (mut left, mut frames, mut secs) = (0, 0, vec![0.0; shards.max(1) as usize]);
        for (index, (key, (cell, _))) in cells.iter().enumerate() {
            if !ended.contains(&key.to_string()) {
                left += 1;
                frames += u64::from(cell.last);
                let place = index % secs.len();
                secs[place] += f64::from(cell.last) * secs_per_tick(cell).unwrap_or_default();
            }
        }
        let longest_secs = whole.secs_per_tick().map(|_| secs.into_iter().fold(0.0, f64::max));
        Ok(Self { cells: cells.len(), left, frames, longest_secs })
    }

    /// Returns the wall time that the rest takes where each shard drives some episodes at a time, in seconds.
    #[must_use]
    pub fn secs(&self, at_a_time: u32) -> Option<f64> {
        self.longest_secs.map(|secs| secs / f64::from(at_a_time.max(1)))
    }
}

fn stranger(folder: &Path, told: String) -> FileError {
    let rule = "no cell of this benchmark, nor is any other there: other sets, weights or settings";
    FileError::Value { field: "cell".to_owned(), value: told, rule, path: folder.join(record::FILE) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::Shard;
    use crate::manifest;
    use crate::record::tests::driven;
    use crate::record::{Record, Writer};
    use crate::sheet::{self, Sheet};

    /// Writes a shard of which the first `ended` cells have ended, `lattice` at 1 s and `camera` at 3 s a drive.
    fn shard(sheet: &Sheet, sets: &[manifest::Manifest], folder: &Path, shard: Shard, ended: usize) {
        std::fs::create_dir_all(folder).expect("made");
        let (mut writer, _) = Writer::open(folder, |_| ()).expect("fresh");
        for (index, (cell, _)) in shard.part(sheet.cells(sets).expect("sound").into_values()).enumerate() {
            let wall_s = if cell.policy.name == "camera" { 3.0 } else { 1.0 };
            let mut record = driven(cell, if index < ended { "completed" } else { "aborted" }, 0.5);
            record.episode.wall_s = wall_s;
            writer.append(&record).expect("written");
        }
    }

    #[test]
    fn all_shards_are_counted_and_each_policy_takes_its_own_time() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let sets = [manifest::tests::set(&["a", "b", "c", "d"])];
        let sheet = sheet::tests::sheet(&sets);
        let cells = sheet.cells(&sets).expect("sound");
        let folders = ["0", "1", "none"].map(|name| folder.path().join(name));
        let nothing = Progress::of(&cells, &folders, 2).expect("nothing began");
        assert_eq!(nothing, Progress { cells: 16, left: 16, frames: 1600, longest_secs: None });
        for (index, ended) in [(0, 8), (1, 6)] {
            shard(&sheet, &sets, &folders[index as usize], Shard { index, count: 2 }, ended);
        }
        let progress = Progress::of(&cells, &folders, 2).expect("sound");
        assert_eq!((progress.left, progress.frames), (2, 200));
        let secs = |(cell, _): &(Cell, At)| if cell.policy.name == "camera" { 3.0 } else { 1.0 };
        let left = Shard { index: 1, count: 2 }.part(cells.values()).skip(6);
        let expected: f64 = left.map(secs).sum();
        let near = |told: Option<f64>, secs: f64| told.is_some_and(|told| (told - secs).abs() < 1e-9);
        // The first shard is done and does not help the second.
        assert!(near(progress.secs(1), expected) && near(progress.secs(2), expected / 2.0), "{progress:?}, {expected}");
        let alone = Progress::of(&cells, &folders[..1], 1).expect("sound");
        let second: f64 = Shard { index: 1, count: 2 }.part(cells.values()).map(secs).sum();
        assert!(alone.left == 8 && near(alone.secs(1), second), "the other shard was not named: {alone:?}");
    }

    #[test]
    fn a_folder_of_another_benchmark_is_named() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let sets = [manifest::tests::set(&["a"])];
        let sheet = sheet::tests::sheet(&sets);
        let foreign = Cell { scenario: "elsewhere".to_owned(), ..Cell::default() };
        let (mut writer, _) = Writer::open(folder.path(), |_| ()).expect("fresh");
        let record: Record = driven(foreign, "completed", 0.5);
        writer.append(&record).expect("written");
        let cells = sheet.cells(&sets).expect("sound");
        let error = Progress::of(&cells, &[folder.path().to_owned()], 1).expect_err("foreign").to_string();
        assert!(error.contains("elsewhere") && error.contains("cells.jsonl"), "{error}");
    }
}
