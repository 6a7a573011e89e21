//! A log as it was written: each mapped channel in SI with the stamps of its own samples, whatever the format.
//!
//! Comma-separated files have one clock for all channels, bags one per topic. A drive is where no measured topic has a hole.

use std::collections::BTreeMap;
use std::path::Path;
use std::rc::Rc;

use ds_bags::{Format, Plane, Wanted};

use crate::channel::{self, CHANNELS, COMMANDS, Channel};
use crate::error::LogError;
use crate::mapping::{Column, DriveFile, LogFormat, Mapping, Source, Stamp};
use crate::raw::Sheet;
use crate::stamps::{self, Clock, LONGEST_HOLE_SECS};

/// A channel with the stamps of its samples, which grow; an absent value is NaN.
pub(crate) struct Series {
    /// Seconds after the first stamp of the log.
    pub t: Rc<[f64]>,
    /// In SI, axes as logged.
    pub values: Vec<f64>,
}

/// A log in memory.
pub(crate) struct Log {
    /// Name of the file.
    pub file: String,
    /// Its clocks as written.
    pub clocks: Vec<Clock>,
    /// Channels by name.
    pub series: BTreeMap<&'static str, Series>,
    /// Mapped channels that are not in it, with what was sought.
    pub missing: Vec<(String, String)>,
    /// From when to when it can be driven.
    pub spans: Vec<(f64, f64)>,
}

impl Mapping {
    /// Reads what is mapped of one log.
    ///
    /// # Errors
    /// If it is unreadable or a command is not in it.
    pub(crate) fn open(&self, logs: &Path, drive: &DriveFile) -> Result<Log, LogError> {
        let path = logs.join(&drive.file);
        match self.log.format {
            LogFormat::Csv => self.open_sheet(&path, drive),
            LogFormat::Mcap => self.open_bag(&path, Format::Mcap, drive),
            LogFormat::Rosbag1 => self.open_bag(&path, Format::Rosbag1, drive),
            LogFormat::Rosbag2 => self.open_bag(&path, Format::Rosbag2, drive),
        }
    }

    fn open_sheet(&self, path: &Path, drive: &DriveFile) -> Result<Log, LogError> {
        let mapped = self.channels.values().flat_map(|s| s.columns().chain(&s.fresh_with));
        let columns: Vec<Column> = std::iter::once(self.stamped()).chain(mapped.cloned()).collect();
        let sheet = Sheet::read(path, &self.log, &columns)?;
        for name in COMMANDS {
            if let Some(column) = self.channels[name].column.as_ref() {
                sheet.required(column)?;
            }
        }
        self.of_sheet(&sheet, drive)
    }

    /// Returns the column of the stamps.
    fn stamped(&self) -> Column {
        self.time.as_ref().map_or(Column::Number(1), |time| time.column.clone())
    }

    /// Takes what is mapped out of a table that holds it.
    pub(crate) fn of_sheet(&self, sheet: &Sheet, drive: &DriveFile) -> Result<Log, LogError> {
        let time = self.stamped();
        let unit = self.time.as_ref().and_then(|time| channel::seconds(&time.unit)).unwrap_or(1.0);
        let raw = sheet.required(&time)?;
        let first = raw.iter().copied().find(|v| v.is_finite()).unwrap_or(0.0);
        let inside = |t: f64| (drive.from_secs..drive.to_secs).contains(&t);
        let t: Vec<f64> = raw.iter().map(|v| (v - first) * unit).collect();
        let used: Vec<f64> = t.iter().map(|t| if inside(*t) { *t } else { f64::NAN }).collect();
        let rows = stamps::growing(&used);
        let grown: Rc<[f64]> = rows.iter().map(|&row| t[row]).collect();
        let mut log = Log {
            file: sheet.file.clone(),
            spans: stamps::spans(&grown, LONGEST_HOLE_SECS),
            clocks: vec![Clock {
                name: "time".to_owned(),
                t: t.into_iter().filter(|t| inside(*t) || !t.is_finite()).collect(),
                sorted: false,
            }],
            series: BTreeMap::new(),
            missing: Vec::new(),
        };
        for (known, source) in self.sources() {
            let absent: Vec<_> =
                source.columns().filter(|c| sheet.column(c).is_none()).map(|c| format!("column {c}")).collect();
            log.missing.extend(absent.into_iter().map(|what| (known.name.to_owned(), what)));
            if let Some(values) = self.column(sheet, known, source, &rows) {
                log.series.insert(known.name, Series { t: grown.clone(), values });
            }
        }
        Ok(log)
    }

    /// Returns one channel at some rows.
    fn column(&self, sheet: &Sheet, known: Channel, source: &Source, rows: &[usize]) -> Option<Vec<f64>> {
        let columns: Vec<&[f64]> = source.columns().map(|c| sheet.column(c)).collect::<Option<_>>()?;
        if columns.is_empty() {
            return None;
        }
        let fresh = source.fresh_with.as_ref().and_then(|c| sheet.column(c));
        let mut before = f64::NAN;
        let mut plane = Plane::default();
        let value = |&row: &usize| {
            let stamp = fresh.map_or(f64::NAN, |f| f[row]);
            let repeated = stamp == before;
            before = stamp;
            let raw = match (&source.fix, &columns[..]) {
                (Some(_), [latitude, longitude]) => {
                    plane.place([latitude[row], longitude[row]])[usize::from(known.name == "y")]
                }
                _ => columns.iter().map(|c| c[row]).sum::<f64>() / columns.len() as f64,
            };
            if repeated { f64::NAN } else { self.convert(known, source, raw) }
        };
        Some(rows.iter().map(value).collect())
    }

    fn open_bag(&self, path: &Path, format: Format, drive: &DriveFile) -> Result<Log, LogError> {
        let mut wanted: Vec<(Channel, Wanted)> = Vec::new();
        for (known, source) in self.sources() {
            let Some((topic, field)) = source.topic.as_ref().zip(source.field.as_ref()) else { continue };
            let more = source.mean_with.iter().map(ToString::to_string);
            for field in std::iter::once(field.clone()).chain(more) {
                wanted.push((known, Wanted { topic: topic.clone(), field, clock: clock(source.stamp) }));
            }
        }
        let sought: Vec<Wanted> = wanted.iter().map(|(_, w)| w.clone()).collect();
        let found = ds_bags::series(path, format, &sought)?;
        let origin = found.iter().flat_map(|s| s.nanos.iter().min()).min().copied().unwrap_or(0);
        let secs = |nanos: i64| nanos.saturating_sub(origin) as f64 * 1e-9;
        let file = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let mut log = Log { file, clocks: Vec::new(), series: BTreeMap::new(), missing: Vec::new(), spans: Vec::new() };
        let mut found = wanted.into_iter().zip(found).peekable();
        while let Some(((known, sought), mut series)) = found.next() {
            let mut count = 1.0;
            while let Some((_, more)) = found.next_if(|((other, _), _)| *other == known) {
                series.values.iter_mut().zip(more.values).for_each(|(sum, v)| *sum += v);
                count += 1.0;
            }
            if !series.values.iter().any(|v| v.is_finite()) {
                let what = format!("field {:?} of topic {:?}", sought.field, sought.topic);
                if COMMANDS.contains(&known.name) {
                    return Err(LogError::NoMessage { what, file: log.file });
                }
                log.missing.push((known.name.to_owned(), what));
                continue;
            }
            let t: Vec<f64> = series.nanos.iter().map(|nanos| secs(*nanos)).collect();
            let mut order: Vec<usize> =
                (0..t.len()).filter(|k| (drive.from_secs..drive.to_secs).contains(&t[*k])).collect();
            order.sort_by(|a, b| t[*a].total_cmp(&t[*b]));
            order.dedup_by(|later, kept| t[*later] <= t[*kept]);
            let source = &self.channels[known.name];
            let convert = |&k: &usize| self.convert(known, source, series.values[k] / count);
            let values = order.iter().map(convert).collect();
            log.series.insert(known.name, Series { t: order.iter().map(|&k| t[k]).collect(), values });
            if log.clocks.iter().all(|clock| clock.name != sought.topic) {
                log.clocks.push(Clock { name: sought.topic, t, sorted: true });
            }
        }
        log.spans = common(&log.series);
        Ok(log)
    }

    /// Returns every mapped channel in the order of the practice files.
    fn sources(&self) -> impl Iterator<Item = (Channel, &Source)> {
        CHANNELS.into_iter().filter_map(|known| Some((known, self.channels.get(known.name)?)))
    }
}

fn clock(stamp: Stamp) -> ds_bags::Clock {
    match stamp {
        Stamp::Header => ds_bags::Clock::Own,
        Stamp::Log => ds_bags::Clock::Log,
        Stamp::Publish => ds_bags::Clock::Publish,
    }
}

/// Returns from when to when every channel is there: measurements without holes, commands from their first message on.
fn common(series: &BTreeMap<&'static str, Series>) -> Vec<(f64, f64)> {
    let mut spans = vec![(f64::NEG_INFINITY, f64::INFINITY)];
    for (name, series) in series {
        let hole = stamps::longest_hole_secs(&series.t);
        let known: Vec<f64> =
            series.t.iter().zip(&series.values).filter(|(_, v)| v.is_finite()).map(|(t, _)| *t).collect();
        let mut own = stamps::spans(&known, hole);
        if COMMANDS.contains(name) {
            own.iter_mut().for_each(|span| span.1 += hole);
        }
        spans = stamps::both(&spans, &own);
    }
    spans.retain(|span| span.0.is_finite() && span.1.is_finite());
    spans
}
