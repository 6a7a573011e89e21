//! Vehicle logs of runs as cases: `meta.json` with the nominal car beside one MCAP file per drive, and the case folder
//! made of them.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use ds_record::{Recording, vehicle_log};
use ds_sim::IdmParameters;
use ds_space::CameraModel;
use ds_world::{Reading, VehicleParameters};
use serde_json::{Value, json};

use super::stamps;
use crate::command::gap::scenes;

const HEAD: &str = "t,cmd_steer,cmd_accel,x,y,yaw,v,yaw_rate,ax,ay,steer_meas,v_wheel";

/// Extracts the vehicle logs of recorded drives to a folder, with the nominal car beside them.
pub(crate) fn extract(recordings: &[PathBuf], folder: &Path) -> Result<()> {
    let mut drives = Vec::new();
    let (mut nominal, mut cameras) = (Value::Null, Value::Null);
    let mut traffic = (Value::Null, Value::Null);
    for path in recordings {
        let recording = Recording::open(path)?;
        let name = format!("{}.mcap", recording.scene().spec.scenario);
        vehicle_log::write(&recording, &folder.join(&name))?;
        drives.push(json!({ "file": name }));
        let message = recording.scene();
        nominal = describe(&message.scene.vehicle);
        cameras = message.scene.cameras.iter().map(camera).collect();
        traffic = scenes::settings(&message.spec, message.scene.dt.secs());
    }
    let (agents, from_secs) = traffic;
    let meta = json!({
        "drives": drives, "channels_missing": [], "nominal": nominal, "cameras": cameras, "agents": agents,
        "from_secs": from_secs,
    });
    let path = folder.join("meta.json");
    std::fs::write(&path, serde_json::to_string_pretty(&meta)? + "\n")
        .with_context(|| format!("write {}", path.display()))
}

fn camera(camera: &CameraModel) -> Value {
    let lens = &camera.intrinsics;
    json!({
        "name": camera.id.as_str(),
        "width": lens.width_px,
        "height": lens.height_px,
        "fx": lens.fx_px,
        "fy": lens.fy_px,
        "cx": lens.cx_px,
        "cy": lens.cy_px,
        "height_m": camera.rig_from_camera.translation.z,
    })
}

/// Describes the nominal car as a case's `meta.json` does.
fn describe(vehicle: &VehicleParameters) -> Value {
    let idm = IdmParameters::default();
    let plant = ds_sim::nominal(vehicle, &idm);
    let car = &plant.vehicle;
    json!({
        "model": "linear_single_track",
        "mass": car.mass_kg,
        "yaw_inertia": car.yaw_inertia_kg_m2,
        "lf": car.front_arm_m,
        "lr": car.rear_arm_m,
        "cornering_stiffness_front": car.front_stiffness_n,
        "cornering_stiffness_rear": car.rear_stiffness_n,
        "steer_lag": plant.steering.lag_secs,
        "accel_lag": plant.traction.lag_secs,
        "rolling_decel": car.rolling_mps2,
        "drag_decel_per_v2": car.drag_n_s2_m2 / car.mass_kg,
        "friction": car.friction,
        "idm": {
            "headway": plant.follower.headway_secs,
            "min_gap": plant.follower.min_gap_m,
            "max_accel": plant.follower.max_accel_mps2,
            "comfort_decel": plant.follower.comfort_decel_mps2,
            "exponent": plant.follower.exponent,
        },
    })
}

/// Tells whether a folder holds vehicle logs instead of tables.
pub(crate) fn are_logs(folder: &Path) -> bool {
    read_meta(folder).is_ok_and(|meta| files(&meta).iter().any(|file| file.ends_with(".mcap")))
}

/// Returns the names of the drives of a folder of vehicle logs, without their ending.
pub(crate) fn drives(folder: &Path) -> Result<Vec<String>> {
    Ok(files(&read_meta(folder)?).iter().map(|file| file.trim_end_matches(".mcap").to_owned()).collect())
}

/// Makes a case folder of vehicle logs: tables instead of MCAP files; `held_out` names drives kept from the fit, the
/// last of several without.
pub(crate) fn case(folder: &Path, held_out: &[String], out: &Path) -> Result<()> {
    let mut meta = read_meta(folder)?;
    std::fs::create_dir_all(out).with_context(|| format!("create {}", out.display()))?;
    let names = files(&meta);
    ensure!(!names.is_empty(), "{} lists no drives", folder.display());
    let (mut drives, mut fit, mut kept) = (Vec::new(), Vec::new(), Vec::new());
    for (index, name) in names.iter().enumerate() {
        let table = format!("{}.csv", name.trim_end_matches(".mcap"));
        let log = vehicle_log::read(&folder.join(name))?;
        self::table(&log.readings, &out.join(&table))?;
        stamps::write(&log.plans, &out.join(format!("{}.plans.csv", name.trim_end_matches(".mcap"))))?;
        drives.push(json!({ "file": table }));
        let held = held_out.iter().any(|drive| drive == name.trim_end_matches(".mcap"));
        if held { kept.push(index) } else { fit.push(index) }
    }
    if kept.is_empty() && fit.len() > 1 {
        kept.extend(fit.pop());
    }
    meta["drives"] = Value::Array(drives);
    meta["suggested_split"] = json!({ "fit": fit, "held_out": kept });
    let path = out.join("meta.json");
    std::fs::write(&path, serde_json::to_string_pretty(&meta)? + "\n")
        .with_context(|| format!("write {}", path.display()))
}

/// Makes a case folder of the last readings of one drive, under the name of the case.
pub(crate) fn window(readings: &[Reading], vehicle: &VehicleParameters, case: &str, out: &Path) -> Result<()> {
    std::fs::create_dir_all(out).with_context(|| format!("create {}", out.display()))?;
    table(readings, &out.join("drive.csv"))?;
    let drives = json!([{ "file": "drive.csv" }]);
    let meta = json!({ "case": case, "drives": drives, "channels_missing": [], "nominal": describe(vehicle) });
    let path = out.join("meta.json");
    std::fs::write(&path, meta.to_string()).with_context(|| format!("write {}", path.display()))
}

fn table(readings: &[Reading], out: &Path) -> Result<()> {
    let mut text = String::from(HEAD);
    text.push('\n');
    for reading in readings {
        let row: Vec<String> = reading.to_array().iter().map(f64::to_string).collect();
        writeln!(text, "{}", row.join(","))?;
    }
    std::fs::write(out, text).with_context(|| format!("write {}", out.display()))
}

pub(crate) fn read_meta(folder: &Path) -> Result<Value> {
    let path = folder.join("meta.json");
    let text = std::fs::read_to_string(&path).with_context(|| format!("read {}", path.display()))?;
    serde_json::from_str(&text).with_context(|| format!("{} is no JSON", path.display()))
}

fn files(meta: &Value) -> Vec<String> {
    let drives = meta["drives"].as_array().map(Vec::as_slice).unwrap_or_default();
    drives.iter().filter_map(|drive| drive["file"].as_str().map(str::to_owned)).collect()
}
