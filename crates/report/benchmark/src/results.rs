//! A folder of results as values: what was asked for, and of every cell what tables need.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use ds_run_report::ProposalStats;
use ds_run_report::results::Outcome as Ending;
use ds_space::Digest;
use serde::de::DeserializeOwned;

use crate::estimate::Unit;
use crate::faults::Faults;
use crate::file::{self, FileError};
use crate::judge::{Judged, Outcome, Scores};
use crate::manifest::{Entry, Kind, Manifest};
use crate::merge::{self, Merged};
use crate::quality::Quality;
use crate::record::{self, ConditionShown, Record, Torn};
use crate::review::Review;
use crate::session::Sessions;
use crate::sheet::{Arm, Sheet};

/// What is known of a cell.
#[derive(Debug, Clone)]
pub struct Drive {
    /// How it ended.
    pub ending: Ending,
    /// Why, if not as planned.
    pub reason: String,
    /// Attempts that it took.
    pub attempts: u32,
    /// How often it was aborted before.
    pub round: u32,
    /// Scores and outcome.
    pub judged: Option<Judged>,
    /// What an oracle says of the policy's proposals.
    pub proposals: Option<ProposalStats>,
    /// Whether its condition was on a generated frame.
    pub shown: Option<ConditionShown>,
    /// Wall time, in seconds.
    pub wall_s: f64,
    /// Digest over what must be equal wherever it is driven.
    pub digest: String,
    /// Its recording, from the folder that it was driven in; empty where none was kept.
    pub recording: String,
}

/// A folder of results.
#[derive(Debug)]
pub struct Results {
    /// The folder.
    pub folder: PathBuf,
    /// What was asked for.
    pub sheet: Sheet,
    /// The sets.
    pub sets: Vec<Manifest>,
    /// What was merged, if this is a merged folder.
    pub merged: Option<Merged>,
    /// The last line of the cells, if it is torn.
    pub torn: Option<Torn>,
    /// How often the folders were worked on.
    pub sessions: Sessions,
    /// What people say of the variants; of each set that somebody reviewed.
    pub reviews: Vec<Review>,
    /// What the searches of adversaries came to; of each set that has figures beside its manifest.
    pub quality: Vec<Quality>,
    /// Animations of drives, from the folder of the report, by the keys of their cells.
    pub animations: BTreeMap<String, String>,
    /// What was lost on the way.
    pub faults: Faults,
    /// Cells of the benchmark.
    pub cells: usize,
    /// Records of cells that another record of the same folder repeats.
    pub repeated: usize,
    /// Records of cells of other benchmarks, which no table counts.
    pub foreign: usize,
    drives: BTreeMap<String, Drive>,
}

impl Results {
    /// Reads a folder.
    ///
    /// # Errors
    /// [`FileError`] if a file is damaged; a cell that is told twice counts by its drive that ended.
    pub fn load(folder: &Path) -> Result<Self, FileError> {
        let (sheet, sets) = Sheet::load(folder)?;
        let cells = sheet.cells(&sets).map_err(|error| FileError::Shape {
            at: "sets".to_owned(),
            problem: error.to_string(),
            path: folder.join(crate::sheet::FILE),
        })?;
        let mut drives: BTreeMap<String, Drive> = BTreeMap::new();
        let (mut repeated, mut foreign) = (0, 0);
        let mut faults = Faults::default();
        let torn = record::read(folder, |_, record: Record| {
            faults.take(&record);
            let Record { key, digest, round, episode, judged, shown, .. } = record;
            if !Digest::from_hex(&key).is_some_and(|key| cells.contains_key(&key)) {
                foreign += 1;
                return;
            }
            let ending = episode.outcome();
            let (reason, attempts, wall_s) = (episode.reason, episode.attempts, episode.wall_s);
            let (proposals, recording) = (episode.proposals, episode.recording);
            let drive = Drive { ending, reason, attempts, round, judged, proposals, shown, wall_s, digest, recording };
            match drives.get(&key) {
                Some(there) if there.ending != Ending::Aborted => repeated += 1,
                _ => drop(drives.insert(key, drive)),
            }
        })?;
        let merged: Option<Merged> = optional(&folder.join(merge::FILE))?;
        let sessions = merged.as_ref().map_or_else(|| Sessions::load(folder), |merged| Ok(merged.sessions))?;
        // A merged folder holds one record of each cell; what was lost before stands beside it.
        let faults = merged.as_ref().and_then(|merged| merged.faults.clone()).unwrap_or(faults);
        let (cells, animations, folder) = (cells.len(), BTreeMap::new(), folder.to_owned());
        let (reviews, quality) = (Vec::new(), Vec::new());
        Ok(Self {
            folder,
            sheet,
            sets,
            merged,
            torn,
            sessions,
            reviews,
            quality,
            animations,
            faults,
            cells,
            repeated,
            foreign,
            drives,
        })
    }

    /// Takes what people say of the sets: their accepted variants stand as sets of their own beside the whole.
    #[must_use]
    pub fn reviewed(mut self, reviews: Vec<Review>) -> Self {
        self.reviews = reviews.into_iter().filter(|review| !review.by.is_empty()).collect();
        let of = |review: &Review| review.accepted(self.sets.iter().find(|set| set.name == review.set)?);
        let accepted: Vec<Manifest> = self.reviews.iter().filter_map(of).collect();
        self.sets.extend(accepted);
        self
    }

    /// Says whether there are figures of the search of a set; one without adversaries needs none.
    #[must_use]
    pub fn has_quality(&self, set: &str) -> bool {
        let adverse = self.sets.iter().any(|there| there.name == set && there.kind == Kind::Behavior);
        !adverse || self.quality.iter().any(|quality| quality.set == set)
    }

    /// Returns all drives, in order of their keys.
    pub fn drives(&self) -> impl Iterator<Item = &Drive> {
        self.drives.values()
    }

    /// Counts the cells that ended.
    #[must_use]
    pub fn ended(&self) -> usize {
        self.drives().filter(|drive| drive.ending != Ending::Aborted).count()
    }

    /// Says whether every cell has ended.
    #[must_use]
    pub fn complete(&self) -> bool {
        self.ended() == self.cells
    }

    /// Returns the drives of an entry by an arm, one per seed that was driven.
    #[must_use]
    pub fn of(&self, arm: &Arm, entry: &Entry) -> Vec<&Drive> {
        self.on(&self.sheet.seeds, arm, entry)
    }

    /// Returns the drives of an entry by an arm that only select, one per seed that was driven.
    #[must_use]
    pub fn selecting(&self, arm: &Arm, entry: &Entry) -> Vec<&Drive> {
        self.on(&self.sheet.selection, arm, entry)
    }

    fn on(&self, seeds: &[u64], arm: &Arm, entry: &Entry) -> Vec<&Drive> {
        seeds.iter().filter_map(|seed| Some(self.drive(arm, entry, *seed)?.1)).collect()
    }

    /// Returns the drive of an entry by an arm on a seed, with the key of its cell.
    #[must_use]
    pub fn drive(&self, arm: &Arm, entry: &Entry, seed: u64) -> Option<(String, &Drive)> {
        let key = self.sheet.cell(arm, entry, seed).key().to_string();
        self.drives.get(&key).map(|drive| (key, drive))
    }

    /// Returns the entry that another one is a change of, if it is in a base set.
    #[must_use]
    pub fn base_of(&self, entry: &Entry) -> Option<&Entry> {
        let base = entry.base.as_ref()?;
        let sets = self.sets.iter().filter(|set| set.kind == Kind::Base);
        sets.flat_map(|set| &set.entries).find(|entry| entry.name == *base)
    }

    /// Returns one unit per entry that has a value: the mean over its seeds.
    #[must_use]
    pub fn units(&self, arm: &Arm, set: &Manifest, value: &dyn Fn(&Drive) -> Option<f64>) -> Vec<Unit> {
        let one = |entry: &Entry| Some(unit(entry, self.mean(arm, entry, value)?, 1.0));
        set.entries.iter().filter_map(one).collect()
    }

    /// Returns the mean of a value over the seeds of an entry.
    #[must_use]
    pub fn mean(&self, arm: &Arm, entry: &Entry, value: &dyn Fn(&Drive) -> Option<f64>) -> Option<f64> {
        ds_stats::mean(self.of(arm, entry).into_iter().filter_map(value))
    }
}

/// Returns a unit of an entry.
#[must_use]
pub fn unit(entry: &Entry, above: f64, below: f64) -> Unit {
    Unit { scenario: entry.scenario.clone(), log: entry.log.clone(), above, below }
}

impl Drive {
    /// Returns a score in a profile: 0 for a drive that the policy failed, nothing for an aborted one or where it does not
    /// apply.
    #[must_use]
    pub fn score(&self, profile: &str, score: fn(&Scores) -> Option<f64>) -> Option<f64> {
        match self.ending {
            Ending::Completed => score(self.judged.as_ref()?.scores.get(profile)?),
            Ending::Failed => Some(0.0),
            Ending::Aborted => None,
        }
    }

    /// Returns whether something happened, as 1 or 0; of a drive that failed before it could be judged nothing did.
    #[must_use]
    pub fn happened(&self, said: fn(&Outcome) -> bool) -> Option<f64> {
        let outcome = self.judged.as_ref().map(|judged| judged.outcome);
        match self.ending {
            Ending::Aborted => None,
            _ => Some(f64::from(u8::from(outcome.is_some_and(|outcome| said(&outcome))))),
        }
    }

    /// Returns 1 for a success, 0 otherwise; a failed drive is none.
    #[must_use]
    pub fn success(&self) -> Option<f64> {
        match self.ending {
            Ending::Completed => self.happened(Outcome::success),
            Ending::Failed => Some(0.0),
            Ending::Aborted => None,
        }
    }

    /// Returns how far the ego drove, in kilometres.
    #[must_use]
    pub fn driven_km(&self) -> f64 {
        self.judged.as_ref().map_or(0.0, |judged| judged.outcome.driven_m / 1000.0)
    }
}

fn optional<T: DeserializeOwned>(path: &Path) -> Result<Option<T>, FileError> {
    if path.exists() { file::read_json(path).map(Some) } else { Ok(None) }
}
