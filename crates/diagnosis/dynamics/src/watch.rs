//! Watches a vehicle: windows of its logs, one after another, against those of healthy logs, until an alarm.
//!
//! Nothing is fitted between alarms. What an alarm is about says a diagnosis of the log since it began.

pub mod detector;
pub mod scores;
pub mod tracker;

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::baseline::Baseline;
use crate::baseline::windows::Scored;
use crate::case::Case;
use crate::{Options, diagnose};
use detector::{Detector, Evidence};
use ds_diagnosis::{CaseError, Diagnosis};
use scores::{Scorer, WINDOW_SECS};

/// Least of its drive that is diagnosed, s.
const SHORTEST_SECS: f64 = 8.0;

/// One alarm.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Alarm {
    /// Name of the log.
    pub case: String,
    /// Drive of the log.
    pub drive: usize,
    /// Its file.
    pub file: String,
    /// Stamp of the alarm, s.
    pub secs: f64,
    /// Stamp from which on it looks different, s; the drive's first where it began in a drive before.
    pub since_secs: f64,
    /// Hours watched so far.
    pub hours: f64,
    /// Channels that tell it, with their shares of the evidence.
    pub channels: Vec<(String, f64)>,
}

/// A watch over logs of one vehicle.
pub struct Watch {
    baseline: Arc<Baseline>,
    detector: Detector,
    /// Windows judged so far.
    pub windows: usize,
    /// Windows that were not, because the car did what none of the healthy drives did.
    pub strange: usize,
}

impl Watch {
    /// Begins a watch.
    ///
    /// # Errors
    /// If the baseline has no windows of three healthy logs or more.
    pub fn new(baseline: Arc<Baseline>, alarms_per_hour: f64) -> Result<Self, CaseError> {
        let detector = Detector::new(baseline.windows.as_ref(), alarms_per_hour)?;
        Ok(Self { baseline, detector, windows: 0, strange: 0 })
    }

    /// Returns the hours watched so far.
    #[must_use]
    pub fn hours(&self) -> f64 {
        self.windows as f64 * WINDOW_SECS / 3600.0
    }

    /// Returns the evidence at which there is an alarm.
    #[must_use]
    pub fn threshold(&self) -> f64 {
        self.detector.threshold()
    }

    /// Begins another log: what the day brings is unknown again.
    #[must_use]
    pub fn scorer(&self) -> Scorer {
        Scorer::new(self.baseline.clone())
    }

    /// Watches a whole log, all its drives.
    ///
    /// # Errors
    /// If the baseline is not one for the log.
    pub fn log(&mut self, name: &str, case: &Case) -> Result<Vec<Alarm>, CaseError> {
        self.baseline.check(&case.meta, &case.drives, case.stand_in.as_ref())?;
        let drives: Vec<usize> = (0..case.drives.len()).collect();
        let (scored, strange) = self.scorer().take(case, &drives, f64::NEG_INFINITY);
        self.strange += strange;
        let mut found = Vec::new();
        for window in scored {
            let Some(evidence) = self.take(&window) else { continue };
            let drive = &case.drives[window.drive];
            found.push(Alarm {
                case: name.to_owned(),
                drive: window.drive,
                file: drive.file.clone(),
                secs: window.secs,
                since_secs: since(&evidence, window.secs).max(drive.start_secs),
                hours: self.hours(),
                channels: evidence.channels.iter().map(|(c, share)| (c.name().to_owned(), *share)).collect(),
            });
        }
        Ok(found)
    }

    /// Judges one window.
    pub fn take(&mut self, window: &Scored) -> Option<Evidence> {
        self.windows += 1;
        self.detector.take(window)
    }

    /// Diagnoses a log since an alarm's cause began, to its end, against the baseline; also returns from when on.
    ///
    /// # Errors
    /// If what is left is too short or makes no sense by itself.
    pub fn diagnose(&self, case: &Case, alarm: &Alarm, options: &Options) -> Result<(Diagnosis, f64), CaseError> {
        let first = &case.drives[alarm.drive];
        let from = alarm.since_secs.min(first.end_secs() - SHORTEST_SECS).max(first.start_secs);
        let mut drives = case.drives[alarm.drive..].to_vec();
        drives[0] = first.between(from, first.end_secs());
        let mut meta = case.meta.clone();
        meta.drives.drain(..alarm.drive);
        meta.suggested_split = None;
        let since = Case::new(meta, drives)?.against(self.baseline.clone())?;
        Ok((diagnose(&since, options), from))
    }
}

/// Returns since when evidence that was full at a time grew.
#[must_use]
pub fn since(evidence: &Evidence, secs: f64) -> f64 {
    secs - evidence.windows as f64 * WINDOW_SECS
}
