//! Writes a case folder of the practice schema from a mapping and its logs.

use std::fmt::Write as _;
use std::path::Path;

use crate::channel::CHANNELS;
use crate::echo;
use crate::error::LogError;
use crate::mapping::{Mapping, ModelKind, NominalModel};
use crate::record::{Record, SHORTEST_SECS};
use crate::strata;
use ds_diagnosis::CaseError;
use ds_diagnosis::meta::{DriveEntry, Idm, Nominal, SINGLE_TRACK, Split, VehicleMeta};
use ds_diagnosis::table::STEP_SECS;

/// Standard gravity, m/s².
const GRAVITY: f64 = 9.81;
/// Cornering stiffness over static load of a passenger car's front and rear axle, 1/rad.
const USUAL_STIFFNESS: (f64, f64) = (12.0, 13.5);
/// The same for wheels that do not slip.
const NO_SLIP: f64 = 400.0;
/// Stiffest axle that a case may have, N/rad.
const STIFFEST: f64 = 4.9e6;

/// Length of the drives into which a log is cut that is too long to be taken whole, s.
const LONG_PIECE_SECS: f64 = 60.0;

/// What a case was made of.
#[derive(Debug)]
pub struct Imported {
    /// The drives written.
    pub drives: Vec<Record>,
    /// How many the logs hold; more than were written where that is more than a diagnosis takes.
    pub offered: usize,
}

impl Mapping {
    /// Writes `drive_k.csv` and `meta.json` into `out` from the logs in a folder.
    ///
    /// # Errors
    /// If a log cannot be read, a command is a measurement, nothing usable is in the logs, or the folder cannot be written.
    pub fn case(&self, logs: &Path, out: &Path) -> Result<Imported, LogError> {
        let mut stretches: Vec<(Record, bool)> = Vec::new();
        for file in self.listed()? {
            let log = self.open(logs, file)?;
            if let Some(echo) = echo::findings(&log).pop() {
                return Err(LogError::Echo(echo));
            }
            stretches.extend(self.records(&log)?.into_iter().map(|record| (record, file.held_out)));
        }
        let long = stretches.iter().map(|(record, _)| record.secs()).sum::<f64>() > strata::MOST_SECS;
        let secs = self.log.piece_secs.or(long.then_some(LONG_PIECE_SECS));
        let cut = |(record, held): (Record, bool)| pieces(record, secs).into_iter().map(move |r| (r, held));
        let mut drives: Vec<(Record, bool)> = stretches.into_iter().flat_map(cut).collect();
        drives.retain(|(record, _)| self.moves(record));
        if drives.is_empty() {
            let file = self.drive.first().map(|d| d.file.clone()).unwrap_or_default();
            return Err(LogError::Empty { secs: SHORTEST_SECS, file });
        }
        let offered = drives.len();
        let kept = strata::chosen(&drives.iter().map(|(record, _)| record).collect::<Vec<_>>());
        let mut place = 0;
        drives.retain(|_| {
            place += 1;
            kept.binary_search(&(place - 1)).is_ok()
        });
        std::fs::create_dir_all(out).map_err(|source| CaseError::Write { path: out.to_path_buf(), source })?;
        let write = |name: &str, text: String| {
            let path = out.join(name);
            std::fs::write(&path, text).map_err(|source| LogError::from(CaseError::Write { path, source }))
        };
        for (k, (record, _)) in drives.iter().enumerate() {
            write(&format!("drive_{k}.csv"), self.table(record))?;
        }
        self.meta(&drives).write(out)?;
        Ok(Imported { drives: drives.into_iter().map(|(record, _)| record).collect(), offered })
    }

    fn moves(&self, record: &Record) -> bool {
        let mut speed = record.speed().unwrap_or_default();
        !speed.is_empty() && ds_stats::quantile(&mut speed, 0.5) >= self.log.least_speed_mps
    }

    /// Tells whether a channel may stand in the case: measured itself, and no command computed from it.
    fn independent(&self, record: &Record, name: &str) -> bool {
        let spent = |command: &str| self.channels.get(command).and_then(|s| s.derived_from.as_deref());
        let command = name.starts_with("cmd_");
        // both speeds tell of the motion that the drive command was computed from
        let speeds = ["v", "v_wheel", "ax"];
        let used = spent("cmd_accel").is_some() && speeds.contains(&name);
        command || !(record.derived.contains(&name) || used)
    }

    fn table(&self, record: &Record) -> String {
        let kept: Vec<_> = CHANNELS
            .into_iter()
            .filter(|c| self.independent(record, c.name))
            .filter_map(|c| record.channel(c.name).map(|column| (c, column)))
            .collect();
        let mut text = String::from("t");
        for (channel, _) in &kept {
            text += ",";
            text += channel.name;
        }
        for k in 0..record.samples() {
            let _infallible = write!(text, "\n{:.3}", record.start_secs + k as f64 * STEP_SECS);
            for (channel, column) in &kept {
                let _infallible = write!(text, ",{:.*}", channel.places, column[k]);
            }
        }
        text + "\n"
    }

    fn meta(&self, drives: &[(Record, bool)]) -> VehicleMeta {
        let flagged = drives.iter().any(|(_, held)| *held);
        // without a choice of the user every fourth drive is kept back
        let held = |k: usize| if flagged { drives[k].1 } else { drives.len() > 1 && k % 4 == 3.min(drives.len() - 1) };
        let (held_out, fit): (Vec<usize>, Vec<usize>) = (0..drives.len()).partition(|k| held(*k));
        let first = &drives[0].0;
        let there = |name: &str| first.channel(name).is_some() && self.independent(first, name);
        let missing = CHANNELS.iter().map(|c| c.name).filter(|name| !there(name));
        let entry = |(k, (record, _)): (usize, &(Record, bool))| DriveEntry {
            file: format!("drive_{k}.csv"),
            log: Some(record.file.clone()),
            from_secs: Some(record.start_secs),
            ..DriveEntry::default()
        };
        VehicleMeta {
            case: self.log.name.clone(),
            channels_missing: missing.map(str::to_owned).collect(),
            channels_derived: first.derived.iter().map(|name| (*name).to_owned()).collect(),
            rate_hz: Some(1.0 / STEP_SECS),
            suggested_split: Some(Split { fit, held_out }),
            ..VehicleMeta::new(drives.iter().enumerate().map(entry).collect(), self.nominal.entries())
        }
    }
}

/// Cuts a stretch into drives of so many seconds.
fn pieces(record: Record, secs: Option<f64>) -> Vec<Record> {
    let Some(secs) = secs else { return vec![record] };
    let size = ((secs.max(SHORTEST_SECS) + 0.5) / STEP_SECS) as usize;
    let cuts = (0..record.samples()).step_by(size).map(|k| k..(k + size).min(record.samples()));
    cuts.filter(|r| r.len() as f64 * STEP_SECS > SHORTEST_SECS).map(|r| record.cut(r)).collect()
}

impl NominalModel {
    /// Returns the nominal simulator as `meta.json` writes it: the single track, its tyres so stiff that they do not slip
    /// where the model is kinematic.
    fn entries(&self) -> Nominal {
        let (lf, lr) = self.arms_m();
        let load = |arm: f64| self.mass * GRAVITY * arm / (lf + lr);
        let (usual_front, usual_rear, friction) = match self.model {
            ModelKind::Kinematic => (NO_SLIP, NO_SLIP, 4.0),
            ModelKind::Linear | ModelKind::LinearSingleTrack => (USUAL_STIFFNESS.0, USUAL_STIFFNESS.1, self.friction),
        };
        let given = |stiffness: Option<f64>| stiffness.filter(|_| self.model != ModelKind::Kinematic);
        let front = given(self.cornering_stiffness_front).unwrap_or_else(|| (usual_front * load(lr)).min(STIFFEST));
        let rear = given(self.cornering_stiffness_rear).unwrap_or_else(|| (usual_rear * load(lf)).min(STIFFEST));
        Nominal {
            model: SINGLE_TRACK.to_owned(),
            mass: self.mass,
            yaw_inertia: self.yaw_inertia.unwrap_or(self.mass * lf * lr),
            lf,
            lr,
            cornering_stiffness_front: front,
            cornering_stiffness_rear: rear,
            steer_lag: self.steer_lag,
            accel_lag: self.accel_lag,
            rolling_decel: self.rolling_decel,
            drag_decel_per_v2: self.drag_decel_per_v2,
            friction,
            idm: Idm::default(),
        }
    }
}
