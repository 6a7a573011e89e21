//! A cell: one episode of a benchmark, told apart by all that its result depends on. Its key is a digest over that, so
//! the same cell has the same key in every shard, set and order; shard I of N takes every N-th cell in order of keys.
//!
//! The score profile is no part of a cell: both profiles are computed from the same drive.

use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;

use ds_space::{Digest, DigestWriter};
use ds_world::{AgentMode, TrackerKind};
use serde::{Deserialize, Serialize};

use crate::choice;

/// A name with the digest of what stands behind it: a policy with its weights, a renderer with its model.
#[derive(Debug, Clone, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Named {
    /// The name.
    pub name: String,
    /// Digest of its files; empty where it has none.
    pub digest: String,
}

/// Settings that all cells of a benchmark share.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Ticks executed of each plan (Δr).
    pub replan: u32,
    /// Length of a plan, in ticks (H).
    pub horizon: u32,
    /// Frames that the policy sees (K).
    pub history: u32,
    /// Tracker of the planned trajectory.
    #[serde(with = "choice::tracker")]
    pub tracker: TrackerKind,
    /// What computes the video model.
    pub video_backend: String,
}

impl Settings {
    /// Returns the settings in words, by which two benchmarks are compared.
    #[must_use]
    pub fn told(&self) -> String {
        let Self { replan, horizon, history, tracker, video_backend } = self;
        let tracker = tracker.name();
        format!(
            "Settings {{ replan: {replan}, horizon: {horizon}, history: {history}, tracker: {tracker:?}, video_backend: \
             {video_backend:?} }}"
        )
    }
}

/// One episode to drive.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cell {
    /// The scenario's name.
    pub scenario: String,
    /// The scenario's digest.
    pub scenario_digest: String,
    /// Who drives.
    pub policy: Named,
    /// What makes the frames.
    pub observation: Named,
    /// Look of the drive.
    pub appearance: String,
    /// Which agents react.
    #[serde(with = "choice::agents")]
    pub agents: AgentMode,
    /// Who ranks the proposals.
    pub scorer: String,
    /// The seed.
    pub seed: u64,
    /// The tick at which the policy takes over.
    pub hand_over: u32,
    /// The last tick.
    pub last: u32,
    /// What all cells share.
    pub settings: Settings,
}

impl Cell {
    /// Returns the digest over all that the result depends on.
    #[must_use]
    pub fn key(&self) -> Digest {
        let mut writer = DigestWriter::new();
        writer.text("dreamstream cell 1").text(&self.scenario).text(&self.scenario_digest);
        for named in [&self.policy, &self.observation] {
            writer.text(&named.name).text(&named.digest);
        }
        writer.text(&self.appearance).text(self.agents.name()).text(&self.scorer).u64(self.seed);
        writer.u32(self.hand_over).u32(self.last);
        let Settings { replan, horizon, history, tracker, video_backend } = &self.settings;
        writer.u32(*replan).u32(*horizon).u32(*history).text(tracker.name()).text(video_backend).finish()
    }

    /// Returns what a reader tells the cell by.
    #[must_use]
    pub fn told(&self) -> String {
        let Self { scenario, policy, observation, appearance, agents, scorer, seed, .. } = self;
        let (policy, observation, agents) = (&policy.name, &observation.name, agents.name());
        format!("{scenario} · {policy} · {observation} · {appearance} · {agents} · {scorer} · seed {seed}")
    }
}

/// Which part of all cells a process drives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shard {
    /// From 0.
    pub index: u32,
    /// How many there are.
    pub count: u32,
}

impl Shard {
    /// All cells.
    pub const ALL: Self = Self { index: 0, count: 1 };

    /// Reads the shard of a job array from its variables: `SLURM_ARRAY_TASK_ID` and `SLURM_ARRAY_TASK_COUNT` (from
    /// `SLURM_ARRAY_TASK_MIN` on, if that is set), else `JOB_COMPLETION_INDEX` and `DREAMSTREAM_SHARDS`.
    ///
    /// # Errors
    /// [`ShardError`] names the variable.
    pub fn of_array(variable: impl Fn(&str) -> Option<String>) -> Result<Self, ShardError> {
        let number = |name: &'static str| -> Result<u32, ShardError> {
            let text = variable(name).ok_or(ShardError::Unset(name))?;
            text.trim().parse().map_err(|_not_a_number| ShardError::Variable { name, text })
        };
        let (index, count) = if variable("SLURM_ARRAY_TASK_ID").is_some() {
            let first = variable("SLURM_ARRAY_TASK_MIN").map_or(Ok(0), |_| number("SLURM_ARRAY_TASK_MIN"))?;
            (number("SLURM_ARRAY_TASK_ID")?.wrapping_sub(first), number("SLURM_ARRAY_TASK_COUNT")?)
        } else if variable("JOB_COMPLETION_INDEX").is_some() {
            (number("JOB_COMPLETION_INDEX")?, number("DREAMSTREAM_SHARDS")?)
        } else {
            return Err(ShardError::NoArray);
        };
        Self { index, count }.checked().ok_or_else(|| ShardError::Bad(format!("{index}/{count}")))
    }

    /// Returns the shard's part of some cells in order of their keys.
    pub fn part<T>(self, cells: impl IntoIterator<Item = T>) -> impl Iterator<Item = T> {
        cells.into_iter().skip(self.index as usize).step_by(self.count as usize)
    }

    fn checked(self) -> Option<Self> {
        (self.index < self.count).then_some(self)
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index, self.count)
    }
}

impl FromStr for Shard {
    type Err = ShardError;

    fn from_str(text: &str) -> Result<Self, ShardError> {
        let parsed = text.split_once('/').and_then(|(index, count)| Some((index.parse().ok()?, count.parse().ok()?)));
        let shard = parsed.and_then(|(index, count)| Self { index, count }.checked());
        shard.ok_or_else(|| ShardError::Bad(text.to_owned()))
    }
}

/// Why a shard is none.
#[derive(Debug, thiserror::Error)]
pub enum ShardError {
    /// The text is none.
    #[error("shard {0:?} is not I/N with I < N")]
    Bad(String),
    /// A variable is not set.
    #[error("{0} is not set")]
    Unset(&'static str),
    /// A variable is no number.
    #[error("{name} is {text:?}, not a number")]
    Variable {
        /// The variable.
        name: &'static str,
        /// Its value.
        text: String,
    },
    /// This is no job of an array.
    #[error("neither SLURM_ARRAY_TASK_ID nor JOB_COMPLETION_INDEX is set: this is no job of an array; give I/N")]
    NoArray,
}

/// Cells in order of their keys, each with a place among the sets that it was first met in.
pub type Cells<T> = BTreeMap<Digest, (Cell, T)>;

#[cfg(test)]
mod tests {
    use super::*;

    fn cell() -> Cell {
        Cell { scenario: "a".to_owned(), seed: 3, hand_over: 20, last: 100, ..Cell::default() }
    }

    #[test]
    fn everything_that_a_result_depends_on_changes_the_key() {
        let changes: [fn(&mut Cell); 13] = [
            |cell| cell.scenario.push('x'),
            |cell| cell.scenario_digest.push('x'),
            |cell| cell.policy.name.push('x'),
            |cell| cell.policy.digest.push('x'),
            |cell| cell.observation.digest.push('x'),
            |cell| cell.appearance.push('x'),
            |cell| cell.agents = AgentMode::LogReplay,
            |cell| cell.scorer.push('x'),
            |cell| cell.seed += 1,
            |cell| cell.hand_over += 1,
            |cell| cell.last += 1,
            |cell| cell.settings.replan += 1,
            |cell| cell.settings.tracker = TrackerKind::PurePursuit,
        ];
        let mut keys: Vec<Digest> = changes
            .iter()
            .map(|change| {
                let mut cell = cell();
                change(&mut cell);
                cell.key()
            })
            .collect();
        keys.push(cell().key());
        keys.sort();
        keys.dedup();
        assert_eq!(keys.len(), changes.len() + 1);
    }

    /// Printed by the program in which agents and tracker were texts.
    #[test]
    fn names_of_choices_keep_keys_and_files_as_they_were() {
        const KEY: &str = "ab4ec613b39233c0672d9643c0ac1fac12ad713ebd40789a7d0e0c4ed52c1826";
        const TOLD: &str = r#"{"scenario":"cut-in-7","scenario_digest":"00ff","policy":{"name":"camera","digest":"abc"},"observation":{"name":"layout","digest":""},"appearance":"day","agents":"idm-all","scorer":"learned","seed":3,"hand_over":20,"last":100,"settings":{"replan":5,"horizon":80,"history":1,"tracker":"pure-pursuit","video_backend":"cpu"}}"#;
        let cell: Cell = serde_json::from_str(TOLD).expect("a cell");
        assert_eq!((cell.agents, cell.settings.tracker), (AgentMode::IdmAll, TrackerKind::PurePursuit));
        assert_eq!(cell.key().to_string(), KEY);
        assert_eq!(serde_json::to_string(&cell).expect("JSON"), TOLD);
        for (known, unknown) in [("idm-all", "idm-some"), ("pure-pursuit", "pursuit")] {
            let error = serde_json::from_str::<Cell>(&TOLD.replace(known, unknown)).expect_err(unknown).to_string();
            assert!(error.contains(&format!("{unknown:?}")), "{error}");
        }
    }

    #[test]
    fn shards_part_the_cells() {
        let mut all: Vec<u32> = (0..3).flat_map(|index| Shard { index, count: 3 }.part(0..11u32)).collect();
        all.sort_unstable();
        assert_eq!(all, (0..11).collect::<Vec<_>>());
        for bad in ["3/3", "x", "1", "-1/2", "0/0"] {
            assert!(bad.parse::<Shard>().is_err(), "{bad:?} was accepted");
        }
        assert_eq!("2/5".parse::<Shard>().ok(), Some(Shard { index: 2, count: 5 }));
    }

    #[test]
    fn job_arrays_tell_the_shard() {
        let check = |variables: &[(&str, &str)], expected: Result<Shard, &str>| {
            let variable = |name: &str| variables.iter().find(|(n, _)| *n == name).map(|(_, v)| (*v).to_owned());
            match (Shard::of_array(variable), expected) {
                (Ok(found), Ok(expected)) => assert_eq!(found, expected),
                (Err(error), Err(says)) => assert!(error.to_string().contains(says), "{error} does not say {says:?}"),
                (found, expected) => panic!("{found:?}, not {expected:?}"),
            }
        };
        let slurm = [("SLURM_ARRAY_TASK_ID", "3"), ("SLURM_ARRAY_TASK_COUNT", "16")];
        check(&slurm, Ok(Shard { index: 3, count: 16 }));
        check(&[&slurm[..], &[("SLURM_ARRAY_TASK_MIN", "1")]].concat(), Ok(Shard { index: 2, count: 16 }));
        let job = [("JOB_COMPLETION_INDEX", "0"), ("DREAMSTREAM_SHARDS", "4")];
        check(&job, Ok(Shard { index: 0, count: 4 }));
        check(&[], Err("SLURM_ARRAY_TASK_ID"));
        check(&job[..1], Err("DREAMSTREAM_SHARDS is not set"));
        check(&[("JOB_COMPLETION_INDEX", "x"), job[1]], Err("JOB_COMPLETION_INDEX is \"x\""));
        check(&[("SLURM_ARRAY_TASK_ID", "16"), slurm[1]], Err("16/16"));
    }
}
