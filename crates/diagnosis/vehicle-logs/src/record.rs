//! A stretch of a log on the 20 Hz grid in the channels, units and frames of the practice schema.

use std::collections::BTreeMap;
use std::path::Path;

use crate::channel::{self, CHANNELS, COMMANDS};
use crate::error::LogError;
use crate::mapping::{BodyAxes, Column, DriveFile, Mapping, PoseAxes};
use crate::raw::Sheet;
use crate::resample::{held, measured, slope, stretches, unwrap};
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
    /// Returns every column that the mapping names.
    pub(crate) fn columns(&self) -> Vec<Column> {
        let of = self.channels.values().flat_map(|s| s.column.iter().chain(&s.mean_with).chain(&s.fresh_with));
        std::iter::once(&self.time.column).chain(of).cloned().collect()
    }

    /// Reads the columns of one file.
    pub(crate) fn sheet(&self, logs: &Path, drive: &DriveFile) -> Result<Sheet, LogError> {
        Sheet::read(&logs.join(&drive.file), &self.log, &self.columns())
    }

    /// Returns the stamps of a sheet in seconds after its first.
    pub(crate) fn stamps(&self, sheet: &Sheet) -> Result<Vec<f64>, LogError> {
        let raw = sheet.required(&self.time.column)?;
        let first = raw.iter().copied().find(|v| v.is_finite()).unwrap_or(0.0);
        let unit = channel::seconds(&self.time.unit).unwrap_or(1.0);
        Ok(raw.iter().map(|v| (v - first) * unit).collect())
    }

    /// Returns the stretches of one file that can be driven by the simulator.
    ///
    /// # Errors
    /// If the file is unreadable or a command is not in it.
    pub(crate) fn records(&self, logs: &Path, drive: &DriveFile) -> Result<Vec<Record>, LogError> {
        let sheet = self.sheet(logs, drive)?;
        let stamps = self.stamps(&sheet)?;
        let inside = |t: &f64| (drive.from_secs..drive.to_secs).contains(t);
        let t: Vec<f64> = stamps.iter().map(|t| if inside(t) { *t } else { f64::NAN }).collect();
        for name in COMMANDS {
            if let Some(column) = self.channels[name].column.as_ref() {
                sheet.required(column)?;
            }
        }
        let parts = stretches(&t).into_iter();
        Ok(parts.map(|rows| self.record(&sheet, &t, &rows)).filter(|r| r.secs() > SHORTEST_SECS).collect())
    }

    fn record(&self, sheet: &Sheet, t: &[f64], rows: &[usize]) -> Record {
        let times: Vec<f64> = rows.iter().map(|&k| t[k]).collect();
        let (start_secs, end) = (times[0], times[times.len() - 1]);
        let samples = ((end - start_secs) / STEP_SECS + 1e-6).floor() as usize + 1;
        let mut record =
            Record { file: sheet.file.clone(), start_secs, channels: BTreeMap::new(), derived: Vec::new() };
        for known in CHANNELS {
            let Some(mut column) = self.column(sheet, known, rows) else { continue };
            if known.name == "yaw" {
                unwrap(&mut column);
            }
            let to_grid = if COMMANDS.contains(&known.name) { held } else { measured };
            let even = to_grid(&times, &column, start_secs, STEP_SECS, samples);
            record.channels.insert(known.name, even);
        }
        self.turn_axes(&mut record);
        self.derive(&mut record);
        record
    }

    /// Returns one channel at some rows in SI, before its axes are turned.
    fn column(&self, sheet: &Sheet, known: channel::Channel, rows: &[usize]) -> Option<Vec<f64>> {
        let source = self.channels.get(known.name)?;
        let columns: Vec<&[f64]> =
            source.column.iter().chain(&source.mean_with).map(|c| sheet.column(c)).collect::<Option<_>>()?;
        if columns.is_empty() {
            return None;
        }
        let fresh = source.fresh_with.as_ref().and_then(|c| sheet.column(c));
        let mut before = f64::NAN;
        let column: Vec<f64> = rows
            .iter()
            .map(|&row| {
                let stamp = fresh.map_or(f64::NAN, |f| f[row]);
                let repeated = stamp == before;
                before = stamp;
                let raw = columns.iter().map(|c| c[row]).sum::<f64>() / columns.len() as f64;
                if repeated { f64::NAN } else { source.convert(raw, known.quantity) }
            })
            .collect();
        column.iter().any(|v| v.is_finite()).then_some(column)
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
