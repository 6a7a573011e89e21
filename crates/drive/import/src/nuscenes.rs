//! Drives of the nuScenes folder layout: `v1.0-*/*.json` tables, `samples`, `sweeps`, `maps/expansion/*.json`.
//!
//! The tables refer to one another by tokens. Cameras with a sweep at about 12 Hz give ticks at 10 Hz, key frames alone
//! 2 Hz. Quaternions are w, x, y, z; sizes width, length, height; times in microseconds.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use ds_space::{CameraId, CameraModel, DQuat, DVec3, Intrinsics, Pose};
use ds_world::{AgentClass, Map, Origin, VehicleParameters};
use serde::Deserialize;
use serde::de::DeserializeOwned;

use crate::error::ImportError;
use crate::recorded::{RawBox, RawDrive, Recorded, Stand};

mod map;

/// The largest table that is read, in bytes.
const MOST_TABLE_BYTES: u64 = 4 << 30;

#[derive(Deserialize)]
struct SceneRow {
    token: String,
    name: String,
    log_token: String,
    #[serde(default)]
    description: String,
}

#[derive(Deserialize)]
struct LogRow {
    token: String,
    location: String,
}

#[derive(Deserialize)]
struct SampleRow {
    token: String,
    timestamp: f64,
    scene_token: String,
}

#[derive(Deserialize)]
struct DataRow {
    sample_token: String,
    ego_pose_token: String,
    calibrated_sensor_token: String,
    filename: String,
    timestamp: f64,
    #[serde(default)]
    width: u32,
    #[serde(default)]
    height: u32,
}

#[derive(Deserialize)]
struct PoseRow {
    token: String,
    translation: [f64; 3],
    rotation: [f64; 4],
}

#[derive(Deserialize)]
struct CalibrationRow {
    token: String,
    sensor_token: String,
    translation: [f64; 3],
    rotation: [f64; 4],
    #[serde(default)]
    camera_intrinsic: Vec<Vec<f64>>,
}

#[derive(Deserialize)]
struct SensorRow {
    token: String,
    channel: String,
    modality: String,
}

#[derive(Deserialize)]
struct AnnotationRow {
    sample_token: String,
    instance_token: String,
    translation: [f64; 3],
    size: [f64; 3],
    rotation: [f64; 4],
}

#[derive(Deserialize)]
struct InstanceRow {
    token: String,
    category_token: String,
}

#[derive(Deserialize)]
struct CategoryRow {
    token: String,
    name: String,
}

fn quaternion([w, x, y, z]: [f64; 4]) -> DQuat {
    DQuat::from_xyzw(x, y, z, w).normalize()
}

/// Returns the folder of the tables: the one `v1.0-*` folder, or the root itself.
fn tables(root: &Path) -> Result<PathBuf, ImportError> {
    let unreadable = |source| ImportError::Read { path: root.to_owned(), source };
    let mut folders: Vec<PathBuf> = Vec::new();
    for entry in std::fs::read_dir(root).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        if path.join("sample_data.json").is_file() {
            folders.push(path);
        }
    }
    folders.sort();
    match folders.as_slice() {
        _ if root.join("sample_data.json").is_file() => Ok(root.to_owned()),
        [folder] => Ok(folder.clone()),
        found => {
            let problem = format!("{} folders of tables (v1.0-*) are there, one is needed", found.len());
            Err(ImportError::Field { path: root.to_owned(), at: "v1.0-*".to_owned(), problem })
        }
    }
}

fn table<T: DeserializeOwned>(folder: &Path, name: &str) -> Result<Vec<T>, ImportError> {
    let path = folder.join(format!("{name}.json"));
    let unreadable = |source| ImportError::Read { path: path.clone(), source };
    let file = std::fs::File::open(&path).map_err(unreadable)?;
    if file.metadata().map_err(unreadable)?.len() > MOST_TABLE_BYTES {
        return Err(ImportError::TooLarge { path, limit: MOST_TABLE_BYTES });
    }
    let mut reader = serde_json::Deserializer::from_reader(std::io::BufReader::new(file));
    serde_path_to_error::deserialize(&mut reader).map_err(|error| ImportError::Field {
        at: error.path().to_string(),
        problem: error.into_inner().to_string(),
        path: path.clone(),
    })
}

/// Returns the names of the drives of a folder, in order.
///
/// # Errors
/// If the table of scenes cannot be read.
pub fn scenes(root: &Path) -> Result<Vec<String>, ImportError> {
    let mut names: Vec<String> = table::<SceneRow>(&tables(root)?, "scene")?.into_iter().map(|row| row.name).collect();
    names.sort();
    Ok(names)
}

/// Reads one drive.
///
/// # Errors
/// If a table is missing or broken, refers to what is not there, or there is no such drive.
pub fn read(root: &Path, scene: &str) -> Result<Recorded, ImportError> {
    let folder = tables(root)?;
    let missing = |what: &str, token: &str| ImportError::Field {
        path: folder.clone(),
        at: what.to_owned(),
        problem: format!("has no {token:?}"),
    };
    let row = table::<SceneRow>(&folder, "scene")?.into_iter().find(|row| row.name == scene);
    let row = row.ok_or_else(|| missing("scene.name", scene))?;
    let log = table::<LogRow>(&folder, "log")?.into_iter().find(|log| log.token == row.log_token);
    let log = log.ok_or_else(|| missing("log.token", &row.log_token))?;
    let mut samples = table::<SampleRow>(&folder, "sample")?;
    samples.retain(|sample| sample.scene_token == row.token);
    samples.sort_by(|a, b| a.timestamp.total_cmp(&b.timestamp));
    let tokens: BTreeSet<&str> = samples.iter().map(|sample| sample.token.as_str()).collect();
    let mut data = table::<DataRow>(&folder, "sample_data")?;
    data.retain(|data| tokens.contains(data.sample_token.as_str()));
    data.sort_by(|a, b| a.timestamp.total_cmp(&b.timestamp));
    let zero = samples.first().map_or(0.0, |sample| sample.timestamp);
    let secs = |timestamp: f64| (timestamp - zero) * 1e-6;
    let rig = Rig::of(&folder, root, &data, &secs)?;
    let boxes = boxes(&folder, &tokens)?;
    let key_frames = samples.iter().map(|sample| {
        let here = boxes.iter().filter(|(token, _)| *token == sample.token).map(|(_, raw)| raw.clone()).collect();
        (secs(sample.timestamp), here)
    });
    let key_frames: Vec<(f64, Vec<RawBox>)> = key_frames.collect();
    let path = root.join("maps").join("expansion").join(format!("{}.json", log.location));
    let map = if path.is_file() { map::read(&path, &rig.stands)? } else { Map::default() };
    let drive = RawDrive {
        name: row.name.clone(),
        stands: rig.stands,
        key_frames,
        cameras: rig.cameras,
        pictures: rig.pictures,
        map,
        vehicle: VehicleParameters::ZOE,
        prompt: format!("front camera view of a street, {}", row.description.to_lowercase()),
        origin: Origin {
            source: format!("nuScenes {}", folder.file_name().unwrap_or_default().to_string_lossy()),
            licence: "CC-BY-NC-SA-4.0".to_owned(),
            attribution: "nuScenes, Motional; nuScenes Terms of Use apply".to_owned(),
        },
        tick_secs: None,
        notes: Vec::new(),
    };
    drive.recorded(&folder)
}

/// The car's poses, cameras and pictures.
struct Rig {
    stands: Vec<Stand>,
    cameras: Vec<CameraModel>,
    pictures: Vec<Vec<(f64, PathBuf)>>,
}

impl Rig {
    fn of(folder: &Path, root: &Path, data: &[DataRow], secs: &dyn Fn(f64) -> f64) -> Result<Self, ImportError> {
        let wanted: BTreeSet<&str> = data.iter().map(|data| data.ego_pose_token.as_str()).collect();
        let poses: BTreeMap<String, PoseRow> = table::<PoseRow>(folder, "ego_pose")?
            .into_iter()
            .filter(|pose| wanted.contains(pose.token.as_str()))
            .map(|pose| (pose.token.clone(), pose))
            .collect();
        let sensors: BTreeMap<String, SensorRow> =
            table::<SensorRow>(folder, "sensor")?.into_iter().map(|row| (row.token.clone(), row)).collect();
        let calibrations: BTreeMap<String, CalibrationRow> = table::<CalibrationRow>(folder, "calibrated_sensor")?
            .into_iter()
            .map(|row| (row.token.clone(), row))
            .collect();
        let missing = |what: &str, token: &str| ImportError::Field {
            path: folder.to_owned(),
            at: what.to_owned(),
            problem: format!("has no {token:?}"),
        };
        let mut stands = Vec::new();
        let mut cameras: BTreeMap<String, (CameraModel, Vec<(f64, PathBuf)>)> = BTreeMap::new();
        for row in data {
            let pose = poses.get(&row.ego_pose_token).ok_or_else(|| missing("ego_pose.token", &row.ego_pose_token))?;
            let at = secs(row.timestamp);
            let position = DVec3::from_array(pose.translation);
            stands.push(Stand { secs: at, position, rotation: quaternion(pose.rotation) });
            let calibration = calibrations.get(&row.calibrated_sensor_token);
            let calibration =
                calibration.ok_or_else(|| missing("calibrated_sensor.token", &row.calibrated_sensor_token))?;
            let sensor = sensors.get(&calibration.sensor_token);
            let sensor = sensor.ok_or_else(|| missing("sensor.token", &calibration.sensor_token))?;
            if sensor.modality != "camera" {
                continue;
            }
            if !cameras.contains_key(&sensor.channel) {
                let model = camera(calibration, &sensor.channel, row.width, row.height)
                    .ok_or_else(|| missing("calibrated_sensor.camera_intrinsic", &calibration.token))?;
                cameras.insert(sensor.channel.clone(), (model, Vec::new()));
            }
            if let Some((_, pictures)) = cameras.get_mut(&sensor.channel) {
                pictures.push((at, root.join(&row.filename)));
            }
        }
        // The front camera first, the others by name.
        let mut order: Vec<_> = cameras.into_iter().collect();
        order.sort_by_key(|(channel, _)| (channel != "CAM_FRONT", channel.clone()));
        let (cameras, pictures) = order.into_iter().map(|(_, camera)| camera).unzip();
        Ok(Self { stands, cameras, pictures })
    }
}

fn camera(row: &CalibrationRow, channel: &str, width: u32, height: u32) -> Option<CameraModel> {
    let value = |i: usize, j: usize| row.camera_intrinsic.get(i).and_then(|row| row.get(j)).copied();
    let (width_px, height_px) = if width == 0 || height == 0 { (1_600, 900) } else { (width, height) };
    Some(CameraModel {
        id: CameraId::new(channel).ok()?,
        intrinsics: Intrinsics {
            width_px,
            height_px,
            fx_px: value(0, 0)?,
            fy_px: value(1, 1)?,
            cx_px: value(0, 2)?,
            cy_px: value(1, 2)?,
            k1: 0.0,
            k2: 0.0,
        },
        rig_from_camera: Pose::new(quaternion(row.rotation), DVec3::from_array(row.translation)),
    })
}

/// Returns the boxes of some samples with the samples' tokens.
fn boxes(folder: &Path, samples: &BTreeSet<&str>) -> Result<Vec<(String, RawBox)>, ImportError> {
    let categories: BTreeMap<String, String> =
        table::<CategoryRow>(folder, "category")?.into_iter().map(|row| (row.token, row.name)).collect();
    let instances: BTreeMap<String, String> =
        table::<InstanceRow>(folder, "instance")?.into_iter().map(|row| (row.token, row.category_token)).collect();
    let mut boxes = Vec::new();
    for row in table::<AnnotationRow>(folder, "sample_annotation")? {
        if !samples.contains(row.sample_token.as_str()) {
            continue;
        }
        let category = instances.get(&row.instance_token).and_then(|token| categories.get(token));
        let Some(class) = category.and_then(|name| class_of(name)) else { continue };
        let [width, length, height] = row.size;
        let raw = RawBox {
            instance: row.instance_token,
            class,
            size_m: [length, width, height],
            centre: DVec3::from_array(row.translation),
            rotation: quaternion(row.rotation),
        };
        boxes.push((row.sample_token, raw));
    }
    Ok(boxes)
}

fn class_of(category: &str) -> Option<AgentClass> {
    match category {
        "vehicle.bicycle" | "vehicle.motorcycle" => Some(AgentClass::Cyclist),
        "movable_object.trafficcone" => Some(AgentClass::Cone),
        "movable_object.barrier" => Some(AgentClass::Barrier),
        name if name.starts_with("vehicle.") => Some(AgentClass::Vehicle),
        name if name.starts_with("human.pedestrian") => Some(AgentClass::Pedestrian),
        _ => None,
    }
}
