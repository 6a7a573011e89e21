//! Vehicle logs with the scenes that were driven, as a case of recorded traffic: the tracks of others in the world, from
//! what the car saw of them and from its own pose.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use ds_record::vehicle_log::{self, VehicleLog};
use ds_space::{DVec2, PoseSe2};
use ds_topic::AgentMode;
use ds_world::{Reading, VehicleParameters};
use serde_json::{Value, json};

use crate::command::gap::logs;
use crate::command::scenario;

/// Makes a case of the logs in a folder whose scenes are given; nothing if none of them is.
pub(crate) fn case(folder: &Path, scenes: &[PathBuf], out: &Path) -> Result<bool> {
    let meta = logs::read_meta(folder)?;
    let interactive = match meta["agents"].as_str().and_then(AgentMode::from_name) {
        Some(AgentMode::IdmAll) => false,
        Some(AgentMode::Interactive) | None => true,
        Some(mode) => {
            bail!("agents drove as {:?}: drive with --agents idm-all or interactive to judge them", mode.name())
        }
    };
    std::fs::create_dir_all(out).with_context(|| format!("create {}", out.display()))?;
    let drives = logs::drives(folder)?;
    let mut recordings = Vec::new();
    for file in scenario::files(scenes)? {
        let (scene, _) = ds_scenario::load(&file)?;
        if !drives.contains(&scene.name) {
            continue;
        }
        let log = vehicle_log::read(&folder.join(format!("{}.mcap", scene.name)))?;
        let tracks = format!("{}.csv", scene.name);
        let text = table(&log, &scene.vehicle)?;
        std::fs::write(out.join(&tracks), text).with_context(|| format!("write {tracks}"))?;
        let file = file.canonicalize().with_context(|| format!("find {}", file.display()))?;
        recordings.push(json!({ "scene": file, "tracks": tracks, "from_secs": meta["from_secs"] }));
    }
    if recordings.is_empty() {
        return Ok(false);
    }
    let meta = json!({ "model": "traffic", "recordings": recordings, "nominal": { "interactive": interactive } });
    let path = out.join("meta.json");
    std::fs::write(&path, serde_json::to_string_pretty(&meta)? + "\n")
        .with_context(|| format!("write {}", path.display()))?;
    Ok(true)
}

/// Returns the settings of a drive that a diagnosis of its traffic needs.
pub(crate) fn settings(spec: &ds_topic::EpisodeSpec, dt_secs: f64) -> (Value, Value) {
    let from_secs = f64::from(spec.warm_up * spec.replan_period) * dt_secs;
    (json!(spec.agents.name()), json!(from_secs))
}

/// Returns the tracks as a table; the car itself has id -1.
fn table(log: &VehicleLog, vehicle: &VehicleParameters) -> Result<String> {
    let mut text = String::from("t,id,x,y,yaw,v\n");
    let arm_m = 0.5 * vehicle.wheel_base_m;
    for seen in &log.detections {
        let Some((gravity, speed_mps)) = pose(&log.readings, seen.t) else { continue };
        let rear = PoseSe2 { position: gravity.to_outer(DVec2::new(-arm_m, 0.0)), ..gravity };
        let centre = rear.to_outer(DVec2::new(vehicle.rear_axle_to_centre_m, 0.0));
        writeln!(text, "{},-1,{},{},{},{}", seen.t, centre.x, centre.y, rear.heading_rad, speed_mps)?;
        for other in &seen.objects {
            let at = rear.to_outer(DVec2::new(other.x, other.y));
            writeln!(text, "{},{},{},{},{},{}", seen.t, other.id, at.x, at.y, rear.heading_rad + other.yaw, other.v)?;
        }
    }
    Ok(text)
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
