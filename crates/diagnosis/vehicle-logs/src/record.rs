//! A stretch of a log on the 20 Hz grid in the channels, units and frames of the practice schema.

use std::collections::BTreeMap;

use crate::channel::{self, CHANNELS, COMMANDS};
use crate::error::LogError;
use crate::finding::LogFinding;
use crate::log::Log;
use crate::mapping::{BodyAxes, Mapping, PoseAxes};
use crate::resample::{held, slope, unwrap};
use ds_diagnosis::grid::means;
use ds_diagnosis::table::STEP_SECS;

/// Shortest stretch that becomes a drive, s.
pub(crate) const SHORTEST_SECS: f64 = 8.0;

/// A stretch of a log.
#[derive(Debug, Clone)]
pub struct Record {
    /// The file it comes from.
    pub file: String,
    /// Seconds after the first stamp of the file at which it begins.
    pub start_secs: f64,
    /// Channels by name, all of one length; NaN never occurs.
    pub channels: BTreeMap<&'static str, Vec<f64>>,
    /// Channels that were computed from others.
    pub derived: Vec<&'static str>,
}

impl Mapping {
    /// Returns the stretches of a log that can be driven by the simulator.
    ///
    /// # Errors
    /// If a command is not in it, or its topics were never recorded at the same time.
    pub(crate) fn records(&self, log: &Log) -> Result<Vec<Record>, LogError> {
        if log.spans.is_empty() && !log.series.is_empty() {
            let clocks = log.series.iter().filter_map(|(name, series)| {
                Some(format!("{name} {:.1} to {:.1} s", series.t.first()?, series.t.last()?))
            });
            return Err(LogError::Apart { clocks: clocks.collect(), file: log.file.clone() });
        }
        let parts = log.spans.iter().map(|(start_secs, end_secs)| self.record(log, *start_secs, *end_secs));
        Ok(parts.filter(|r| r.secs() > SHORTEST_SECS).collect())
    }

    fn record(&self, log: &Log, start_secs: f64, end_secs: f64) -> Record {
        let samples = ((end_secs - start_secs) / STEP_SECS + 1e-6).floor() as usize + 1;
        let mut record = Record { file: log.file.clone(), start_secs, channels: BTreeMap::new(), derived: Vec::new() };
        for known in CHANNELS {
            let Some(series) = log.series.get(known.name) else { continue };
            // what was in force at the start, and what a line at the end leads to
            let first = series.t.partition_point(|t| *t <= start_secs).saturating_sub(1);
            let last = (series.t.partition_point(|t| *t < end_secs) + 1).min(series.t.len());
            let (times, mut column) = (&series.t[first..last], series.values[first..last].to_vec());
            if !column.iter().any(|v| v.is_finite()) {
                continue;
            }
            if known.name == "yaw" {
                unwrap(&mut column);
            }
            let to_grid = if COMMANDS.contains(&known.name) { held } else { means };
            record.channels.insert(known.name, to_grid(times, &column, start_secs, STEP_SECS, samples));
        }
        if let Some(asked) = record.channels.get_mut("cmd_accel").filter(|_| self.asks_for_speed()) {
            *asked = self.drive_command("v", asked);
        }
        self.turn_axes(&mut record);
        self.derive(&mut record);
        record
    }

    fn turn_axes(&self, record: &mut Record) {
        let channels = &mut record.channels;
        if self.frame.pose == PoseAxes::Ned {
            let (north, east) = (channels.remove("x"), channels.remove("y"));
            channels.extend(east.map(|c| ("x", c)));
            channels.extend(north.map(|c| ("y", c)));
            let quarter = std::f64::consts::FRAC_PI_2;
            channels.entry("yaw").and_modify(|yaw| yaw.iter_mut().for_each(|a| *a = quarter - *a));
        }
        if self.frame.body == BodyAxes::Frd {
            for name in ["ay", "yaw_rate"] {
                channels.entry(name).and_modify(|c| c.iter_mut().for_each(|v| *v = -*v));
            }
        }
        if let (Some(yaw), true) = (channels.get("yaw").cloned(), self.frame.point_ahead_m != 0.0) {
            let ahead = self.frame.point_ahead_m;
            for (name, part) in [("x", f64::cos as fn(f64) -> f64), ("y", f64::sin)] {
                channels.entry(name).and_modify(|c| c.iter_mut().zip(&yaw).for_each(|(v, a)| *v -= ahead * part(*a)));
            }
        }
    }

    /// Computes the channels that the mapping derives, measurements before commands.
    fn derive(&self, record: &mut Record) {
        for name in ["v", "yaw_rate", "ax", "cmd_accel"] {
            let Some(from) = self.channels.get(name).and_then(|s| s.derived_from.as_deref()) else { continue };
            let Some(base) = record.channels.get(from) else { continue };
            let column = match name {
                "v" => {
                    let Some(y) = record.channels.get("y") else { continue };
                    let (dx, dy) = (slope(base, STEP_SECS), slope(y, STEP_SECS));
                    dx.iter().zip(&dy).map(|(a, b)| a.hypot(*b)).collect()
                }
                "cmd_accel" => self.drive_command(from, base),
                _ => slope(base, STEP_SECS),
            };
            let source = &self.channels[name];
            let column = column.into_iter().map(|v: f64| if source.negate { -v } else { v }).collect();
            if let Some(known) = channel::find(name) {
                record.channels.insert(known.name, column);
                record.derived.push(known.name);
            }
        }
    }

    /// Returns the drive force over mass that the nominal vehicle needs for the measured motion.
    fn drive_command(&self, from: &str, base: &[f64]) -> Vec<f64> {
        if from == "ax" {
            return base.iter().map(|a| a + self.nominal.rolling_decel).collect();
        }
        let resist = |v: f64| {
            let moving = (v.abs() / 0.2).min(1.0);
            moving * self.nominal.rolling_decel + self.nominal.drag_decel_per_v2 * v * v
        };
        slope(base, STEP_SECS).iter().zip(base).map(|(a, v)| a + resist(*v)).collect()
    }
}

impl Record {
    /// Returns a finding about it.
    pub(crate) fn finding(
        &self,
        channel: &str,
        problem: &str,
        evidence: impl Into<String>,
        proposal: impl Into<String>,
    ) -> LogFinding {
        LogFinding {
            file: self.file.clone(),
            channel: channel.to_owned(),
            problem: problem.to_owned(),
            evidence: evidence.into(),
            proposal: proposal.into(),
        }
    }

    /// Returns its length, s.
    #[must_use]
    pub fn secs(&self) -> f64 {
        self.samples().saturating_sub(1) as f64 * STEP_SECS
    }

    /// Returns its number of samples.
    #[must_use]
    pub fn samples(&self) -> usize {
        self.channels.values().next().map_or(0, Vec::len)
    }

    /// Returns a channel.
    #[must_use]
    pub fn channel(&self, name: &str) -> Option<&[f64]> {
        self.channels.get(name).map(Vec::as_slice)
    }

    /// Returns the best speed there is, m/s.
    #[must_use]
    pub fn speed(&self) -> Option<Vec<f64>> {
        if let Some(v) = self.channel("v").or_else(|| self.channel("v_wheel")) {
            return Some(v.to_vec());
        }
        self.path()
    }

    /// Returns how fast its position moves, m/s.
    pub(crate) fn path(&self) -> Option<Vec<f64>> {
        let (dx, dy) = (slope(self.channel("x")?, STEP_SECS), slope(self.channel("y")?, STEP_SECS));
        Some(dx.iter().zip(&dy).map(|(a, b)| a.hypot(*b)).collect())
    }

    /// Cuts out some samples.
    #[must_use]
    pub(crate) fn cut(&self, range: std::ops::Range<usize>) -> Self {
        Self {
            file: self.file.clone(),
            start_secs: self.start_secs + range.start as f64 * STEP_SECS,
            channels: self.channels.iter().map(|(name, c)| (*name, c[range.clone()].to_vec())).collect(),
            derived: self.derived.clone(),
        }
    }
}
