//! Ended cells as lines of `cells.jsonl`: appended and synced one by one, read with a torn last line tolerated.
//!
//! Each line carries a digest over what must be equal wherever the cell is driven: status, digests of world, layout and
//! frames, scores, outcome. Wall times and paths are not in it. A damaged line that is not the last is refused by its
//! number.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use ds_run_report::Episode;
use ds_run_report::results::Outcome as Ending;
use ds_space::{Digest, DigestWriter};
use serde::{Deserialize, Serialize};

use crate::cell::Cell;
use crate::file::FileError;
use crate::judge::Judged;

/// The file's name in its folder.
pub const FILE: &str = "cells.jsonl";
/// The longest line that is read, in bytes.
const MAX_LINE_BYTES: u64 = 1 << 20;

/// Whether the look network names the condition of a drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ConditionShown {
    /// On a frame that the policy was shown.
    pub frame: bool,
    /// On the reference camera's frame of the same state.
    pub reference: bool,
}

/// A cell that ended.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Record {
    /// The cell's key.
    pub key: String,
    /// Digest over what must be equal wherever the cell is driven.
    pub digest: String,
    /// What was driven.
    pub cell: Cell,
    /// How often the cell was aborted before.
    pub round: u32,
    /// What the orchestrator says of the drive.
    pub episode: Episode,
    /// Scores and outcome; nothing of an aborted drive.
    pub judged: Option<Judged>,
    /// Whether its condition was on a generated frame; nothing where frames are not generated, or it has none. It follows
    /// from the frames and is no part of the digest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shown: Option<ConditionShown>,
    /// What its fleet lost under way; nothing where it went smoothly. It is no part of the digest.
    #[serde(default, skip_serializing_if = "Losses::is_none")]
    pub lost: Losses,
}

/// What the fleet of a drive lost under way.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Losses {
    /// Workers that were lost, by role, in the attempt that counts.
    #[serde(default)]
    pub workers: BTreeMap<String, u32>,
    /// Orders that were sent again, as no answer came.
    #[serde(default)]
    pub orders_repeated: u64,
    /// Time in which it stood, in milliseconds.
    #[serde(default)]
    pub stalled_millis: u64,
}

impl Losses {
    fn is_none(&self) -> bool {
        *self == Self::default()
    }
}

impl Record {
    /// Makes the record of an ended cell.
    #[must_use]
    pub fn new(cell: Cell, round: u32, episode: Episode, judged: Option<Judged>) -> Self {
        let (key, digest) = (cell.key().to_string(), String::new());
        let mut record = Self { key, digest, cell, round, episode, judged, shown: None, lost: Losses::default() };
        record.digest = record.content().to_string();
        record
    }

    /// Says whether the drive ended by itself: completed, or failed by the policy's fault.
    #[must_use]
    pub fn ended(&self) -> bool {
        self.episode.outcome() != Ending::Aborted
    }

    fn content(&self) -> Digest {
        let episode = &self.episode;
        let mut writer = DigestWriter::new();
        writer.text(&self.key).text(&episode.status).u32(episode.ticks);
        writer.text(&episode.world_digest).text(&episode.layout_digest).text(&episode.frame_digest);
        let value = |writer: &mut DigestWriter, value: Option<f64>| {
            writer.bool(value.is_some()).f64(value.unwrap_or_default());
        };
        let Some(Judged { scores, outcome }) = &self.judged else { return writer.finish() };
        for (profile, scores) in scores {
            writer.text(profile).text(&scores.version);
            for score in [scores.driving_score, scores.mean_score, scores.route_completion] {
                value(&mut writer, score);
            }
            for (term, score) in &scores.terms {
                value(writer.text(term), *score);
            }
        }
        for said in [outcome.arrived, outcome.collision_at_fault, outcome.contact, outcome.off_road, outcome.red_light]
        {
            writer.bool(said);
        }
        writer.u32(outcome.first_fault.unwrap_or(u32::MAX)).f64(outcome.driven_m).finish()
    }

    fn check(&self) -> Result<(), String> {
        let key = self.cell.key().to_string();
        if self.key != key {
            return Err(format!("its key is {}, that of its cell is {key}", self.key));
        }
        let digest = self.content().to_string();
        if self.digest != digest {
            return Err(format!("its digest is {}, that of its content is {digest}", self.digest));
        }
        Ok(())
    }
}

/// Where reading a file of cells found a torn last line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Torn {
    /// The file.
    pub path: PathBuf,
    /// The first byte of the torn line.
    pub from: u64,
}

/// Reads the cells of a folder line by line; `each` is given every record with the byte that it begins at.
///
/// # Errors
/// [`FileError`] if the file cannot be read or a line that is not the last is damaged.
pub fn read(folder: &Path, mut each: impl FnMut(u64, Record)) -> Result<Option<Torn>, FileError> {
    let path = folder.join(FILE);
    let unreadable = |source| FileError::Read { path: path.clone(), source };
    let mut reader = BufReader::new(File::open(&path).map_err(unreadable)?);
    let (mut line, mut from, mut number) = (Vec::new(), 0_u64, 0_u64);
    loop {
        line.clear();
        let length = reader.by_ref().take(MAX_LINE_BYTES).read_until(b'\n', &mut line).map_err(unreadable)? as u64;
        if length == 0 {
            return Ok(None);
        }
        number += 1;
        if line.last() != Some(&b'\n') && length < MAX_LINE_BYTES {
            return Ok(Some(Torn { path, from }));
        }
        let refused = |problem: String| FileError::Shape { at: format!("line {number}"), problem, path: path.clone() };
        let record: Record = serde_json::from_slice(&line).map_err(|error| refused(error.to_string()))?;
        record.check().map_err(refused)?;
        each(from, record);
        from += length;
    }
}

/// Reads the record that begins at a byte of a folder's cells.
///
/// # Errors
/// [`FileError`] if there is none.
pub fn read_at(folder: &Path, from: u64) -> Result<Record, FileError> {
    let path = folder.join(FILE);
    let unreadable = |source| FileError::Read { path: path.clone(), source };
    let mut file = File::open(&path).map_err(unreadable)?;
    file.seek(SeekFrom::Start(from)).map_err(unreadable)?;
    let mut line = Vec::new();
    BufReader::new(file).take(MAX_LINE_BYTES).read_until(b'\n', &mut line).map_err(unreadable)?;
    let refused = |problem| FileError::Shape { at: format!("byte {from}"), problem, path: path.clone() };
    serde_json::from_slice(&line).map_err(|error| refused(error.to_string()))
}

/// A file of cells that is written to; whoever opens it holds its folder.
#[derive(Debug)]
pub struct Writer {
    file: File,
    path: PathBuf,
}

impl Writer {
    /// Opens the cells of a folder to append to, with a torn last line cut off; says whether there was one.
    ///
    /// # Errors
    /// [`FileError`] if the file cannot be opened or read, or is damaged before its last line.
    pub fn open(folder: &Path, each: impl FnMut(Record)) -> Result<(Self, Option<Torn>), FileError> {
        let path = folder.join(FILE);
        let failed = |source| FileError::Write { path: path.clone(), source };
        let mut options = File::options();
        let file = options.create(true).append(true).read(true).open(&path).map_err(failed)?;
        let mut each = each;
        let torn = read(folder, |_, record| each(record))?;
        if let Some(torn) = &torn {
            file.set_len(torn.from).and_then(|()| file.sync_all()).map_err(failed)?;
        }
        Ok((Self { file, path }, torn))
    }

    /// Appends a record and waits until it is on disk.
    ///
    /// # Errors
    /// [`FileError::Write`].
    pub fn append(&mut self, record: &Record) -> Result<(), FileError> {
        let failed = |source| FileError::Write { path: self.path.clone(), source };
        let mut line = serde_json::to_vec(record).map_err(|error| failed(error.into()))?;
        line.push(b'\n');
        self.file.write_all(&line).and_then(|()| self.file.sync_data()).map_err(failed)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::judge::{Outcome, Scores};

    /// Returns the record of a drive with a driving score.
    pub(crate) fn driven(cell: Cell, status: &str, score: f64) -> Record {
        let episode = Episode {
            scenario: cell.scenario.clone(),
            policy: cell.policy.name.clone(),
            status: status.to_owned(),
            world_digest: Digest::of(&score.to_le_bytes()).to_string(),
            attempts: 1,
            ticks: 100,
            ..Episode::default()
        };
        let scores = Scores {
            driving_score: Some(score),
            mean_score: Some(score),
            route_completion: Some(1.0),
            terms: [("no_at_fault_collision".to_owned(), Some(1.0)), ("extended_comfort".to_owned(), Some(score))]
                .into(),
            ..Scores::default()
        };
        let scores = crate::judge::PROFILES.map(|profile| (profile.to_owned(), scores.clone())).into();
        let outcome = Outcome { arrived: score > 0.5, driven_m: 100.0, ..Outcome::default() };
        Record::new(cell, 0, episode, (status != "aborted").then_some(Judged { scores, outcome }))
    }

    fn cell(name: &str) -> Cell {
        Cell { scenario: name.to_owned(), ..Cell::default() }
    }

    fn all(folder: &Path) -> (Vec<Record>, Option<Torn>) {
        let mut records = Vec::new();
        let torn = read(folder, |_, record| records.push(record)).expect("readable");
        (records, torn)
    }

    #[test]
    fn a_torn_last_line_is_cut_off_and_a_damaged_one_is_refused() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let [one, two] = [("a", 0.1), ("b", 0.9)].map(|(name, score)| driven(cell(name), "completed", score));
        let (mut writer, torn) = Writer::open(folder.path(), |_| ()).expect("a fresh file");
        assert_eq!(torn, None);
        writer.append(&one).expect("written");
        writer.append(&two).expect("written");
        assert_eq!(all(folder.path()), (vec![one.clone(), two.clone()], None));
        let path = folder.path().join(FILE);
        let whole = std::fs::read(&path).expect("readable");
        let first = whole.iter().position(|byte| *byte == b'\n').expect("a line") + 1;
        for length in first + 1..whole.len() {
            std::fs::write(&path, &whole[..length]).expect("written");
            let (records, torn) = all(folder.path());
            assert_eq!((records, torn.map(|torn| torn.from)), (vec![one.clone()], Some(first as u64)), "{length}");
        }
        let (mut writer, torn) = Writer::open(folder.path(), |_| ()).expect("a torn file");
        assert!(torn.is_some());
        writer.append(&two).expect("written");
        assert_eq!(std::fs::read(&path).expect("readable"), whole);
        let text = String::from_utf8(whole).expect("text").replacen("0.1", "0.2", 1);
        std::fs::write(&path, text).expect("written");
        let error = read(folder.path(), |_, _| ()).expect_err("changed").to_string();
        assert!(error.contains("line 1") && error.contains("digest"), "{error}");
    }

    #[test]
    fn wall_times_and_places_are_no_content() {
        let one = driven(cell("a"), "completed", 0.5);
        let mut episode = one.episode.clone();
        (episode.wall_s, episode.recording, episode.attempts) = (9.0, "elsewhere".to_owned(), 2);
        assert_eq!(Record::new(cell("a"), 1, episode, one.judged.clone()).digest, one.digest);
        let lost = Losses { workers: [("video".to_owned(), 1)].into(), orders_repeated: 3, stalled_millis: 8_000 };
        let text = serde_json::to_string(&Record { lost, ..one.clone() }).expect("JSON");
        let read: Record = serde_json::from_str(&text).expect("a record");
        assert!(read.check().is_ok() && read.lost.workers["video"] == 1 && read.lost.orders_repeated == 3, "{text}");
        assert!(!serde_json::to_string(&one).expect("JSON").contains("lost\":{\"workers"));
        assert_ne!(driven(cell("a"), "failed", 0.5).digest, one.digest);
        assert_ne!(driven(cell("a"), "completed", 0.4).digest, one.digest);
    }
}
