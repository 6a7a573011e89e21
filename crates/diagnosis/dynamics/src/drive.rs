//! One recorded drive on an even 20 Hz grid, ego and followers, with absent channels left absent.
//!
//! Columns and units are those of the practice logs. Stamps must grow; short gaps are bridged by straight lines. What comes
//! faster is averaged over a step of the grid, but commands, which are kept where they were sent.

pub(crate) mod fast;
mod stamps;

use std::path::Path;

use ds_diagnosis::CaseError;
use ds_diagnosis::grid::{lines, means};
use ds_diagnosis::meta::DriveEntry;
use ds_diagnosis::table::{STEP_SECS, Table};

use fast::FAST_HZ;

/// One drive.
#[derive(Debug, Clone)]
pub struct Drive {
    /// Name of the file.
    pub file: String,
    /// First stamp, s.
    pub start_secs: f64,
    /// Samples per second of the file itself, by the median step.
    pub rate_hz: f64,
    /// Number of samples on the 20 Hz grid.
    pub samples: usize,
    /// Commanded road-wheel angle, rad.
    pub cmd_steer: Vec<f64>,
    /// Commanded force over nominal mass, m/s².
    pub cmd_accel: Vec<f64>,
    /// Both commands on the fine grid of [`crate::ego::FINE_SECS`], where the log is fast enough to say.
    pub fine: Option<[Vec<f64>; 2]>,
    /// The same drive by single rows where others are averaged: what scatters from row to row is told by these.
    pub single: Option<Box<Self>>,
    /// Position east, m.
    pub x: Option<Vec<f64>>,
    /// Position north, m.
    pub y: Option<Vec<f64>>,
    /// Heading, rad, without jumps.
    pub yaw: Option<Vec<f64>>,
    /// Longitudinal speed, m/s.
    pub v: Option<Vec<f64>>,
    /// Gyro, rad/s.
    pub yaw_rate: Option<Vec<f64>>,
    /// Forward accelerometer, m/s².
    pub ax: Option<Vec<f64>>,
    /// Left accelerometer, m/s².
    pub ay: Option<Vec<f64>>,
    /// Steering position, rad.
    pub steer_meas: Option<Vec<f64>>,
    /// Wheel speed, m/s.
    pub v_wheel: Option<Vec<f64>>,
    /// Share of samples that are exact copies of the one before although the vehicle moves.
    pub repeated_share: f64,
    /// What is odd about its rows but could be used.
    pub oddities: Vec<String>,
    /// Followers.
    pub followers: Vec<FollowerLog>,
    /// Their desired speed, m/s.
    pub desired_speed_mps: f64,
}

/// The log of one follower, on its own even grid.
#[derive(Debug, Clone)]
pub struct FollowerLog {
    /// 1 follows the ego, 2 follows 1.
    pub id: u32,
    /// First stamp, s.
    pub start_secs: f64,
    /// Step, s.
    pub step_secs: f64,
    /// Speed, m/s.
    pub v: Vec<f64>,
    /// Bumper-to-bumper gap, m.
    pub gap: Vec<f64>,
    /// Speed of the vehicle ahead, m/s.
    pub v_lead: Vec<f64>,
}

/// How a column comes onto a grid: stamps, column, first stamp, step, samples.
type ToGrid = fn(&[f64], &[f64], f64, f64, usize) -> Vec<f64>;

impl Drive {
    /// Returns the drive by single rows.
    #[must_use]
    pub fn by_rows(&self) -> &Self {
        self.single.as_deref().unwrap_or(self)
    }

    /// Reads a drive of a case folder.
    ///
    /// # Errors
    /// If a file is unreadable, a needed column is absent, a column has a long hole, stamps do not grow or the drive is too
    /// short.
    pub fn read(case: &Path, entry: &DriveEntry) -> Result<Self, CaseError> {
        let table = Table::read(&case.join(&entry.file))?;
        let agents = entry.agents.as_ref().map(|file| case.join(file)).filter(|path| path.exists());
        Self::new(&table, agents.map(|path| Table::read(&path)).transpose()?.as_ref(), entry)
    }

    /// Makes a drive of the table of the ego and, where there are some, that of its followers.
    ///
    /// # Errors
    /// If a needed column is absent, a column has a long hole, stamps do not grow or the drive is too short.
    pub fn new(table: &Table, agents: Option<&Table>, entry: &DriveEntry) -> Result<Self, CaseError> {
        let t = stamps::stamps(table)?;
        stamps::whole(table, &t, &COMMANDS)?;
        stamps::whole(table, &t, &MEASURED)?;
        let mut steps: Vec<f64> = t.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let rate_hz = 1.0 / ds_stats::quantile(&mut steps, 0.5);
        let fast = rate_hz > FAST_HZ;
        let followers = agents.map(followers).transpose()?.unwrap_or_default();
        let free = followers.iter().flat_map(|f| &f.v_lead).copied().fold(10.0, f64::max);
        let desired_speed_mps = entry.agents_desired_speed.unwrap_or(free);
        let by = |to_grid: ToGrid| -> Result<Self, CaseError> {
            let ego = Self::on_grid(table, &t, rate_hz, &entry.file, to_grid)?;
            Ok(Self { followers: followers.clone(), desired_speed_mps, ..ego })
        };
        if fast { Ok(Self { single: Some(Box::new(by(lines)?)), ..by(means)? }) } else { by(lines) }
    }

    /// Brings the ego of a table with its stamps onto the grid.
    fn on_grid(table: &Table, t: &[f64], rate_hz: f64, file: &str, to_grid: ToGrid) -> Result<Self, CaseError> {
        let fast = rate_hz > FAST_HZ;
        let start_secs = t[0];
        let samples = ((t[t.len() - 1] - t[0]) / STEP_SECS + 1e-6).floor() as usize + 1;
        let pose = copies(table, &["x", "y", "yaw", "v"]);
        let imu = copies(table, &["yaw_rate", "ax", "ay"]);
        let copied_share = |copied: &[bool]| copied.iter().filter(|c| **c).count() as f64 / t.len() as f64;
        let share = |copied: &[bool]| if fast { fast::lost_share(t, copied) } else { copied_share(copied) };
        let repeated_share = share(&pose).max(share(&imu));
        // a copy says nothing new: it is taken out and bridged, so that its age does not look like a latency
        let optional = |name: &str| {
            let copied = if IMU.contains(&name) { &imu } else { &pose };
            let repaired = |column: &[f64]| -> Vec<f64> {
                let pairs = column.iter().zip(copied);
                pairs.map(|(value, copied)| if *copied { f64::NAN } else { *value }).collect()
            };
            let column = table.column(name)?;
            let moved = match (fast, POSE.contains(&name) || IMU.contains(&name)) {
                (true, _) => fast::own(t, column),
                (false, true) => repaired(column),
                (false, false) => column.to_vec(),
            };
            let moved = if name == "yaw" { unwrap(&moved) } else { moved };
            Some(to_grid(t, &moved, start_secs, STEP_SECS, samples))
        };
        let unwrapped = optional("yaw");
        let (steer, accel) = (table.required("cmd_steer")?, table.required("cmd_accel")?);
        Ok(Self {
            file: file.to_owned(),
            start_secs,
            rate_hz,
            samples,
            cmd_steer: lines(t, steer, start_secs, STEP_SECS, samples),
            cmd_accel: lines(t, accel, start_secs, STEP_SECS, samples),
            fine: fast.then(|| [steer, accel].map(|command| fast::sent(t, command, samples))),
            single: None,
            x: optional("x"),
            y: optional("y"),
            yaw: unwrapped,
            v: optional("v"),
            yaw_rate: optional("yaw_rate"),
            ax: optional("ax"),
            ay: optional("ay"),
            steer_meas: optional("steer_meas"),
            v_wheel: optional("v_wheel"),
            repeated_share,
            oddities: stamps::oddities(t, rate_hz),
            followers: Vec::new(),
            desired_speed_mps: 0.0,
        })
    }

    /// Returns the last stamp, s.
    #[must_use]
    pub fn end_secs(&self) -> f64 {
        self.start_secs + (self.samples - 1) as f64 * STEP_SECS
    }

    /// Returns the ego between two stamps, s, without followers.
    #[must_use]
    pub fn between(&self, from_secs: f64, to_secs: f64) -> Self {
        let at = |secs: f64| (((secs - self.start_secs) / STEP_SECS).round().max(0.0) as usize).min(self.samples - 1);
        let (first, last) = (at(from_secs), at(to_secs));
        let cut = |column: &[f64]| column[first..=last].to_vec();
        let some = |column: &Option<Vec<f64>>| column.as_deref().map(cut);
        let fine = |fine: &[Vec<f64>; 2]| fine.each_ref().map(|c| c[fast::fine(first)..=fast::fine(last)].to_vec());
        Self {
            start_secs: self.start_secs + first as f64 * STEP_SECS,
            samples: last - first + 1,
            cmd_steer: cut(&self.cmd_steer),
            cmd_accel: cut(&self.cmd_accel),
            fine: self.fine.as_ref().map(fine),
            single: self.single.as_ref().map(|single| Box::new(single.between(from_secs, to_secs))),
            x: some(&self.x),
            y: some(&self.y),
            yaw: some(&self.yaw),
            v: some(&self.v),
            yaw_rate: some(&self.yaw_rate),
            ax: some(&self.ax),
            ay: some(&self.ay),
            steer_meas: some(&self.steer_meas),
            v_wheel: some(&self.v_wheel),
            followers: Vec::new(),
            ..self.clone()
        }
    }

    /// Returns the ego's channels by column name.
    #[must_use]
    pub fn columns(&self) -> Vec<(&'static str, &[f64])> {
        let some = [
            ("cmd_steer", Some(&self.cmd_steer)),
            ("cmd_accel", Some(&self.cmd_accel)),
            ("x", self.x.as_ref()),
            ("y", self.y.as_ref()),
            ("yaw", self.yaw.as_ref()),
            ("v", self.v.as_ref()),
            ("yaw_rate", self.yaw_rate.as_ref()),
            ("ax", self.ax.as_ref()),
            ("ay", self.ay.as_ref()),
            ("steer_meas", self.steer_meas.as_ref()),
            ("v_wheel", self.v_wheel.as_ref()),
        ];
        some.into_iter().filter_map(|(name, column)| column.map(|c| (name, c.as_slice()))).collect()
    }

    /// Returns the best speed record there is: positioning system, else wheels, else the change of position.
    #[must_use]
    pub fn speed(&self) -> Option<Vec<f64>> {
        if let Some(v) = self.v.as_ref().or(self.v_wheel.as_ref()) {
            return Some(v.clone());
        }
        let (x, y) = (self.x.as_ref()?, self.y.as_ref()?);
        let last = x.len() - 1;
        let speed = |k: usize| {
            let (a, b) = (k.saturating_sub(5), (k + 5).min(last));
            (x[b] - x[a]).hypot(y[b] - y[a]) / ((b - a) as f64 * STEP_SECS)
        };
        Some((0..x.len()).map(speed).collect())
    }
}

/// What is asked of the car.
pub(crate) const COMMANDS: [&str; 2] = ["cmd_steer", "cmd_accel"];
/// What is measured of the car, in the order of its channels.
pub const MEASURED: [&str; 9] = ["x", "y", "yaw", "v", "yaw_rate", "ax", "ay", "steer_meas", "v_wheel"];
const POSE: [&str; 4] = ["x", "y", "yaw", "v"];
const IMU: [&str; 3] = ["yaw_rate", "ax", "ay"];

/// Marks rows in which all of these columns repeat the row before although the vehicle moves.
fn copies(table: &Table, names: &[&str]) -> Vec<bool> {
    let columns: Vec<&[f64]> = names.iter().filter_map(|name| table.column(name)).collect();
    let speed = table.column("v").or_else(|| table.column("v_wheel"));
    let moving = |k: usize| speed.is_none_or(|v| v[k] > 0.3);
    let same = |k: usize| columns.iter().all(|c| (c[k] - c[k - 1]).abs() < 1e-12);
    (0..table.rows()).map(|k| k > 0 && columns.len() > 1 && moving(k) && same(k)).collect()
}

fn unwrap(yaw: &[f64]) -> Vec<f64> {
    let mut last = f64::NAN;
    yaw.iter()
        .map(|&raw| {
            if raw.is_nan() {
                return raw;
            }
            let turns = if last.is_nan() { 0.0 } else { ((last - raw) / std::f64::consts::TAU).round() };
            last = raw + turns * std::f64::consts::TAU;
            last
        })
        .collect()
}

fn followers(table: &Table) -> Result<Vec<FollowerLog>, CaseError> {
    if table.rows() == 0 {
        return Ok(Vec::new());
    }
    let (t, id) = (table.required("t")?, table.required("id")?);
    let mut logs = Vec::new();
    for wanted in 1..=9_u32 {
        let rows: Vec<usize> =
            (0..t.len()).filter(|&k| (id[k] - f64::from(wanted)).abs() < 0.5 && t[k].is_finite()).collect();
        if rows.len() < 60 {
            continue;
        }
        let pick = |name| table.required(name).map(|c| rows.iter().map(|&k| c[k]).collect::<Vec<f64>>());
        let times: Vec<f64> = rows.iter().map(|&k| t[k]).collect();
        if let Some(row) = times.windows(2).position(|pair| pair[1] <= pair[0]) {
            let file = table.file().to_owned();
            return Err(CaseError::TimeGoesBack { row: row + 2, t: times[row + 1], before: times[row], file });
        }
        stamps::shorter(times[times.len() - 1] - times[0], table)?;
        let step_secs = 0.1;
        let samples = ((times[times.len() - 1] - times[0]) / step_secs + 1e-6).floor() as usize + 1;
        let (v, gap, v_lead) = (pick("v")?, pick("gap")?, pick("v_lead")?);
        if [&v, &gap, &v_lead].iter().any(|c| c.iter().all(|value| value.is_nan())) {
            continue;
        }
        let even = |column: &[f64]| lines(&times, column, times[0], step_secs, samples);
        logs.push(FollowerLog {
            id: wanted,
            start_secs: times[0],
            step_secs,
            v: even(&v),
            gap: even(&gap),
            v_lead: even(&v_lead),
        });
    }
    Ok(logs)
}
