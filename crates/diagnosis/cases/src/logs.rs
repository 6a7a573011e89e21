//! Vehicle logs of runs as cases: `meta.json` with the nominal car beside one MCAP file per drive, read as they are or made
//! into a case folder; the last readings of one drive as a case in memory.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use ds_diagnosis::CaseError;
use ds_diagnosis::meta::{CameraEntry, DriveEntry, Nominal, Split, VehicleMeta};
use ds_diagnosis::table::Table;
use ds_dynamics::drive::Drive;
use ds_record::Recording;
use ds_record::vehicle_log::{self, Planned};
use ds_sim::IdmParameters;
use ds_space::CameraModel;
use ds_world::{Reading, VehicleParameters};

use crate::error::{CasesError, at};
use crate::stamps;

const COLUMNS: [&str; 12] =
    ["t", "cmd_steer", "cmd_accel", "x", "y", "yaw", "v", "yaw_rate", "ax", "ay", "steer_meas", "v_wheel"];
const ENDING: &str = ".mcap";

/// Extracts the vehicle logs of recorded drives to a folder, with the nominal car beside them; `simulated` where they are of
/// the built-in simulator.
///
/// # Errors
/// If a recording is refused or a file cannot be written.
pub fn extract(recordings: &[PathBuf], simulated: bool, folder: &Path) -> Result<(), CasesError> {
    let mut drives = Vec::new();
    let mut described = None;
    for path in recordings {
        let recording = Recording::open(path)?;
        let message = recording.scene();
        let file = format!("{}{ENDING}", message.spec.scenario);
        vehicle_log::write(&recording, &folder.join(&file))?;
        drives.push(DriveEntry { file, ..DriveEntry::default() });
        let warm_up = message.spec.warm_up * message.spec.replan_period;
        described = Some(VehicleMeta {
            simulated,
            cameras: message.scene.cameras.iter().map(camera).collect(),
            agents: Some(message.spec.agents.name().to_owned()),
            from_secs: Some(f64::from(warm_up) * message.scene.dt.secs()),
            ..VehicleMeta::new(Vec::new(), nominal(&message.scene.vehicle))
        });
    }
    let Some(meta) = described else { return Ok(()) };
    Ok(VehicleMeta { drives, ..meta }.write(folder)?)
}

fn camera(camera: &CameraModel) -> CameraEntry {
    let lens = &camera.intrinsics;
    CameraEntry {
        name: camera.id.as_str().to_owned(),
        width: lens.width_px,
        height: lens.height_px,
        fx: lens.fx_px,
        fy: lens.fy_px,
        cx: lens.cx_px,
        cy: lens.cy_px,
        height_m: camera.rig_from_camera.translation.z,
    }
}

fn nominal(vehicle: &VehicleParameters) -> Nominal {
    Nominal::of(&ds_sim::nominal(vehicle, &IdmParameters::default()))
}

/// Tells whether a folder holds vehicle logs instead of tables.
#[must_use]
pub fn are_logs(folder: &Path) -> bool {
    VehicleMeta::read(folder).is_ok_and(|meta| meta.drives.iter().any(|drive| drive.file.ends_with(ENDING)))
}

/// Returns the names of the drives of a folder of vehicle logs.
///
/// # Errors
/// If its description cannot be read.
pub fn drives(folder: &Path) -> Result<Vec<String>, CasesError> {
    Ok(VehicleMeta::read(folder)?.drives.iter().map(|drive| stem(&drive.file).to_owned()).collect())
}

/// Returns the log of a drive in a folder of vehicle logs.
#[must_use]
pub fn file(folder: &Path, drive: &str) -> PathBuf {
    folder.join(format!("{drive}{ENDING}"))
}

fn stem(file: &str) -> &str {
    file.trim_end_matches(ENDING)
}

/// Reads vehicle logs as the case that [`case`] makes of them, under a name, with the stamps of the policy's answers.
///
/// # Errors
/// If there are no drives, or a log is refused or makes no sense.
pub fn read(folder: &Path, name: &str) -> Result<(ds_dynamics::case::Case, Vec<Planned>), CasesError> {
    let mut meta = described(folder)?;
    let (mut drives, mut plans) = (Vec::new(), Vec::new());
    for entry in &mut meta.drives {
        let log = vehicle_log::read(&folder.join(&entry.file))?;
        *entry = tabled(stem(&entry.file));
        drives.push(drive(&log.readings, entry)?);
        plans.extend(log.plans);
    }
    meta.suggested_split = Some(split(&meta, &[]));
    name.clone_into(&mut meta.case);
    Ok((ds_dynamics::case::Case::new(meta, drives)?, plans))
}

fn described(folder: &Path) -> Result<VehicleMeta, CasesError> {
    let meta = VehicleMeta::read(folder)?;
    if meta.drives.is_empty() {
        return Err(CasesError::NoDrives { path: folder.to_path_buf() });
    }
    Ok(meta)
}

fn tabled(name: &str) -> DriveEntry {
    DriveEntry { file: format!("{name}.csv"), ..DriveEntry::default() }
}

/// Returns which drives are fitted: all but those named, or the last of several.
fn split(meta: &VehicleMeta, held_out: &[String]) -> Split {
    let held = |index: &usize| held_out.iter().any(|name| format!("{name}.csv") == meta.drives[*index].file);
    let (held_out, mut fit): (Vec<usize>, Vec<usize>) = (0..meta.drives.len()).partition(held);
    let mut split = Split { fit: Vec::new(), held_out };
    if split.held_out.is_empty() && fit.len() > 1 {
        split.held_out.extend(fit.pop());
    }
    Split { fit, ..split }
}

/// Makes a case folder of vehicle logs: tables instead of MCAP files; `held_out` names drives kept from the fit, the
/// last of several without.
///
/// # Errors
/// If there are no drives, a log is refused or a file cannot be written.
pub fn case(folder: &Path, held_out: &[String], out: &Path) -> Result<(), CasesError> {
    let mut meta = described(folder)?;
    std::fs::create_dir_all(out).map_err(at(out))?;
    for drive in &mut meta.drives {
        let name = stem(&drive.file).to_owned();
        let log = vehicle_log::read(&folder.join(&drive.file))?;
        *drive = tabled(&name);
        let path = out.join(&drive.file);
        std::fs::write(&path, text(&log.readings)).map_err(at(&path))?;
        stamps::write(&log.plans, out, &name)?;
    }
    meta.case.clear();
    meta.suggested_split = Some(split(&meta, held_out));
    Ok(meta.write(out)?)
}

fn text(readings: &[Reading]) -> String {
    let mut text = COLUMNS.join(",");
    text.push('\n');
    for reading in readings {
        let row: Vec<String> = reading.to_array().iter().map(f64::to_string).collect();
        let _infallible = writeln!(text, "{}", row.join(","));
    }
    text
}

/// Makes a case of the last readings of one drive, under the name of the case.
///
/// # Errors
/// If the readings make no sense.
pub fn window(
    readings: &[Reading],
    vehicle: &VehicleParameters,
    case: &str,
) -> Result<ds_dynamics::case::Case, CaseError> {
    case_of(readings, meta(vehicle, case))
}

/// Returns the description of a drive of a car, under the name of the case, without the drive.
#[must_use]
pub fn meta(vehicle: &VehicleParameters, case: &str) -> VehicleMeta {
    VehicleMeta { case: case.to_owned(), ..VehicleMeta::new(Vec::new(), nominal(vehicle)) }
}

/// Makes a case of readings of one drive, as described.
///
/// # Errors
/// If the readings make no sense.
pub fn case_of(readings: &[Reading], meta: VehicleMeta) -> Result<ds_dynamics::case::Case, CaseError> {
    let entry = tabled("drive");
    let drive = drive(readings, &entry)?;
    let meta = VehicleMeta { drives: vec![entry], suggested_split: None, ..meta };
    meta.check()?;
    ds_dynamics::case::Case::new(meta, vec![drive])
}

fn drive(readings: &[Reading], entry: &DriveEntry) -> Result<Drive, CaseError> {
    let rows: Vec<[f64; 12]> = readings.iter().map(Reading::to_array).collect();
    let column = |k: usize| rows.iter().map(|row| row[k]).collect();
    let columns = COLUMNS.iter().enumerate().map(|(k, name)| ((*name).to_owned(), column(k))).collect();
    Drive::new(&Table::new(&entry.file, columns)?, None, entry)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_in_memory_is_the_case_that_a_folder_would_be() {
        let reading = |k: u32| {
            let t = f64::from(k) * 0.05;
            let yaw = 0.2 * (0.7 * t).sin();
            Reading {
                secs: t,
                x_m: 8.0 * t,
                y_m: 0.3 * (0.5 * t).sin(),
                yaw_rad: yaw,
                speed_mps: 8.0 + 0.1 * t.sin(),
                yaw_rate_radps: 0.14 * (0.7 * t).cos(),
                steering_rad: 0.05 * (0.7 * t).cos(),
                wheel_speed_mps: 8.0 + 0.1 * t.sin(),
                ax_mps2: 0.1 * t.cos(),
                ay_mps2: 1.12 * (0.7 * t).cos(),
                cmd_steer_rad: 0.05 * (0.7 * t).cos(),
                cmd_accel_mps2: 0.1 * t.cos(),
            }
        };
        let readings: Vec<Reading> = (0..200).map(reading).collect();
        let vehicle = VehicleParameters::PACIFICA;
        let memory = window(&readings, &vehicle, "w").expect("a case");
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("drive.csv"), text(&readings)).expect("it can be written");
        memory.meta.write(folder.path()).expect("it can be written");
        let read = ds_dynamics::case::Case::read(folder.path()).expect("a case");
        assert_eq!(memory.meta, read.meta);
        assert_eq!(format!("{:?}", memory.drives), format!("{:?}", read.drives));
        assert_eq!(memory.warnings, read.warnings);
    }
}
