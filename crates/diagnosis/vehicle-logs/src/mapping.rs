//! The mapping file: which column of a log is which channel, in which unit, frame and sign, and the nominal vehicle.
//!
//! Everything is checked when the file is read; the rest of the module trusts it. Example: `configs/gap/`.

use std::collections::BTreeMap;
use std::path::Path;

use ds_diagnosis::CaseError;
use serde::Deserialize;

use crate::channel::{self, CHANNELS, COMMANDS, Channel};
use crate::command::{CommandKind, Declared};
use crate::error::LogError;

/// A mapping file.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mapping {
    /// Layout of the files.
    pub log: Layout,
    /// Time stamps of comma-separated files; bags have their own.
    #[serde(default)]
    pub time: Option<Time>,
    /// Axes of pose and body.
    #[serde(default)]
    pub frame: Frame,
    /// The files, each one drive or more; none where logs are named one by one ([`Mapping::for_log`]).
    #[serde(default)]
    pub drive: Vec<DriveFile>,
    /// Channels by name of the practice schema.
    pub channels: BTreeMap<String, Source>,
    /// The simulator that the user has.
    pub nominal: NominalModel,
}

/// Layout of the files.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Layout {
    /// Name of the case.
    pub name: String,
    /// Kind of file.
    #[serde(default)]
    pub format: LogFormat,
    /// Character between cells: one character, `tab` or `space` (any run of blanks).
    #[serde(default = "comma")]
    pub delimiter: String,
    /// Sign before the decimals.
    #[serde(default)]
    pub decimal: Decimal,
    /// Lines that begin with this are skipped.
    #[serde(default)]
    pub comment: Option<String>,
    /// Where the names of the columns stand.
    #[serde(default)]
    pub header: Header,
    /// How many lines below the names are not read, such as one of units; without names, how many at the top.
    #[serde(default)]
    pub skip: usize,
    /// Cuts long files into drives of this length, s; every fourth is held out.
    #[serde(default)]
    pub piece_secs: Option<f64>,
    /// Drops drives whose median speed is below this, m/s.
    #[serde(default)]
    pub least_speed_mps: f64,
}

/// Kind of file.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LogFormat {
    /// Text, one row per sample.
    #[default]
    Csv,
    /// MCAP with messages of ROS 2 or ROS 1.
    Mcap,
    /// ROS 1 bag.
    Rosbag1,
    /// SQLite file of rosbag2, or the folder of one bag.
    Rosbag2,
}

/// Sign before the decimals of a number.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
pub enum Decimal {
    /// A point.
    #[default]
    #[serde(rename = ".")]
    Point,
    /// A comma.
    #[serde(rename = ",")]
    Comma,
}

/// Where the names of the columns stand.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Header {
    /// In the first line that is no comment.
    #[default]
    First,
    /// In the first comment line.
    Commented,
    /// Nowhere: columns are given by number, from 1.
    None,
}

/// Time stamps.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Time {
    /// Column of the stamps.
    pub column: Column,
    /// `s`, `ms`, `us` or `ns`.
    #[serde(default = "second")]
    pub unit: String,
}

/// A column by its name or by its number, from 1.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(untagged)]
pub enum Column {
    /// By number.
    Number(usize),
    /// By name.
    Name(String),
}

/// Axes of pose and body.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Frame {
    /// Axes of x, y and yaw.
    pub pose: PoseAxes,
    /// Axes of gyro and accelerometers.
    pub body: BodyAxes,
    /// Logged point ahead of the centre of gravity, m; the case holds the centre of gravity.
    pub point_ahead_m: f64,
}

/// Axes of x, y and yaw.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PoseAxes {
    /// Right-handed seen from above, yaw counter-clockwise from x.
    #[default]
    Enu,
    /// x north, y east, yaw clockwise from north.
    Ned,
}

/// Axes of gyro and accelerometers.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BodyAxes {
    /// Forward, left, up.
    #[default]
    Flu,
    /// Forward, right, down.
    Frd,
}

/// One file.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DriveFile {
    /// Its path below the folder of the logs.
    pub file: String,
    /// Seconds after the first stamp from which it is used.
    #[serde(default)]
    pub from_secs: f64,
    /// Seconds after the first stamp up to which it is used.
    #[serde(default = "forever")]
    pub to_secs: f64,
    /// Kept out of the fit.
    #[serde(default)]
    pub held_out: bool,
}

/// Where a channel comes from.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Source {
    /// Its column.
    #[serde(default)]
    pub column: Option<Column>,
    /// Columns of latitude and longitude, degrees, in the place of one column: `x` is then metres east of the first fix, `y`
    /// north of it.
    #[serde(default)]
    pub fix: Option<[Column; 2]>,
    /// Its topic in a bag.
    #[serde(default)]
    pub topic: Option<String>,
    /// Its field in the messages of that topic: `twist.linear.x`; a quaternion gives the heading, `east` and `north` of a
    /// position fix metres from the first one.
    #[serde(default)]
    pub field: Option<String>,
    /// Which stamp of a message counts.
    #[serde(default)]
    pub stamp: Stamp,
    /// What the drive command asks for; of `cmd_accel` alone.
    #[serde(default)]
    pub kind: CommandKind,
    /// Turns of the motor per turn of the wheel, for a torque.
    #[serde(default)]
    pub ratio: Option<f64>,
    /// Radius of the driven wheels, m, for a torque or the turning of wheels.
    #[serde(default)]
    pub radius_m: Option<f64>,
    /// Further columns whose mean with the first is the channel, such as four wheels; in a bag, fields of the same topic.
    #[serde(default)]
    pub mean_with: Vec<Column>,
    /// Another channel from which it is computed: `cmd_accel` from `v`, `v_wheel` or `ax`; `v` from `x`; `yaw_rate` from
    /// `yaw`; `ax` from `v`. A derived measurement is for the checks only, and a measurement from which a command was
    /// derived is left out of the case: neither is ever an independent channel.
    #[serde(default)]
    pub derived_from: Option<String>,
    /// Unit in the log; `1` or `%` for a plain number that `scale` turns into SI.
    #[serde(default)]
    pub unit: Option<String>,
    /// Factor after the unit.
    #[serde(default = "one")]
    pub scale: f64,
    /// Added after the factor, SI.
    #[serde(default)]
    pub offset: f64,
    /// `true` turns the sign, last of all.
    #[serde(default)]
    pub negate: bool,
    /// Column that changes whenever this channel has a fresh sample; rows in between repeat an old one.
    #[serde(default)]
    pub fresh_with: Option<Column>,
}

/// Which stamp of a message counts.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stamp {
    /// That of its header where its type has one, else when it was received.
    #[default]
    Header,
    /// When it was received.
    Log,
    /// When it was sent, as an MCAP says.
    Publish,
}

/// How the nominal simulator is written down.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ModelKind {
    /// Wheels that do not slip.
    Kinematic,
    /// Linear tyres of usual stiffness per load where none is given.
    Linear,
    /// Linear tyres, every parameter given.
    LinearSingleTrack,
}

/// The nominal simulator; SI units.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NominalModel {
    /// Kind of model.
    pub model: ModelKind,
    /// kg.
    pub mass: f64,
    /// m; or give `lf` and `lr`.
    #[serde(default)]
    pub wheelbase: Option<f64>,
    /// Front axle to centre of gravity, m.
    #[serde(default)]
    pub lf: Option<f64>,
    /// Rear axle to centre of gravity, m.
    #[serde(default)]
    pub lr: Option<f64>,
    /// kg m²; mass lf lr if absent.
    #[serde(default)]
    pub yaw_inertia: Option<f64>,
    /// N/rad.
    #[serde(default)]
    pub cornering_stiffness_front: Option<f64>,
    /// N/rad.
    #[serde(default)]
    pub cornering_stiffness_rear: Option<f64>,
    /// s.
    #[serde(default)]
    pub steer_lag: f64,
    /// s.
    #[serde(default)]
    pub accel_lag: f64,
    /// m/s².
    #[serde(default)]
    pub rolling_decel: f64,
    /// 1/m.
    #[serde(default)]
    pub drag_decel_per_v2: f64,
    /// Friction coefficient.
    #[serde(default = "one")]
    pub friction: f64,
}

fn comma() -> String {
    ",".to_owned()
}

fn second() -> String {
    "s".to_owned()
}

fn one() -> f64 {
    1.0
}

fn forever() -> f64 {
    f64::INFINITY
}

/// From which channel each one may be derived.
const DERIVED: [(&str, &[&str]); 4] =
    [("cmd_accel", &["v", "v_wheel", "ax"]), ("v", &["x"]), ("yaw_rate", &["yaw"]), ("ax", &["v"])];

impl Mapping {
    /// Reads and checks a mapping file.
    ///
    /// # Errors
    /// If it is unreadable, no such file, or contradicts itself.
    pub fn read(path: &Path) -> Result<Self, LogError> {
        let text =
            std::fs::read_to_string(path).map_err(|source| CaseError::Read { path: path.to_path_buf(), source })?;
        Self::parse(&text).map_err(|error| match error {
            LogError::Toml { source, .. } => LogError::Toml { path: path.to_path_buf(), source },
            other => other,
        })
    }

    /// Checks the text of a mapping file.
    ///
    /// # Errors
    /// If it is none, or contradicts itself.
    pub fn parse(text: &str) -> Result<Self, LogError> {
        let mapping = Self::unchecked(text)?;
        mapping.consistent()?;
        Ok(mapping)
    }

    /// Reads the text of a mapping file that may lack what a simulator needs.
    pub(crate) fn unchecked(text: &str) -> Result<Self, LogError> {
        toml::from_str(text).map_err(|source| LogError::Toml { path: "mapping".into(), source: Box::new(source) })
    }

    fn consistent(&self) -> Result<(), LogError> {
        let wrong = |entry: &str, problem: String| Err(LogError::Mapping { entry: entry.to_owned(), problem });
        match &self.time {
            Some(time) if channel::seconds(&time.unit).is_none() => {
                return wrong("time.unit", format!("is {:?}, expected s, ms, us or ns", time.unit));
            }
            None if self.log.format == LogFormat::Csv => return wrong("time", "is absent".to_owned()),
            Some(_) if self.log.format != LogFormat::Csv => {
                return wrong("time", "belongs to comma-separated files; messages of a bag have stamps".to_owned());
            }
            _ => {}
        }
        if !["tab", "space"].contains(&self.log.delimiter.as_str()) && self.log.delimiter.chars().count() != 1 {
            return wrong("log.delimiter", format!("is {:?}, expected one character", self.log.delimiter));
        }
        for name in COMMANDS {
            if !self.channels.contains_key(name) {
                return wrong(&format!("channels.{name}"), "is absent; the simulator needs every command".to_owned());
            }
        }
        for (name, source) in &self.channels {
            let entry = format!("channels.{name}");
            let Some(known) = channel::find(name) else {
                let names: Vec<_> = CHANNELS.iter().map(|c| c.name).collect();
                return wrong(&entry, format!("is no channel, expected one of {names:?}"));
            };
            if let Err(problem) = source.origin(self.log.format) {
                return wrong(&entry, problem);
            }
            if source.fix.is_some() && (!["x", "y"].contains(&name.as_str()) || self.frame.pose != PoseAxes::Enu) {
                return wrong(
                    &entry,
                    "fix gives metres east as x and north as y alone, with the usual frame.pose".to_owned(),
                );
            }
            if let Some(from) = &source.derived_from {
                let allowed = DERIVED.iter().find(|(n, _)| n == name).map_or(&[][..], |(_, f)| f);
                if !allowed.contains(&from.as_str()) || !self.channels.contains_key(from) {
                    return wrong(&entry, format!("cannot be derived from {from:?}, only from mapped {allowed:?}"));
                }
            }
            if let Err(problem) = source.declared().check(name) {
                return wrong(&entry, problem);
            }
            let quantity = source.declared().quantity(known.quantity);
            if let Some(unit) = source.unit.as_ref().filter(|u| quantity.factor(u).is_none()) {
                return wrong(&entry, format!("cannot be in {unit:?}; SI is {}", quantity.unit()));
            }
        }
        match (self.nominal.wheelbase, self.nominal.lf, self.nominal.lr) {
            (Some(_), None, None) | (None, Some(_), Some(_)) => Ok(()),
            _ => wrong("nominal", "needs either wheelbase, or lf and lr".to_owned()),
        }
    }

    /// Returns this mapping for one log alone, as a case of the log's name: the stretches of it that `drive` lists, or all
    /// of it where that does not name it. Its folder is that of the log.
    #[must_use]
    pub fn for_log(&self, log: &Path) -> Self {
        let text = |part: Option<&std::ffi::OsStr>| part.unwrap_or_default().to_string_lossy().into_owned();
        let (file, name) = (text(log.file_name()), text(log.file_stem()));
        let of_it = |drive: &&DriveFile| Path::new(&drive.file).file_name() == log.file_name();
        let mut drive: Vec<DriveFile> = self.drive.iter().filter(of_it).cloned().collect();
        drive.iter_mut().for_each(|drive| drive.file.clone_from(&file));
        if drive.is_empty() {
            drive.push(DriveFile { file, from_secs: 0.0, to_secs: forever(), held_out: false });
        }
        Self { drive, log: Layout { name, ..self.log.clone() }, ..self.clone() }
    }

    /// Returns the files that are listed.
    ///
    /// # Errors
    /// If none is.
    pub(crate) fn listed(&self) -> Result<&[DriveFile], LogError> {
        if self.drive.is_empty() {
            let problem = "is empty: list the files, or name logs instead of their folder".to_owned();
            return Err(LogError::Mapping { entry: "drive".to_owned(), problem });
        }
        Ok(&self.drive)
    }
}

impl NominalModel {
    /// Returns the distances from the centre of gravity to the axles, m; the middle where only the wheelbase is known.
    pub(crate) fn arms_m(&self) -> (f64, f64) {
        let half = self.wheelbase.unwrap_or(0.0) * 0.5;
        (self.lf.unwrap_or(half), self.lr.unwrap_or(half))
    }
}

impl Mapping {
    /// Converts a raw value to SI, a drive command to what it asks of each kilogram or to the speed it asks for.
    pub(crate) fn convert(&self, known: Channel, source: &Source, raw: f64) -> f64 {
        let declared = source.declared();
        let quantity = declared.quantity(known.quantity);
        let unit = source.unit.as_deref().unwrap_or_else(|| quantity.unit());
        let value = raw * quantity.factor(unit).unwrap_or(1.0) * declared.factor(self.nominal.mass) * source.scale
            + source.offset;
        if source.negate { -value } else { value }
    }

    /// Tells whether the drive command asks for a speed.
    pub(crate) fn asks_for_speed(&self) -> bool {
        self.channels.get("cmd_accel").is_some_and(|source| source.kind == CommandKind::WheelSpeed)
    }
}

impl Source {
    /// Returns the columns that its values are made of.
    pub(crate) fn columns(&self) -> impl Iterator<Item = &Column> {
        self.column.iter().chain(self.fix.iter().flatten()).chain(&self.mean_with)
    }

    fn declared(&self) -> Declared {
        Declared { kind: self.kind, ratio: self.ratio, radius_m: self.radius_m }
    }

    /// Tells whether it says where its values are, as its format needs it.
    fn origin(&self, format: LogFormat) -> Result<(), String> {
        let of_text = self.column.is_some() || self.fix.is_some() || self.fresh_with.is_some();
        let of_bag = self.topic.is_some() || self.field.is_some() || self.stamp != Stamp::Header;
        let by_number = self.mean_with.iter().any(|c| matches!(c, Column::Number(_)));
        match (format == LogFormat::Csv, self.derived_from.is_some()) {
            (_, true) if of_text || of_bag => {
                Err("needs either column (in a bag topic and field) or derived_from".to_owned())
            }
            (_, true) => Ok(()),
            (true, _) if of_bag => Err("topic, field and stamp belong to bags; log.format is csv".to_owned()),
            (true, _) if self.column.is_some() == self.fix.is_some() => {
                Err("needs either column, fix or derived_from".to_owned())
            }
            (false, _) if of_text || by_number => {
                Err("column and fresh_with belong to csv; name topic and field".to_owned())
            }
            (false, _) if self.topic.is_none() || self.field.is_none() => {
                Err("needs either topic and field, or derived_from".to_owned())
            }
            _ => Ok(()),
        }
    }
}
