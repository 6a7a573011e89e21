//! Folders of results → one, cell by cell, in any order and with cells in several of them: equal digests or an error.
//!
//! Records are streamed; what stays in memory is a key, a digest and a place per cell. The merged file is in order of
//! keys, so it does not depend on the order of the folders.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use ds_space::Digest;
use serde::{Deserialize, Serialize};

use crate::cell::Shard;
use crate::faults::Faults;
use crate::file::{self, FileError};
use crate::manifest::Manifest;
use crate::record::{self, Torn};
use crate::session::Sessions;
use crate::sheet::{Ambiguous, Differs, Sheet};

/// The merged folder's own file.
pub const FILE: &str = "merged.json";

/// Why folders cannot be merged.
#[derive(Debug, thiserror::Error)]
pub enum MergeError {
    /// A file is refused.
    #[error(transparent)]
    File(#[from] FileError),
    /// Sets disagree.
    #[error(transparent)]
    Ambiguous(#[from] Ambiguous),
    /// Two folders are of other benchmarks.
    #[error("{part} differ: {} has {first}, {} has {second}; `--force` merges all the same and stamps the result mixed", folders[0].display(), folders[1].display())]
    Other {
        /// What differs.
        part: &'static str,
        /// What the first folder has.
        first: String,
        /// What the second folder has.
        second: String,
        /// Both folders.
        folders: [PathBuf; 2],
    },
    /// One cell came out differently.
    #[error("divergent_cell {key} ({told}): digest {} in {}, {} in {}", digests[0], folders[0].display(), digests[1], folders[1].display())]
    Divergent {
        /// The cell's key.
        key: String,
        /// The cell in words.
        told: String,
        /// Both digests.
        digests: Box<[String; 2]>,
        /// Both folders.
        folders: Box<[PathBuf; 2]>,
    },
    /// A cell that is none of the benchmark.
    #[error("cell {key} ({told}) is none of this benchmark: {}", folder.display())]
    Foreign {
        /// The cell's key.
        key: String,
        /// The cell in words.
        told: String,
        /// The folder.
        folder: PathBuf,
    },
}

/// What was merged.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Merged {
    /// Cells of the benchmark.
    pub cells: usize,
    /// Cells that ended.
    pub ended: usize,
    /// Cells that were aborted and not driven since.
    pub aborted: Vec<String>,
    /// Cells that nobody drove.
    pub missing: Vec<String>,
    /// Records of one cell in more than one folder, equal and therefore counted once.
    pub repeated: usize,
    /// Whether parts of other benchmarks were merged by force.
    pub mixed: bool,
    /// Records of cells of other benchmarks, which are in no table.
    #[serde(default)]
    pub foreign: usize,
    /// Files whose last line was torn.
    pub torn: Vec<PathBuf>,
    /// Folders that were merged.
    pub folders: Vec<PathBuf>,
    /// How often they were worked on.
    #[serde(default)]
    pub sessions: Sessions,
    /// What was lost on the way; nothing in older files.
    #[serde(default)]
    pub faults: Option<Faults>,
}

impl Merged {
    /// Says whether every cell has ended.
    #[must_use]
    pub fn complete(&self) -> bool {
        self.ended == self.cells
    }
}

/// Where the record of a cell is.
struct Found {
    digest: Digest,
    folder: usize,
    from: u64,
    ended: bool,
}

/// Merges folders into `out`, which must not hold results.
///
/// # Errors
/// [`MergeError`] if a file is damaged, benchmarks differ without `force`, or a cell came out differently.
pub fn merge(folders: &[PathBuf], out: &Path, force: bool) -> Result<Merged, MergeError> {
    let (sheet, sets) = one_benchmark(folders, force)?;
    let cells = sheet.cells(&sets)?;
    let mut found: BTreeMap<Digest, Found> = BTreeMap::new();
    let (mut repeated, mut torn, mut faults) = (0, Vec::new(), Faults::default());
    let (mut sessions, mut before) = (Sessions::default(), Faults::default());
    for (index, folder) in folders.iter().enumerate() {
        let merged = already(folder)?;
        let told = merged.as_ref().and_then(|merged| merged.faults.clone());
        let mut fault = None;
        let tail = record::read(folder, |from, record| {
            if fault.is_some() {
                return;
            }
            if told.is_none() {
                faults.take(&record);
            }
            let (key, told) = (record.key.clone(), record.cell.told());
            let keys = (Digest::from_hex(&record.key), Digest::from_hex(&record.digest));
            let (Some(cell), Some(digest)) = keys else { return };
            if !cells.contains_key(&cell) && !sheet.mixed {
                fault = Some(MergeError::Foreign { key, told, folder: folder.clone() });
                return;
            }
            let this = Found { digest, folder: index, from, ended: record.ended() };
            match found.get(&cell) {
                Some(there) if there.ended && this.ended && there.digest != digest => {
                    let digests = Box::new([there.digest.to_string(), digest.to_string()]);
                    let folders = Box::new([folders[there.folder].clone(), folder.clone()]);
                    fault = Some(MergeError::Divergent { key, told, digests, folders });
                }
                Some(there) if there.ended => repeated += usize::from(this.ended),
                _ => drop(found.insert(cell, this)),
            }
        })?;
        torn.extend(tail.map(|Torn { path, .. }| path));
        sessions = sessions.with(merged.map_or_else(|| Sessions::load(folder), |merged| Ok(merged.sessions))?);
        before = before.with(told.unwrap_or_default());
        if let Some(fault) = fault {
            return Err(fault);
        }
    }
    let told = |wanted: &dyn Fn(Option<&Found>) -> bool| -> Vec<String> {
        let these = cells.iter().filter(|(key, _)| wanted(found.get(key)));
        these.map(|(key, (cell, _))| format!("{key} {}", cell.told())).collect()
    };
    let merged = Merged {
        cells: cells.len(),
        ended: cells.keys().filter(|key| found.get(key).is_some_and(|found| found.ended)).count(),
        aborted: told(&|found| found.is_some_and(|found| !found.ended)),
        missing: told(&|found| found.is_none()),
        repeated,
        mixed: sheet.mixed,
        foreign: found.keys().filter(|key| !cells.contains_key(key)).count(),
        torn,
        folders: folders.to_vec(),
        sessions,
        faults: Some(faults.with(before)),
    };
    write(folders, out, &sheet, &sets, &found)?;
    file::write_json(&merged, &out.join(FILE))?;
    Ok(merged)
}

/// Returns what a folder was merged from, if it was: what went wrong on the way there stands in it.
fn already(folder: &Path) -> Result<Option<Merged>, FileError> {
    let path = folder.join(FILE);
    if path.exists() { file::read_json(&path).map(Some) } else { Ok(None) }
}

/// Returns the sheet of all folders: that of the first, over all shards.
fn one_benchmark(folders: &[PathBuf], force: bool) -> Result<(Sheet, Vec<Manifest>), MergeError> {
    let mut first: Option<(Sheet, Vec<Manifest>)> = None;
    for folder in folders {
        let (sheet, sets) = Sheet::load(folder)?;
        let Some((whole, _)) = &mut first else {
            first = Some((Sheet { shard: Shard::ALL, ..sheet }, sets));
            continue;
        };
        match whole.differs(&sheet) {
            Some(Differs { part, first, second }) if !force => {
                let folders = [folders[0].clone(), folder.clone()];
                return Err(MergeError::Other { part, first, second, folders });
            }
            other => whole.mixed |= sheet.mixed || other.is_some(),
        }
    }
    first.ok_or_else(|| {
        let source = std::io::Error::other("no folder was named");
        FileError::Read { path: PathBuf::new(), source }.into()
    })
}

fn write(
    folders: &[PathBuf],
    out: &Path,
    sheet: &Sheet,
    sets: &[Manifest],
    found: &BTreeMap<Digest, Found>,
) -> Result<(), FileError> {
    let path = out.join(record::FILE);
    if path.exists() {
        return Err(FileError::Exists { path });
    }
    std::fs::create_dir_all(out).map_err(|source| FileError::Write { path: out.to_owned(), source })?;
    let partial = path.with_extension("jsonl.partial");
    let failed = |source| FileError::Write { path: path.clone(), source };
    let mut file = BufWriter::new(File::create(&partial).map_err(failed)?);
    for place in found.values() {
        let record = record::read_at(&folders[place.folder], place.from)?;
        let mut line = serde_json::to_vec(&record).map_err(|error| failed(error.into()))?;
        line.push(b'\n');
        file.write_all(&line).map_err(failed)?;
    }
    let whole = file.into_inner().map_err(|error| failed(error.into_error()))?;
    whole.sync_all().and_then(|()| std::fs::rename(&partial, &path)).map_err(failed)?;
    sheet.save(sets, out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::Cell;
    use crate::record::Writer;
    use crate::record::tests::driven;
    use crate::{manifest, sheet};

    struct Bench {
        folder: tempfile::TempDir,
        sheet: Sheet,
        sets: Vec<Manifest>,
    }

    impl Bench {
        fn new() -> Self {
            let sets = vec![manifest::tests::set(&["a", "b", "c"])];
            let sheet = sheet::tests::sheet(&sets);
            Self { folder: tempfile::tempdir().expect("a temporary folder"), sheet, sets }
        }

        fn path(&self, name: &str) -> PathBuf {
            self.folder.path().join(name)
        }

        /// Writes a folder with the cells of a shard.
        fn shard(&self, name: &str, shard: Shard, drive: impl Fn(usize, Cell) -> record::Record) -> PathBuf {
            let path = self.path(name);
            Sheet { shard, ..self.sheet.clone() }.save(&self.sets, &path).expect("written");
            let (mut writer, _) = Writer::open(&path, |_| ()).expect("fresh");
            let cells = self.sheet.cells(&self.sets).expect("sound").into_values();
            for (index, (cell, _)) in shard.part(cells).enumerate() {
                writer.append(&drive(index, cell)).expect("written");
            }
            path
        }
    }

    fn good(_: usize, cell: Cell) -> record::Record {
        driven(cell, "completed", 0.5)
    }

    fn bytes(folder: &Path) -> Vec<u8> {
        std::fs::read(folder.join(record::FILE)).expect("cells")
    }

    #[test]
    fn order_and_repetition_change_nothing() {
        let bench = Bench::new();
        let shards = [0, 1, 2].map(|index| bench.shard(&index.to_string(), Shard { index, count: 3 }, good));
        let whole = bench.shard("whole", Shard::ALL, good);
        let orders = [vec![0, 1, 2], vec![2, 0, 1], vec![1, 1, 2, 0]];
        let mut seen = Vec::new();
        for (k, order) in orders.into_iter().enumerate() {
            let folders: Vec<PathBuf> = order.iter().map(|index| shards[*index].clone()).collect();
            let out = bench.path(&format!("merged{k}"));
            let merged = merge(&folders, &out, false).expect("they belong together");
            assert!(merged.complete() && merged.cells == 12 && !merged.mixed, "{merged:?}");
            seen.push(bytes(&out));
        }
        let out = bench.path("of-one");
        merge(&[whole], &out, false).expect("sound");
        seen.push(bytes(&out));
        assert!(seen.windows(2).all(|pair| pair[0] == pair[1]));
        let error = merge(&shards, &out, false).expect_err("results are there").to_string();
        assert!(error.contains("cells.jsonl"), "{error}");
    }

    #[test]
    fn missing_and_aborted_cells_are_listed_and_a_later_drive_counts() {
        let bench = Bench::new();
        let aborted = |index: usize, cell: Cell| driven(cell, if index < 2 { "aborted" } else { "completed" }, 0.5);
        let one = bench.shard("one", Shard { index: 0, count: 2 }, aborted);
        let merged = merge(std::slice::from_ref(&one), &bench.path("m1"), false).expect("sound");
        assert_eq!((merged.ended, merged.aborted.len(), merged.missing.len()), (4, 2, 6));
        assert!(!merged.complete());
        let again = bench.shard("again", Shard::ALL, good);
        for folders in [[one.clone(), again.clone()], [again, one]] {
            let out = bench.path(&format!("of-{}", folders[0].file_name().expect("a name").display()));
            let merged = merge(&folders, &out, false).expect("sound");
            assert!(merged.complete() && merged.repeated == 4, "{merged:?}");
        }
    }

    #[test]
    fn what_was_lost_on_the_way_is_not_lost_by_merging() {
        let bench = Bench::new();
        let cut = |index: usize, cell: Cell| {
            let mut record = driven(cell, if index == 0 { "aborted" } else { "completed" }, 0.5);
            (record.episode.wall_s, record.episode.reason) = (2.0, "no_instance: gone".to_owned());
            record.lost.workers.insert("video".to_owned(), 1);
            record
        };
        let shards = [0, 1].map(|index| bench.shard(&index.to_string(), Shard { index, count: 2 }, cut));
        let again = bench.shard("again", Shard::ALL, good);
        let first = merge(&shards, &bench.path("first"), false).expect("sound");
        let told = first.faults.clone().expect("told");
        assert_eq!((told.aborted["no_instance"], told.workers["video"], told.lost_millis), (2, 12, 4_000));
        let whole = merge(&[bench.path("first"), again], &bench.path("whole"), false).expect("sound");
        assert!(whole.complete() && whole.faults == Some(told.clone()), "{whole:?}");
        let results = crate::Results::load(&bench.path("whole")).expect("sound");
        assert_eq!((results.complete(), results.faults), (true, told));
    }

    #[test]
    fn what_does_not_belong_together_is_refused() {
        let mut bench = Bench::new();
        let one = bench.shard("one", Shard::ALL, good);
        let two = bench
            .shard("two", Shard::ALL, |index, cell| driven(cell, "completed", if index == 3 { 0.25 } else { 0.5 }));
        let error = merge(&[one.clone(), two.clone()], &bench.path("m"), false).expect_err("divergent").to_string();
        let names = |path: &Path| error.contains(&path.display().to_string());
        assert!(error.starts_with("divergent_cell ") && names(&one) && names(&two), "{error}");
        assert!(!bench.path("m").exists());
        bench.sheet.policies[0].digest = "other weights".to_owned();
        let three = bench.shard("three", Shard::ALL, good);
        let error = merge(&[one.clone(), three.clone()], &bench.path("m"), false).expect_err("weights").to_string();
        assert!(error.contains("policies differ") && error.contains("other weights"), "{error}");
        let merged = merge(&[one, three], &bench.path("m"), true).expect("forced");
        assert!(merged.mixed && Sheet::load(&bench.path("m")).expect("sound").0.mixed);
        assert_eq!(
            (merged.ended, merged.foreign),
            (12, 6),
            "the cells of the other weights are none of this benchmark"
        );
    }

    #[test]
    fn torn_files_are_named() {
        let bench = Bench::new();
        let one = bench.shard("one", Shard::ALL, good);
        let whole = bytes(&one);
        std::fs::write(one.join(record::FILE), &whole[..whole.len() - 9]).expect("written");
        let merged = merge(std::slice::from_ref(&one), &bench.path("m"), false).expect("sound");
        assert_eq!((merged.ended, merged.missing.len(), merged.torn), (11, 1, vec![one.join(record::FILE)]));
    }
}
