//! Scenarios of motion forecasting: tracks in the plane at 10 Hz, without sizes.
//!
//! The ego is the track of the recording car, `AV`; a file without it has its focal track driven. Whether the ego's
//! positions are those of the rear axle or of the box's centre is told from the drive, as for ScenarioNet.

use std::collections::BTreeMap;
use std::path::Path;

use ds_scenario::Warning;
use ds_scenario::{MAX_STATES, MAX_TICKS};
use ds_space::{DVec2, Digest, PoseSe2, SimTime, angle};
use ds_world::{AgentClass, Scene, Size, Track, TrackPoint, VehicleParameters};

use super::table::Table;
use super::{class, left_out, map_of, origin, prompt};
use crate::error::ImportError;
use crate::scenarionet::ego::Recording;
use crate::scenarionet::route::route;
use crate::scenarionet::tracks::usual;
use crate::scene::{checked, safe_name, usual_camera};

const EGO: &str = "AV";
const TICK_SECS: f64 = 0.1;
const STATE: [&str; 5] = ["position_x", "position_y", "heading", "velocity_x", "velocity_y"];
const TEXTS: [&str; 5] = ["track_id", "object_type", "focal_track_id", "scenario_id", "city"];

/// The states of a track by step.
struct Seen {
    kind: String,
    states: BTreeMap<usize, TrackPoint>,
}

/// Reads the scene of a scenario's table.
pub(super) fn scene(log: &Path, path: &Path, notes: &mut Vec<Warning>) -> Result<Scene, ImportError> {
    let table = Table::read(path, &[&TEXTS[..], &STATE, &["timestep"]].concat())?;
    let mut seen = seen(&table)?;
    let first_of = |column: &str| table.texts(column).ok().and_then(|texts| texts.into_iter().next());
    let driven = if seen.contains_key(EGO) {
        EGO.to_owned()
    } else {
        table.texts("focal_track_id")?.into_iter().next().ok_or_else(|| table.fault("focal_track_id", "has no rows"))?
    };
    let ego = seen.remove(&driven).ok_or_else(|| table.fault("track_id", format!("has no {driven:?}")))?;
    let (first, last) =
        ego.states.first_key_value().zip(ego.states.last_key_value()).map_or((0, 0), |(a, b)| (*a.0, *b.0));
    let count = last - first + 1;
    if seen.len().saturating_mul(count) > MAX_STATES {
        let problem = format!("has {} tracks over {count} steps, over {MAX_STATES} states", seen.len());
        return Err(table.fault("track_id", problem));
    }
    let moved = ego.states[&first].pose.position.round();
    let (map, _) = map_of(log, moved, notes)?;
    let (mut points, mut headings, mut gaps) = (Vec::new(), Vec::new(), Vec::new());
    let mut held = ego.states[&first].pose;
    for step in first..=last {
        let state = ego.states.get(&step);
        held = state.map_or(held, |state| state.pose);
        points.push(held.position - moved);
        headings.push(held.heading_rad);
        gaps.push(state.is_none());
    }
    let vehicle = VehicleParameters::FUSION;
    let ego_log =
        Recording { points, headings, gaps, dt_secs: TICK_SECS }.states(&vehicle, "argoverse", &driven, notes);
    let scene = Scene {
        adversary: None,
        name: safe_name(&first_of("scenario_id").unwrap_or_default()),
        family: String::new(),
        digest: Digest::default(),
        dt: SimTime::from_secs(TICK_SECS),
        route: route(&ego_log, &map),
        map,
        vehicle,
        ego_log,
        tracks: tracks(seen, first, last, moved, notes),
        cameras: vec![usual_camera()],
        prompt: prompt(&first_of("city").unwrap_or_default()),
        origin: origin("motion forecasting"),
    };
    checked(&scene, path)
}

fn seen(table: &Table) -> Result<BTreeMap<String, Seen>, ImportError> {
    let (ids, kinds) = (table.texts("track_id")?, table.texts("object_type")?);
    let (steps, states) = (table.numbers("timestep")?, table.vectors(STATE)?);
    let mut seen: BTreeMap<String, Seen> = BTreeMap::new();
    for row in 0..table.rows {
        let step = steps[row];
        if step.fract() != 0.0 || !(0.0..MAX_TICKS as f64).contains(&step) {
            let problem = format!("is {step}, no whole number from 0 to {}", MAX_TICKS - 1);
            return Err(table.fault(format!("timestep[{row}]"), problem));
        }
        let [x, y, heading, vx, vy] = states[row];
        let point = TrackPoint {
            pose: PoseSe2 { position: DVec2::new(x, y), heading_rad: angle::wrap(heading) },
            z_m: 0.0,
            velocity_mps: DVec2::new(vx, vy),
        };
        let track =
            seen.entry(ids[row].clone()).or_insert_with(|| Seen { kind: kinds[row].clone(), states: BTreeMap::new() });
        if track.states.insert(step as usize, point).is_some() {
            return Err(table.fault(format!("timestep[{row}]"), format!("is {step} twice for track {:?}", ids[row])));
        }
    }
    Ok(seen)
}

fn tracks(
    seen: BTreeMap<String, Seen>,
    first: usize,
    last: usize,
    moved: DVec2,
    notes: &mut Vec<Warning>,
) -> Vec<Track> {
    let (mut tracks, mut unknown) = (Vec::new(), BTreeMap::new());
    for (name, seen) in seen {
        let Some(class) = class(&seen.kind) else {
            *unknown.entry(seen.kind).or_default() += 1;
            continue;
        };
        let point = |step: usize| {
            let mut point = *seen.states.get(&step)?;
            point.pose.position -= moved;
            Some(point)
        };
        let points: Vec<Option<TrackPoint>> = (first..=last).map(point).collect();
        if points.iter().any(Option::is_some) {
            tracks.push(Track { name, class, size: size(&seen.kind, class), points });
        }
    }
    left_out("object_type", unknown, notes);
    let message = "sizes are not in the log; those usual for each class are taken".to_owned();
    notes.push(Warning { at: "tracks".to_owned(), message });
    tracks
}

fn size(kind: &str, class: AgentClass) -> Size {
    if kind == "bus" { Size { length_m: 12.0, width_m: 2.6, height_m: 3.2 } } else { usual(class) }
}
