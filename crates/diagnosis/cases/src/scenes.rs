//! Vehicle logs with the scenes that were driven, as a case of recorded traffic: the tracks of others in the world, from
//! what the car saw of them and from its own pose.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use ds_diagnosis::meta::{Drivers, RecordingEntry, TrafficMeta, VehicleMeta};
use ds_record::vehicle_log::{self, VehicleLog};
use ds_space::{DVec2, PoseSe2};
use ds_world::{AgentMode, Reading, VehicleParameters};

use crate::error::{CasesError, at};
use crate::logs;

/// Makes a case of the logs in a folder whose scene files are given; `false` if none of them is.
///
/// # Errors
/// If agents did not decide for themselves, a log or scene is refused, or a file cannot be written.
pub fn case(folder: &Path, scenes: &[PathBuf], out: &Path) -> Result<bool, CasesError> {
    let meta = VehicleMeta::read(folder)?;
    let interactive = match meta.agents.as_deref().and_then(AgentMode::from_name) {
        Some(AgentMode::IdmAll) => false,
        Some(AgentMode::Interactive) | None => true,
        Some(mode) => return Err(CasesError::Scripted { agents: mode.name() }),
    };
    std::fs::create_dir_all(out).map_err(at(out))?;
    let drives = logs::drives(folder)?;
    let mut recordings = Vec::new();
    for file in scenes {
        let (scene, _) = ds_scenario::load(file)?;
        if !drives.contains(&scene.name) {
            continue;
        }
        let log = vehicle_log::read(&logs::file(folder, &scene.name))?;
        let tracks = PathBuf::from(format!("{}.csv", scene.name));
        let path = out.join(&tracks);
        std::fs::write(&path, table(&log, &scene.vehicle)).map_err(at(&path))?;
        let scene = file.canonicalize().map_err(at(file))?;
        let from_secs = meta.from_secs.unwrap_or_default();
        recordings.push(RecordingEntry { scene, tracks: Some(tracks), from_secs });
    }
    if recordings.is_empty() {
        return Ok(false);
    }
    let nominal = Drivers { interactive: Some(interactive), ..Drivers::default() };
    TrafficMeta { recordings, nominal, ..TrafficMeta::default() }.write(out)?;
    Ok(true)
}

/// Returns the tracks as a table; the car itself has id -1.
fn table(log: &VehicleLog, vehicle: &VehicleParameters) -> String {
    let mut text = String::from("t,id,x,y,yaw,v\n");
    let arm_m = 0.5 * vehicle.wheel_base_m;
    for seen in &log.detections {
        let Some((gravity, speed_mps)) = pose(&log.readings, seen.t) else { continue };
        let rear = PoseSe2 { position: gravity.to_outer(DVec2::new(-arm_m, 0.0)), ..gravity };
        let centre = rear.to_outer(DVec2::new(vehicle.rear_axle_to_centre_m, 0.0));
        let _infallible = writeln!(text, "{},-1,{},{},{},{}", seen.t, centre.x, centre.y, rear.heading_rad, speed_mps);
        for other in &seen.objects {
            let at = rear.to_outer(DVec2::new(other.x, other.y));
            let heading_rad = rear.heading_rad + other.yaw;
            let _infallible = writeln!(text, "{},{},{},{},{},{}", seen.t, other.id, at.x, at.y, heading_rad, other.v);
        }
    }
    text
}

/// Returns pose and speed of the car at a time, along the line through the two samples next to it.
fn pose(readings: &[Reading], secs: f64) -> Option<(PoseSe2, f64)> {
    let after = readings.partition_point(|reading| reading.secs < secs).clamp(1, readings.len().max(2) - 1);
    let (a, b) = (readings.get(after - 1)?, readings.get(after)?);
    let share = ((secs - a.secs) / (b.secs - a.secs).max(1e-6)).clamp(-2.0, 2.0);
    let between = |a: f64, b: f64| a + share * (b - a);
    let heading_rad = a.yaw_rad + share * ds_space::angle::turn(a.yaw_rad, b.yaw_rad);
    let position = DVec2::new(between(a.x_m, b.x_m), between(a.y_m, b.y_m));
    Some((PoseSe2 { position, heading_rad }, between(a.speed_mps, b.speed_mps)))
}
