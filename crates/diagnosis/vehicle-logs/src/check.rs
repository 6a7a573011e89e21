//! Looks for what is wrong with a mapping or a log, by relations that hold in any vehicle, and says so in plain words.
//!
//! Every finding names the evidence and the change to the mapping that would remove it. A right log gives none.

mod motion;
mod turning;

pub(crate) use motion::{leads_astray, moving_ratio};
pub(crate) use turning::{STEERING_RATIO, wheelbase_m};

use std::path::Path;

use crate::echo;
use crate::error::LogError;
use crate::finding::LogFinding;
use crate::mapping::Mapping;
use crate::record::Record;
use crate::stamps;

impl Mapping {
    /// Looks for what is wrong with the logs in a folder.
    ///
    /// # Errors
    /// If a file cannot be read at all.
    pub fn check(&self, logs: &Path) -> Result<Vec<LogFinding>, LogError> {
        let mut found = Vec::new();
        for drive in self.listed()? {
            let log = self.open(logs, drive)?;
            let unit = self.time.as_ref().map(|time| time.unit.as_str());
            let of_stamps: Vec<LogFinding> =
                log.clocks.iter().flat_map(|clock| stamps::findings(&log.file, clock, unit)).collect();
            let no_clock =
                of_stamps.iter().any(|f| f.problem == "wrong time unit" || f.problem.contains("do not grow"));
            found.extend(of_stamps);
            for (name, what) in &log.missing {
                found.push(LogFinding {
                    file: log.file.clone(),
                    channel: name.clone(),
                    problem: "missing channel".to_owned(),
                    evidence: format!("{what} is absent or empty"),
                    proposal: format!("map channels.{name} to another column, or remove it"),
                });
            }
            let commands = log.missing.iter().any(|(name, _)| name.starts_with("cmd_"));
            if no_clock || commands {
                continue;
            }
            found.extend(echo::findings(&log));
            let records = self.records(&log)?;
            if let Some(longest) = records.iter().max_by_key(|r| r.samples()) {
                found.extend(self.relations(longest));
            }
        }
        Ok(found)
    }

    fn relations(&self, record: &Record) -> Vec<LogFinding> {
        let Some(speed) = record.speed() else {
            return vec![record.finding("v", "no speed", "neither v, v_wheel nor x and y", "map one of them")];
        };
        let (lf, lr) = self.nominal.arms_m();
        let mut found = motion::findings(record, &speed);
        found.extend(turning::findings(record, &speed, lf + lr));
        found
    }
}
