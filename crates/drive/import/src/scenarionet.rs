//! Scenes of ScenarioNet / MetaDrive scenario descriptions (nuScenes, Waymo, nuPlan and others converted by it).
//!
//! Axes and origin are kept (recentred only beyond 100 km). The ego log is the rear axle; whether the file gives that
//! or the centre of the box is told from the drive itself. A swapped ego length and width is put right. Agents stand
//! on the ground plane: heights in the source are left out. Ticks before and after the ego log are cut off.

use std::path::Path;

use ds_pickle::AllowList;
use ds_scenario::{Warning, warnings};
use ds_space::{DVec2, Digest, SimTime};
use ds_world::{Origin, Scene};

use crate::error::ImportError;
use crate::scene::{checked, safe_name, usual_camera};
use crate::view::{FieldFault, View};

pub(super) mod ego;
pub(super) mod lanes;
mod lights;
pub(super) mod route;
pub(super) mod tracks;

/// How one file is turned into a scene: what to subtract from positions, which ticks to keep.
#[derive(Debug, Clone, Copy)]
struct Window {
    origin: DVec2,
    first: usize,
    count: usize,
}

/// Reads the scene of a pickle; `path` is only for its name and for messages.
///
/// # Errors
/// [`ImportError`] names the file and the field.
pub fn scene(bytes: &[u8], path: &Path) -> Result<(Scene, Vec<Warning>), ImportError> {
    let pickle = ds_pickle::read(bytes, AllowList::Data)
        .map_err(|source| ImportError::Pickle { path: path.to_owned(), source })?;
    let mut notes = Vec::new();
    let scene =
        convert(&View::root(&pickle), path, &mut notes).map_err(|fault: FieldFault| ImportError::field(path, fault))?;
    let scene = checked(&scene, path)?;
    notes.extend(warnings(&scene));
    Ok((scene, notes))
}

fn convert(root: &View<'_>, path: &Path, notes: &mut Vec<Warning>) -> Result<Scene, FieldFault> {
    let metadata = root.need("metadata")?;
    let sdc = metadata.need("sdc_id")?;
    let sdc = sdc.text().ok_or_else(|| sdc.fault("is no text"))?;
    let dataset = metadata.get("dataset").and_then(|dataset| dataset.text()).unwrap_or_default();
    let all_tracks = root.need("tracks")?;
    let ego_track = all_tracks.need(&sdc)?;
    let dt_secs = interval(&metadata);
    let log = ego::log(&ego_track, dt_secs, &dataset, notes)?;
    let window = log.window;
    let map = {
        let mut map = lanes::map(&root.need("map_features")?, &window, &dataset, notes)?;
        if let Some(states) = root.get("dynamic_map_states") {
            lights::add(&mut map, &states, &window, notes)?;
        }
        map
    };
    let route = route::route(&log.states, &map);
    let tracks = tracks::tracks(&all_tracks, &sdc, &window, notes)?;
    let place = metadata.get("map").and_then(|map| map.text()).unwrap_or_default();
    Ok(Scene {
        adversary: None,
        name: name(root, path),
        family: String::new(),
        digest: Digest::default(),
        dt: SimTime::from_secs(dt_secs),
        map,
        vehicle: log.vehicle,
        ego_log: log.states,
        route,
        tracks,
        cameras: vec![usual_camera()],
        prompt: prompt(&place),
        origin: origin(root, &dataset),
    })
}

/// Returns the scenario's name: the file's id, made safe for file names.
fn name(root: &View<'_>, path: &Path) -> String {
    let stem = || path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    safe_name(&root.get("id").and_then(|id| id.text()).filter(|id| !id.is_empty()).unwrap_or_else(stem))
}

/// Returns the time between ticks: `sample_rate`, else the middle step of `ts` (or `timestamps`), else 0.1 s.
fn interval(metadata: &View<'_>) -> f64 {
    let sound = |secs: &f64| (0.001..=1.0).contains(secs);
    let rate = metadata.get("sample_rate").and_then(|rate| rate.number()).filter(sound);
    rate.or_else(|| {
        let stamps = metadata.get("ts").or_else(|| metadata.get("timestep"))?.table().ok()?;
        let mut steps: Vec<f64> = stamps.values.windows(2).map(|pair| pair[1] - pair[0]).collect();
        steps.sort_by(f64::total_cmp);
        steps.get(steps.len() / 2).map(|secs| (secs * 1000.0).round() / 1000.0).filter(sound)
    })
    .unwrap_or(0.1)
}

fn prompt(place: &str) -> String {
    let words = match place {
        "singapore-onenorth" => "a street in one-north, Singapore",
        "singapore-hollandvillage" => "a street in Holland Village, Singapore",
        "singapore-queenstown" => "a street in Queenstown, Singapore",
        "boston-seaport" => "a street in the Seaport district of Boston",
        _ => "a city street",
    };
    format!("front camera view of {words}")
}

fn origin(root: &View<'_>, dataset: &str) -> Origin {
    let version = root.get("version").and_then(|version| version.text()).unwrap_or_default();
    let (licence, attribution) = match dataset {
        "nuscenes" => ("CC-BY-NC-SA-4.0", "nuScenes, Motional; converted by ScenarioNet; nuScenes Terms of Use apply"),
        "nuplan" => ("CC-BY-NC-SA-4.0", "nuPlan, Motional; converted by ScenarioNet; nuPlan Terms of Use apply"),
        "waymo" => ("LicenseRef-Waymo-Open-Dataset", "Waymo Open Dataset, Waymo LLC; converted by ScenarioNet"),
        "argoverse" | "av2" => ("CC-BY-NC-SA-4.0", "Argoverse 2, Argo AI; converted by ScenarioNet"),
        _ => ("LicenseRef-unknown", "see the terms of the data set"),
    };
    Origin {
        source: format!("ScenarioNet {dataset} {version}").trim_end().to_owned(),
        licence: licence.to_owned(),
        attribution: attribution.to_owned(),
    }
}
