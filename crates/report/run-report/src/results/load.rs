//! Reading and writing `results.json`: bounded in size, every refusal with file, JSON path and value.
//!
//! What passes here is trusted by all other files of the crate: scores are finite and in 0..=1, names are short,
//! every drive occurs once. Writing makes the same checks, so that a file that was written can be read.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use super::{Episode, Results, TimeShare};

/// Largest file that is read.
pub const MAX_FILE_BYTES: u64 = 256 * 1024 * 1024;
/// Most episodes in a file.
pub const MAX_EPISODES: usize = 200_000;
/// Most distinct terms (sub-metrics, causes of loss, violations) in a file.
pub const MAX_TERMS: usize = 64;
/// Longest name of a scenario, policy, set and the like.
const MAX_NAME_BYTES: usize = 256;
/// Longest reason or path.
const MAX_TEXT_BYTES: usize = 16 * 1024;
/// Longest piece of a value that an error repeats.
const MAX_SHOWN_CHARS: usize = 160;
/// Points lost are differences of means: rounding may take them this far out of 0..=1.
const ROUNDING: f64 = 1e-9;

const STATUSES: [&str; 6] = ["completed", "failed", "aborted", "queued", "running", "unknown"];

/// Why a results file was refused.
#[derive(Debug, thiserror::Error)]
pub enum ResultsError {
    /// The file cannot be read.
    #[error("results file cannot be read: {path:?}")]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file cannot be written.
    #[error("results file cannot be written: {path:?}")]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file is larger than [`MAX_FILE_BYTES`].
    #[error("results file is larger than {MAX_FILE_BYTES} bytes: {path:?}")]
    TooLarge {
        /// The file.
        path: PathBuf,
    },
    /// The file is no JSON, or a field is missing or of another type.
    #[error("results file refused: field {field:?}: {detail}: {path:?}")]
    Syntax {
        /// JSON path of the field; `.` is the whole file.
        field: String,
        /// What was found there.
        detail: String,
        /// The file.
        path: PathBuf,
    },
    /// A field has a value that it may not have.
    #[error("results file refused: field {field:?} is {value}, {rule}: {path:?}")]
    Value {
        /// JSON path of the field.
        field: String,
        /// Its value, shortened.
        value: String,
        /// What it has to be.
        rule: &'static str,
        /// The file.
        path: PathBuf,
    },
    /// Two episodes are the same drive.
    #[error("results file refused: episodes[{second}] repeats episodes[{first}], {drive}: {path:?}")]
    Duplicate {
        /// The earlier one.
        first: usize,
        /// The later one.
        second: usize,
        /// What they have in common.
        drive: String,
        /// The file.
        path: PathBuf,
    },
}

impl Results {
    /// Reads the file of an earlier run; episodes without an appearance take the run's.
    ///
    /// # Errors
    /// If it cannot be read, is too large, is not a results file, or holds values that no run can have produced.
    pub fn load(path: &Path) -> Result<Self, ResultsError> {
        let read = |source| ResultsError::Read { path: path.to_path_buf(), source };
        let too_large = || ResultsError::TooLarge { path: path.to_path_buf() };
        let file = File::open(path).map_err(read)?;
        if file.metadata().map_err(read)?.len() > MAX_FILE_BYTES {
            return Err(too_large());
        }
        let mut bytes = Vec::new();
        file.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(read)?;
        if bytes.len() as u64 > MAX_FILE_BYTES {
            return Err(too_large());
        }
        Self::parse(&bytes, path)
    }

    /// Reads the text of a results file; `path` is only named in errors.
    ///
    /// # Errors
    /// As [`Results::load`].
    pub fn parse(bytes: &[u8], path: &Path) -> Result<Self, ResultsError> {
        let mut reader = serde_json::Deserializer::from_slice(bytes);
        let syntax = |field: String, detail: &dyn std::fmt::Display| ResultsError::Syntax {
            field,
            detail: shortened(&detail.to_string()),
            path: path.to_path_buf(),
        };
        let mut results: Self =
            serde_path_to_error::deserialize(&mut reader).map_err(|e| syntax(e.path().to_string(), e.inner()))?;
        reader.end().map_err(|e| syntax(".".to_owned(), &e))?;
        for episode in &mut results.episodes {
            if episode.appearance.is_empty() {
                episode.appearance.clone_from(&results.run.appearance);
            }
        }
        results.check().map_err(|fault| fault.at(path))?;
        Ok(results)
    }

    /// Writes the file atomically.
    ///
    /// # Errors
    /// If it cannot be written, or would be refused on reading.
    pub fn save(&self, path: &Path) -> Result<(), ResultsError> {
        self.check().map_err(|fault| fault.at(path))?;
        let write = |source| ResultsError::Write { path: path.to_path_buf(), source };
        let mut text = serde_json::to_vec_pretty(self).map_err(|e| write(e.into()))?;
        text.push(b'\n');
        let part = path.with_extension("json.partial");
        File::create(&part).and_then(|mut file| file.write_all(&text)).map_err(write)?;
        std::fs::rename(&part, path).map_err(write)
    }

    fn check(&self) -> Result<(), Fault> {
        if self.episodes.len() > MAX_EPISODES {
            return fault("episodes", format_args!("{} entries", self.episodes.len()), "the limit is 200,000");
        }
        within("run.id", &self.run.id, MAX_NAME_BYTES)?;
        finite("run.wall_s", self.run.wall_s)?;
        finite("run.horizon_secs", self.run.horizon_secs)?;
        let mut terms = BTreeSet::new();
        let mut drives = BTreeMap::new();
        for (index, episode) in self.episodes.iter().enumerate() {
            episode.check(&|field| format!("episodes[{index}].{field}"))?;
            terms.extend(episode.terms());
            if terms.len() > MAX_TERMS {
                let field = format!("episodes[{index}].sub_scores");
                return fault(&field, format_args!("number {} of the file's terms", terms.len()), "the limit is 64");
            }
            if let Some(first) = drives.insert(episode.drive(), index) {
                return Err(Fault::Duplicate { first, second: index, drive: episode.named() });
            }
        }
        Ok(())
    }
}

impl Episode {
    fn terms(&self) -> impl Iterator<Item = &str> {
        self.sub_scores.keys().chain(self.lost.keys()).chain(self.first_violations.keys()).map(String::as_str)
    }

    fn drive(&self) -> ([&str; 6], u64) {
        let Self { scenario, set, policy, observation, appearance, scorer, seed, .. } = self;
        ([scenario, set, policy, observation, appearance, scorer], *seed)
    }

    fn named(&self) -> String {
        let Self { scenario, policy, observation, seed, appearance, .. } = self;
        shortened(&format!(
            "scenario {scenario:?}, policy {policy:?}, observation {observation:?}, seed {seed}, \
             appearance {appearance:?}"
        ))
    }

    fn check(&self, at: &dyn Fn(&str) -> String) -> Result<(), Fault> {
        self.check_texts(at)?;
        for (name, value) in [
            ("driving_score", self.driving_score),
            ("route_completion", self.route_completion),
            ("mean_score", self.mean_score),
        ] {
            value.map_or(Ok(()), |value| unit(&at(name), value, 0.0))?;
        }
        for (term, value) in &self.sub_scores {
            value.map_or(Ok(()), |value| unit(&at(&format!("sub_scores.{}", shortened(term))), value, 0.0))?;
        }
        for (term, value) in &self.lost {
            unit(&at(&format!("lost.{}", shortened(term))), *value, ROUNDING)?;
        }
        for (term, tick) in &self.first_violations {
            if *tick > self.ticks {
                let field = at(&format!("first_violations.{}", shortened(term)));
                return fault(&field, tick, "later than the last tick");
            }
        }
        if let Some(proposals) = &self.proposals {
            unit(&at("proposals.best_mean"), proposals.best_mean, 0.0)?;
            if proposals.ticks_without_positive > proposals.ticks {
                let field = at("proposals.ticks_without_positive");
                return fault(&field, proposals.ticks_without_positive, "more than proposals.ticks");
            }
        }
        if let Some(kept) = &self.wall_clock {
            for (name, secs) in [
                ("latency_median_s", kept.latency_median_s),
                ("latency_p99_s", kept.latency_p99_s),
                ("latency_max_s", kept.latency_max_s),
            ] {
                finite(&at(&format!("wall_clock.{name}")), secs)?;
            }
            if kept.late > kept.plans {
                return fault(&at("wall_clock.late"), kept.late, "more than wall_clock.plans");
            }
        }
        let TimeShare { sim, layout, video, policy, bus, other } = self.time_share;
        if let Some(share) = [sim, layout, video, policy, bus, other].into_iter().find(|share| !share.is_finite()) {
            return fault(&at("time_share"), share, "not a finite number");
        }
        finite(&at("frames_per_second"), self.frames_per_second)?;
        finite(&at("wall_s"), self.wall_s)
    }

    fn check_texts(&self, at: &dyn Fn(&str) -> String) -> Result<(), Fault> {
        for (name, text) in [("scenario", &self.scenario), ("policy", &self.policy)] {
            if text.is_empty() {
                return fault(&at(name), "\"\"", "a name is needed");
            }
        }
        for (name, text) in [
            ("scenario", &self.scenario),
            ("set", &self.set),
            ("category", &self.category),
            ("policy", &self.policy),
            ("observation", &self.observation),
            ("appearance", &self.appearance),
            ("scorer", &self.scorer),
            ("score_profile", &self.score_profile),
            ("score_version", &self.score_version),
        ] {
            within(&at(name), text, MAX_NAME_BYTES)?;
        }
        for term in self.terms() {
            within(&at(&format!("sub_scores.{}", shortened(term))), term, MAX_NAME_BYTES)?;
        }
        for (name, text) in [
            ("reason", &self.reason),
            ("driving_score_reason", &self.driving_score_reason),
            ("recording", &self.recording),
        ] {
            within(&at(name), text, MAX_TEXT_BYTES)?;
        }
        if !STATUSES.contains(&self.status.as_str()) {
            return fault(&at("status"), format_args!("{:?}", self.status), "not the name of a status");
        }
        Ok(())
    }
}

enum Fault {
    Value { field: String, value: String, rule: &'static str },
    Duplicate { first: usize, second: usize, drive: String },
}

impl Fault {
    fn at(self, path: &Path) -> ResultsError {
        let path = path.to_path_buf();
        match self {
            Self::Value { field, value, rule } => ResultsError::Value { field, value, rule, path },
            Self::Duplicate { first, second, drive } => ResultsError::Duplicate { first, second, drive, path },
        }
    }
}

fn fault(field: &str, value: impl std::fmt::Display, rule: &'static str) -> Result<(), Fault> {
    Err(Fault::Value { field: field.to_owned(), value: shortened(&value.to_string()), rule })
}

fn unit(field: &str, value: f64, rounding: f64) -> Result<(), Fault> {
    if (-rounding..=1.0 + rounding).contains(&value) { Ok(()) } else { fault(field, value, "not in 0..=1") }
}

fn finite(field: &str, value: f64) -> Result<(), Fault> {
    if value.is_finite() && value >= 0.0 { Ok(()) } else { fault(field, value, "not a finite number from 0") }
}

fn within(field: &str, text: &str, limit: usize) -> Result<(), Fault> {
    if text.len() <= limit {
        return Ok(());
    }
    fault(field, format_args!("{} bytes, {:?}", text.len(), shortened(text)), "too long")
}

fn shortened(text: &str) -> String {
    match text.char_indices().nth(MAX_SHOWN_CHARS) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}
