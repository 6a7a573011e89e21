//! Sensor logs: poses of the ego, boxes of each lidar sweep (10 Hz) in the ego frame of that sweep, the front camera.
//!
//! The ego frame lies on the rear axle and is lowered to the ground. Without annotations the ego and the map are left.
//! Pictures of the data set are free of distortion, so that the distortion of the lenses is not read.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use ds_scenario::MAX_TICKS;
use ds_scenario::Warning;
use ds_space::{CameraId, CameraModel, DQuat, DVec3, Intrinsics, Pose};
use ds_world::{Scene, VehicleParameters};

use super::table::Table;
use super::{TABLES, class, find, left_out, map_of, origin, prompt};
use crate::error::ImportError;
use crate::recorded::{RawBox, RawDrive, SLACK_TICKS, Stand, stand};
use crate::scene::{safe_name, usual_camera};

/// Height of the ego frame above the ground, in metres: the middle one over poses and lane boundaries beside them.
const AXLE_HEIGHT_M: f64 = 0.32;
const CAMERA: &str = "ring_front_center";
const TICK_SECS: f64 = 0.1;
/// How far in time a sweep may lie from the poses, in seconds.
const APART_SECS: f64 = 0.1;
const POSE: [&str; 7] = ["qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m"];

/// Reads the scene of a log with its table of ego poses.
pub(super) fn scene(log: &Path, poses: &Path, notes: &mut Vec<Warning>) -> Result<Scene, ImportError> {
    let table = Table::read(poses, &[&["timestamp_ns"][..], &POSE].concat())?;
    let times = table.numbers("timestamp_ns")?;
    let mut stamped: Vec<(f64, (DVec3, DQuat))> = times.into_iter().zip(table.poses()?).collect();
    stamped.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (Some((zero, (start, _))), Some((end, _))) = (stamped.first().copied(), stamped.last().copied()) else {
        return Err(table.fault("timestamp_ns", "has no rows"));
    };
    let moved = start.truncate().round();
    let secs = |time: f64| (time - zero) * 1e-9;
    let stands = stamped.into_iter().map(|(time, (position, rotation))| Stand {
        secs: secs(time),
        position: position - moved.extend(0.0) - rotation * DVec3::Z * AXLE_HEIGHT_M,
        rotation,
    });
    let stands: Vec<Stand> = stands.collect();
    let key_frames = if let Some(annotations) = find(log, &["."], "annotations", &TABLES) {
        boxes(&Table::read(&annotations, &BOX)?, &stands, &secs, notes)?
    } else {
        let message = "there are none; the scene has the ego and the map alone".to_owned();
        notes.push(Warning { at: "annotations".to_owned(), message });
        let count = (secs(end) / TICK_SECS + SLACK_TICKS).floor().min(MAX_TICKS as f64) as usize;
        (0..=count).map(|tick| (tick as f64 * TICK_SECS, Vec::new())).collect()
    };
    let (map, map_file) = map_of(log, moved, notes)?;
    let name = log.canonicalize().unwrap_or_else(|_unresolved| log.to_owned());
    let drive = RawDrive {
        name: safe_name(&name.file_name().unwrap_or_default().to_string_lossy()),
        stands,
        key_frames,
        cameras: vec![camera(log)?],
        pictures: Vec::new(),
        map,
        vehicle: VehicleParameters::FUSION,
        prompt: prompt(&map_file.file_name().unwrap_or_default().to_string_lossy()),
        origin: origin("sensor"),
        tick_secs: None,
        notes: Vec::new(),
    };
    Ok(drive.recorded(log)?.scene)
}

const BOX: [&str; 13] = [
    "timestamp_ns",
    "track_uuid",
    "category",
    "length_m",
    "width_m",
    "height_m",
    "qw",
    "qx",
    "qy",
    "qz",
    "tx_m",
    "ty_m",
    "tz_m",
];

/// Returns the boxes of each sweep, in the city.
fn boxes(
    table: &Table,
    stands: &[Stand],
    secs: &dyn Fn(f64) -> f64,
    notes: &mut Vec<Warning>,
) -> Result<Vec<(f64, Vec<RawBox>)>, ImportError> {
    let times: Vec<f64> = table.numbers("timestamp_ns")?.into_iter().map(secs).collect();
    let (tracks, categories) = (table.texts("track_uuid")?, table.texts("category")?);
    let (sizes, poses) = (table.vectors(["length_m", "width_m", "height_m"])?, table.poses()?);
    let mut order: Vec<usize> = (0..table.rows).collect();
    order.sort_by(|a, b| times[*a].total_cmp(&times[*b]));
    let (mut unknown, mut sweeps) = (BTreeMap::<String, BTreeSet<&str>>::new(), Vec::new());
    for sweep in order.chunk_by(|a, b| times[*a] == times[*b]) {
        let at = times[sweep[0]];
        let stand = stand(stands, at);
        let apart = (stands[0].secs - at).max(at - stands[stands.len() - 1].secs);
        if apart > APART_SECS {
            let problem = format!("lies {apart:.3} s outside of the ego poses");
            return Err(table.fault(format!("timestamp_ns[{}]", sweep[0]), problem));
        }
        let (mut seen, mut raw) = (BTreeSet::new(), Vec::new());
        for row in sweep.iter().copied() {
            if !seen.insert(tracks[row].as_str()) {
                let problem = format!("{:?} has two boxes in one sweep", tracks[row]);
                return Err(table.fault(format!("track_uuid[{row}]"), problem));
            }
            if let Some(name) =
                ["length_m", "width_m", "height_m"].iter().zip(sizes[row]).find(|(_, size)| *size <= 0.0)
            {
                return Err(table.fault(format!("{}[{row}]", name.0), format!("is {}, not above 0", name.1)));
            }
            let Some(class) = class(&categories[row]) else {
                unknown.entry(categories[row].clone()).or_default().insert(&tracks[row]);
                continue;
            };
            let (position, rotation) = poses[row];
            raw.push(RawBox {
                instance: tracks[row].clone(),
                class,
                size_m: sizes[row],
                centre: stand.position + stand.rotation * (position + DVec3::Z * AXLE_HEIGHT_M),
                rotation: stand.rotation * rotation,
            });
        }
        sweeps.push((at, raw));
    }
    left_out("annotations", unknown.into_iter().map(|(kind, tracks)| (kind, tracks.len())).collect(), notes);
    Ok(sweeps)
}

/// Returns the front camera of the ring, or the usual one if the log has no calibration.
fn camera(log: &Path) -> Result<CameraModel, ImportError> {
    let folders = ["calibration", "."];
    let files = ["intrinsics", "egovehicle_SE3_sensor"].map(|stem| find(log, &folders, stem, &TABLES));
    let [Some(intrinsics), Some(mounting)] = files else { return Ok(usual_camera()) };
    let lens = ["fx_px", "fy_px", "cx_px", "cy_px", "width_px", "height_px"];
    let intrinsics = Table::read(&intrinsics, &[&["sensor_name"][..], &lens].concat())?;
    let mounting = Table::read(&mounting, &[&["sensor_name"][..], &POSE].concat())?;
    let row = |table: &Table| {
        let row = table.texts("sensor_name")?.iter().position(|name| name == CAMERA);
        row.ok_or_else(|| table.fault("sensor_name", format!("has no {CAMERA:?}")))
    };
    let [fx_px, fy_px, cx_px, cy_px, width, height] = intrinsics.vectors(lens)?[row(&intrinsics)?];
    let (position, rotation) = mounting.poses()?[row(&mounting)?];
    Ok(CameraModel {
        id: CameraId::new(CAMERA).expect("a plain word is an id"),
        intrinsics: Intrinsics {
            width_px: width as u32,
            height_px: height as u32,
            fx_px,
            fy_px,
            cx_px,
            cy_px,
            k1: 0.0,
            k2: 0.0,
        },
        rig_from_camera: Pose::new(rotation, position + DVec3::Z * AXLE_HEIGHT_M),
    })
}
