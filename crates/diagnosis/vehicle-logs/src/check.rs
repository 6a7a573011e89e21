//! Looks for what is wrong with a mapping or a log, by relations that hold in any vehicle, and says so in plain words.
//!
//! Every finding names the evidence and the change to the mapping that would remove it. A right log gives none.

mod motion;
mod stamps;
mod turning;

use std::path::Path;

use serde::Serialize;

use crate::error::LogError;
use crate::mapping::Mapping;
use crate::record::Record;
use ds_diagnosis::table::STEP_SECS;

/// Something that looks wrong.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct LogFinding {
    /// The file.
    pub file: String,
    /// The channel, or `time`.
    pub channel: String,
    /// What is wrong, in a few words.
    pub problem: String,
    /// What shows it.
    pub evidence: String,
    /// What to change in the mapping.
    pub proposal: String,
}

impl std::fmt::Display for LogFinding {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(out, "{}: {}: {} ({}); {}", self.file, self.channel, self.problem, self.evidence, self.proposal)
    }
}

impl Mapping {
    /// Looks for what is wrong with the logs in a folder.
    ///
    /// # Errors
    /// If a file cannot be read at all.
    pub fn check(&self, logs: &Path) -> Result<Vec<LogFinding>, LogError> {
        let mut found = Vec::new();
        for drive in &self.drive {
            let sheet = self.sheet(logs, drive)?;
            let t = self.stamps(&sheet)?;
            let inside: Vec<f64> =
                t.iter().copied().filter(|t| (drive.from_secs..drive.to_secs).contains(t) || !t.is_finite()).collect();
            let of_stamps = stamps::findings(&sheet.file, &inside, self);
            let no_clock =
                of_stamps.iter().any(|f| f.problem == "wrong time unit" || f.problem.contains("do not grow"));
            found.extend(of_stamps);
            for (name, source) in &self.channels {
                for column in source.column.iter().chain(&source.mean_with).filter(|c| sheet.column(c).is_none()) {
                    found.push(LogFinding {
                        file: sheet.file.clone(),
                        channel: name.clone(),
                        problem: "missing channel".to_owned(),
                        evidence: format!("column {column} is absent or empty"),
                        proposal: format!("map channels.{name} to another column, or remove it"),
                    });
                }
            }
            let commands = found.iter().any(|f| f.problem == "missing channel" && f.channel.starts_with("cmd_"));
            if no_clock || commands {
                continue;
            }
            let records = self.records(logs, drive)?;
            if let Some(longest) = records.iter().max_by_key(|r| r.samples()) {
                found.extend(self.relations(longest));
            }
        }
        Ok(found)
    }

    fn relations(&self, record: &Record) -> Vec<LogFinding> {
        let Some(speed) = record.speed() else {
            return vec![finding(record, "v", "no speed", "neither v, v_wheel nor x and y", "map one of them")];
        };
        let (lf, lr) = self.nominal.arms_m();
        let mut found = motion::findings(record, &speed);
        found.extend(turning::findings(record, &speed, lf + lr));
        found
    }
}

fn finding(
    record: &Record,
    channel: &str,
    problem: &str,
    evidence: impl Into<String>,
    proposal: impl Into<String>,
) -> LogFinding {
    LogFinding {
        file: record.file.clone(),
        channel: channel.to_owned(),
        problem: problem.to_owned(),
        evidence: evidence.into(),
        proposal: proposal.into(),
    }
}

/// How one series goes with another.
#[derive(Debug, Clone, Copy)]
struct Relation {
    /// Units of the second per unit of the first.
    slope: f64,
    /// Correlation.
    correlation: f64,
}

/// Relates two series by their means over half a second, each less its own mean; `None` where the first hardly varies.
fn relate(first: &[f64], second: &[f64], least_spread: f64) -> Option<Relation> {
    let block = (0.5 / STEP_SECS) as usize;
    let means =
        |c: &[f64]| -> Vec<f64> { c.chunks_exact(block).map(|b| b.iter().sum::<f64>() / block as f64).collect() };
    let (a, b) = (means(first), means(second));
    let count = a.len().min(b.len());
    if count < 8 {
        return None;
    }
    let mean = |c: &[f64]| c[..count].iter().sum::<f64>() / count as f64;
    let (ma, mb) = (mean(&a), mean(&b));
    let (mut cross, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for (x, y) in a.iter().zip(&b) {
        cross += (x - ma) * (y - mb);
        aa += (x - ma).powi(2);
        bb += (y - mb).powi(2);
    }
    if (aa / count as f64).sqrt() < least_spread || bb <= 0.0 {
        return None;
    }
    Some(Relation { slope: cross / aa, correlation: cross / (aa * bb).sqrt() })
}

/// Tells whether a positive ratio lies within a factor of `times` of another.
fn near(ratio: f64, other: f64, times: f64) -> bool {
    ratio > 0.0 && (ratio / other).ln().abs() < times.ln()
}
