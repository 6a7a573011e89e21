//! Drives of the OpenScene / NAVSIM folder layout: `*logs*/**/*.pkl`, lists of frames at 2 Hz, with `sensor_blobs`.
//!
//! Boxes are given in the lidar's frame (x, y, z of the centre, length, width, height, heading), poses as translation
//! and quaternion (w, x, y, z) in the UTM zone of the city; the drive is moved to begin at the origin. The map is
//! nuPlan's of the same zone; without it there is no road, and the layout shows boxes alone.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use ds_pickle::AllowList;
use ds_scenario::Warning;
use ds_space::{CameraId, CameraModel, DMat3, DQuat, DVec2, DVec3, Intrinsics, Pose};
use ds_world::{AgentClass, Map, Origin, Scene, VehicleParameters};

use crate::error::ImportError;
use crate::nuplan::{self, SignalReading};
use crate::recorded::{RawBox, RawDrive, Recorded, Stand};
use crate::view::{FieldFault, View};

/// Pictures of nuPlan's cameras.
const WIDTH_PX: u32 = 1_920;
const HEIGHT_PX: u32 = 1_080;
/// Seconds between ticks of a scenario.
const TICK_SECS: f64 = 0.1;

/// Returns the logs under a folder, in order of their names.
///
/// # Errors
/// If a folder cannot be read.
pub fn logs(root: &Path) -> Result<Vec<PathBuf>, ImportError> {
    let mut found = Vec::new();
    let mut folders = vec![(root.to_owned(), 0)];
    while let Some((folder, depth)) = folders.pop() {
        let unreadable = |source| ImportError::Read { path: folder.clone(), source };
        for entry in std::fs::read_dir(&folder).map_err(unreadable)? {
            let path = entry.map_err(unreadable)?.path();
            let named = |name: &str| path.file_name().is_some_and(|found| found == name);
            if path.is_dir() && depth < 4 && !named("sensor_blobs") {
                folders.push((path, depth + 1));
            } else if path.extension().is_some_and(|extension| extension == "pkl") {
                found.push(path);
            }
        }
    }
    found.sort();
    if found.is_empty() { Err(ImportError::Empty { wanted: "*.pkl log", path: root.to_owned() }) } else { Ok(found) }
}

/// Reads one log; its pictures are looked for under `root`, in `sensor_blobs` and its folder of the log's split.
///
/// `maps` is the folder with nuPlan's maps (`<location>/<version>/map.gpkg`), which other tools call
/// `NUPLAN_MAPS_ROOT`; without it `maps` and `nuplan-maps-v1.0` in `root` and the folders above are looked at.
///
/// # Errors
/// If the log or its map is refused; the field or layer is named. If a folder of maps is given and lacks the map.
pub fn read(root: &Path, log: &Path, maps: Option<&Path>) -> Result<Recorded, ImportError> {
    mapped(root, log, maps, None)?.recorded(log)
}

/// Reads one log as a scenario with ten ticks a second; places between frames are interpolated.
///
/// # Errors
/// As for [`read`].
pub fn scene(root: &Path, log: &Path, maps: Option<&Path>) -> Result<(Scene, Vec<Warning>), ImportError> {
    let recorded = mapped(root, log, maps, Some(TICK_SECS))?.recorded(log)?;
    Ok((recorded.scene, recorded.warnings))
}

/// Reads one log with its map.
fn mapped(root: &Path, log: &Path, maps: Option<&Path>, tick_secs: Option<f64>) -> Result<RawDrive, ImportError> {
    let (mut drive, told) = parsed(root, log)?;
    drive.tick_secs = tick_secs;
    let note = |message: String| Warning { at: "map".to_owned(), message };
    let places: Vec<DVec2> = drive.stands.iter().map(|stand| stand.position.truncate()).collect();
    let origin = places.first().map_or(DVec2::ZERO, |place| place.floor());
    drive.recentre(origin);
    if origin != DVec2::ZERO {
        drive.notes.push(note(format!("all positions are moved by -{origin}")));
    }
    let Some(location) = told.location else {
        let message = "is unknown: the log does not name its map_location; the layout will have no road";
        drive.notes.push(note(message.to_owned()));
        return Ok(drive);
    };
    let Some(path) = nuplan::find(root, maps, &location)? else {
        let message = format!(
            "is missing: there is no {location}/*/map.gpkg in a folder \"maps\" or \"nuplan-maps-v1.0\" in or above {}; \
             the layout will have no road",
            root.display()
        );
        drive.notes.push(note(message));
        return Ok(drive);
    };
    let mut city = nuplan::read(&path, origin, &places, &mut drive.notes)?;
    nuplan::add_signals(&mut city, &told.lights, &drive.times_secs());
    drive.map = city.map;
    Ok(drive)
}

/// What a log tells beside the drive.
struct LogContext {
    /// The city.
    location: Option<String>,
    /// What traffic lights showed, frame by frame.
    lights: Vec<SignalReading>,
}

fn parsed(root: &Path, log: &Path) -> Result<(RawDrive, LogContext), ImportError> {
    let unreadable = |source| ImportError::Read { path: log.to_owned(), source };
    let size = std::fs::metadata(log).map_err(unreadable)?.len();
    if size > super::MAX_FILE_BYTES {
        return Err(ImportError::TooLarge { path: log.to_owned(), limit: super::MAX_FILE_BYTES });
    }
    let bytes = std::fs::read(log).map_err(unreadable)?;
    let pickle = ds_pickle::read(&bytes, AllowList::Data)
        .map_err(|source| ImportError::Pickle { path: log.to_owned(), source })?;
    let field = |fault: FieldFault| ImportError::Field { path: log.to_owned(), at: fault.at, problem: fault.problem };
    drive(&View::root(&pickle), root, log).map_err(field)
}

fn numbers<const N: usize>(view: &View<'_>) -> Result<[f64; N], FieldFault> {
    let table = view.table()?;
    let found = table.values.len();
    table.values.try_into().map_err(|_| view.fault(format!("has {found} numbers, {N} are needed")))
}

fn quaternion(view: &View<'_>) -> Result<DQuat, FieldFault> {
    let [w, x, y, z] = numbers(view)?;
    let rotation = DQuat::from_xyzw(x, y, z, w);
    if rotation.length() > 0.1 { Ok(rotation.normalize()) } else { Err(view.fault("is no rotation")) }
}

fn vector(view: &View<'_>) -> Result<DVec3, FieldFault> {
    numbers(view).map(DVec3::from_array)
}

fn matrix(view: &View<'_>) -> Result<DMat3, FieldFault> {
    // Rows in the file.
    numbers::<9>(view).map(|values| DMat3::from_cols_array(&values).transpose())
}

fn drive(root: &View<'_>, folder: &Path, log: &Path) -> Result<(RawDrive, LogContext), FieldFault> {
    let frames = root.items();
    let Some(first) = frames.first() else { return Err(root.fault("holds no frames")) };
    let stamp = |frame: &View<'_>| -> Result<f64, FieldFault> {
        let stamp = frame.need("timestamp")?;
        stamp.number().ok_or_else(|| stamp.fault("is no number"))
    };
    let zero = stamp(first)?;
    let (mut stands, mut key_frames, mut lights) = (Vec::new(), Vec::new(), Vec::new());
    let mut cameras: Vec<(String, CameraModel)> = Vec::new();
    let mut pictures: Vec<Vec<(f64, PathBuf)>> = Vec::new();
    for frame in &frames {
        let secs = (stamp(frame)? - zero) * 1e-6;
        let stand = Stand {
            secs,
            position: vector(&frame.need("ego2global_translation")?)?,
            rotation: quaternion(&frame.need("ego2global_rotation")?)?,
        };
        let rig_from_lidar =
            (vector(&frame.need("lidar2ego_translation")?)?, quaternion(&frame.need("lidar2ego_rotation")?)?);
        key_frames.push((secs, boxes(frame, &stand, rig_from_lidar)?));
        lights.push((secs, signals(frame)?));
        for (name, entry) in frame.need("cams")?.entries()? {
            let at = match cameras.iter().position(|(known, _)| *known == name) {
                Some(at) => at,
                None => {
                    cameras.push((name.clone(), camera(&name, &entry, rig_from_lidar)?));
                    pictures.push(Vec::new());
                    cameras.len() - 1
                }
            };
            if let Some(path) = entry.get("data_path").and_then(|path| path.text()) {
                pictures[at].push((secs, picture(folder, log, &path)));
            }
        }
        stands.push(stand);
    }
    // The front camera first, the others by name.
    let mut order: Vec<usize> = (0..cameras.len()).collect();
    order.sort_by_key(|i| (cameras[*i].0 != "CAM_F0", cameras[*i].0.clone()));
    let stem = log.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    let name = first.get("log_name").and_then(|name| name.text()).filter(|name| !name.is_empty()).unwrap_or(stem);
    let told = LogContext { location: first.get("map_location").and_then(|location| location.text()), lights };
    let drive = RawDrive {
        name: name.chars().map(|c| if c.is_ascii_alphanumeric() || c == '_' { c } else { '-' }).take(80).collect(),
        stands,
        key_frames,
        cameras: order.iter().map(|i| cameras[*i].1.clone()).collect(),
        pictures: order.iter().map(|i| pictures[*i].clone()).collect(),
        map: Map::default(),
        vehicle: VehicleParameters::PACIFICA,
        prompt: "front camera view of a city street".to_owned(),
        origin: Origin {
            source: "OpenScene".to_owned(),
            licence: "CC-BY-NC-SA-4.0".to_owned(),
            attribution: "OpenScene and nuPlan, Motional; nuPlan Terms of Use apply".to_owned(),
        },
        tick_secs: None,
        notes: Vec::new(),
    };
    Ok((drive, told))
}

/// Reads which lane connectors show red in a frame: pairs of a connector and whether it does.
fn signals(frame: &View<'_>) -> Result<BTreeMap<i64, bool>, FieldFault> {
    let Some(lights) = frame.get("traffic_lights") else { return Ok(BTreeMap::new()) };
    let pair = |view: &View<'_>| {
        let parts = view.items();
        let [connector, red] = parts.as_slice() else { return None };
        Some((connector.text()?.parse().ok()?, red.number()? != 0.0))
    };
    let read = |view: &View<'_>| {
        pair(view).ok_or_else(|| view.fault("is no pair of a lane connector and whether it shows red"))
    };
    lights.items().iter().map(read).collect()
}

/// Returns where a picture lies: in the root, in `sensor_blobs`, or in its folder named like that of the log (`mini`).
fn picture(root: &Path, log: &Path, stored: &str) -> PathBuf {
    let blobs = root.join("sensor_blobs");
    let split = log.parent().and_then(Path::file_name).map(|split| blobs.join(split).join(stored));
    let places = [Some(root.join(stored)), split];
    places.into_iter().flatten().find(|path| path.is_file()).unwrap_or_else(|| blobs.join(stored))
}

fn camera(name: &str, entry: &View<'_>, rig_from_lidar: (DVec3, DQuat)) -> Result<CameraModel, FieldFault> {
    let lens = matrix(&entry.need("cam_intrinsic")?)?;
    let turned = DQuat::from_mat3(&matrix(&entry.need("sensor2lidar_rotation")?)?).normalize();
    let placed = vector(&entry.need("sensor2lidar_translation")?)?;
    let (translation, rotation) = rig_from_lidar;
    // k1, k2, p1, p2, k3; tangential terms are below a pixel here and left out.
    let distortion = entry.get("distortion").and_then(|view| view.table().ok()).map(|table| table.values);
    let k = |i: usize| distortion.as_ref().and_then(|values| values.get(i)).copied().unwrap_or(0.0);
    Ok(CameraModel {
        id: CameraId::new(name).map_err(|error| entry.fault(error.to_string()))?,
        intrinsics: Intrinsics {
            width_px: WIDTH_PX,
            height_px: HEIGHT_PX,
            fx_px: lens.col(0).x,
            fy_px: lens.col(1).y,
            cx_px: lens.col(2).x,
            cy_px: lens.col(2).y,
            k1: k(0),
            k2: k(1),
        },
        rig_from_camera: Pose::new((rotation * turned).normalize(), rotation * placed + translation),
    })
}

fn boxes(frame: &View<'_>, stand: &Stand, rig_from_lidar: (DVec3, DQuat)) -> Result<Vec<RawBox>, FieldFault> {
    let Some(annotations) = frame.get("anns") else { return Ok(Vec::new()) };
    let table = annotations.need("gt_boxes")?;
    let rows = table.table()?;
    if rows.rows > 0 && rows.columns < 7 {
        return Err(table.fault(format!("has rows of {} numbers, 7 are needed", rows.columns)));
    }
    let names = annotations.need("gt_names")?.texts();
    let tokens = annotations.get("track_tokens").or_else(|| annotations.get("instance_tokens"));
    let tokens = tokens.map(|tokens| tokens.texts()).unwrap_or_default();
    if names.len() != rows.rows || tokens.len() != rows.rows {
        let problem = format!("has {} rows, {} names and {} tokens", rows.rows, names.len(), tokens.len());
        return Err(table.fault(problem));
    }
    let (translation, rotation) = rig_from_lidar;
    let mut boxes = Vec::new();
    for row in 0..rows.rows {
        let Some(class) = class_of(&names[row]) else { continue };
        let value = |column: usize| rows.get(row, column);
        let in_rig = rotation * DVec3::new(value(0), value(1), value(2)) + translation;
        boxes.push(RawBox {
            instance: tokens[row].clone(),
            class,
            size_m: [value(3), value(4), value(5)],
            centre: stand.rotation * in_rig + stand.position,
            rotation: stand.rotation * rotation * DQuat::from_rotation_z(value(6)),
        });
    }
    Ok(boxes)
}

fn class_of(name: &str) -> Option<AgentClass> {
    match name {
        "vehicle" => Some(AgentClass::Vehicle),
        "pedestrian" => Some(AgentClass::Pedestrian),
        "bicycle" => Some(AgentClass::Cyclist),
        "traffic_cone" => Some(AgentClass::Cone),
        "barrier" => Some(AgentClass::Barrier),
        _ => None,
    }
}
