//! Checks a scenario document and makes a scene of it; the first fault is reported with its place and value.

use std::collections::{BTreeMap, BTreeSet};

use ds_space::{CameraId, CameraModel, DQuat, DVec2, DVec3, Digest, Intrinsics, Pose, PoseSe2, SimTime};
use ds_world::{EgoState, Origin, Scene, Size, Track, TrackPoint, VehicleParameters};

use crate::content::{Mounting, seal};
use crate::document::{CameraPart, Document, EgoPart, FORMAT, FRAME, RICHER_VERSION, TrackPart, VERSION, VehiclePart};
use crate::place::{FAR_M, Fault, Place};

mod adversary;
mod map;

/// The most ticks that a log may have.
pub const MAX_TICKS: usize = 20_000;
/// The most track states (tracks × ticks) that a scene may have.
pub const MAX_STATES: usize = 2_000_000;
const MAX_CAMERAS: usize = 16;
const MAX_PIXELS: u32 = 8192;
const MAX_SPEED_MPS: f64 = 150.0;

/// Checks a document and returns its scene, sealed.
pub(crate) fn scene(document: &Document) -> Result<Scene, Fault> {
    let root = Place::Root;
    let says = |name, value: &str, expected: &str| {
        if value == expected { Ok(()) } else { Err(root.field(name).fault(format!("is {value:?}, not {expected:?}"))) }
    };
    says("format", &document.format, FORMAT)?;
    version(&root, document)?;
    says("frame", &document.frame, FRAME)?;
    file_name(&root.field("name"), &document.name)?;
    if document.prompt.len() > 4096 {
        return Err(root.field("prompt").fault(format!("has {} bytes, the limit is 4096", document.prompt.len())));
    }
    let dt_secs = root.field("dt_secs").within(document.dt_secs, 0.001, 1.0)?;
    let ego_log = ego(&root.field("ego_log"), &document.ego_log)?;
    let mut scene = Scene {
        name: document.name.clone(),
        family: document.family.clone(),
        digest: Digest::default(),
        dt: SimTime::from_secs(dt_secs),
        map: map::map(&root.field("map"), &document.map, ego_log.len())?,
        vehicle: vehicle(&root.field("vehicle"), &document.vehicle)?,
        route: root.field("route_m").points(&document.route_m, 2)?,
        tracks: tracks(&root.field("tracks"), &document.tracks, ego_log.len())?,
        cameras: cameras(&root.field("cameras"), &document.cameras)?,
        prompt: document.prompt.clone(),
        origin: Origin {
            source: document.origin.source.clone(),
            licence: document.origin.licence.clone(),
            attribution: document.origin.attribution.clone(),
        },
        adversary: None,
        ego_log,
    };
    scene.adversary = document
        .adversary
        .as_ref()
        .map(|part| adversary::adversary(&root.field("adversary"), part, &scene))
        .transpose()?;
    let length_m: f64 = scene.route.windows(2).map(|pair| pair[0].distance(pair[1])).sum();
    root.field("route_m")
        .within(length_m, 0.1, FAR_M)
        .map_err(|fault| Fault { problem: format!("its length {}", fault.problem), ..fault })?;
    seal(&mut scene);
    Ok(scene)
}

fn version(root: &Place<'_>, document: &Document) -> Result<(), Fault> {
    let at = root.field("version");
    match document.version {
        VERSION if document.adversary.is_some() => {
            Err(at.fault(format!("is {VERSION}, with an adversary it must be {RICHER_VERSION}")))
        }
        VERSION if !document.map.structures.is_empty() => {
            Err(at.fault(format!("is {VERSION}, with structures it must be {RICHER_VERSION}")))
        }
        VERSION | RICHER_VERSION => Ok(()),
        other => Err(at.fault(format!("is {other}, this program reads {VERSION} and {RICHER_VERSION}"))),
    }
}

fn file_name(at: &Place<'_>, text: &str) -> Result<(), Fault> {
    let allowed = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.');
    if text.is_empty() || text.len() > 80 || text.starts_with('.') || !text.chars().all(allowed) {
        let problem = "is no scenario name: 1 to 80 letters, digits, '_', '-' and '.', not beginning with '.'";
        return Err(at.fault(format!("{text:?} {problem}")));
    }
    Ok(())
}

fn vehicle(at: &Place<'_>, part: &VehiclePart) -> Result<VehicleParameters, Fault> {
    Ok(VehicleParameters {
        size: size(at, part.length_m, part.width_m, part.height_m)?,
        wheel_base_m: at.field("wheel_base_m").size(part.wheel_base_m, part.length_m)?,
        rear_axle_to_centre_m: at.field("rear_axle_to_centre_m").within(
            part.rear_axle_to_centre_m,
            0.0,
            0.5 * part.length_m,
        )?,
        max_steering_rad: at.field("max_steering_rad").size(part.max_steering_rad, 1.4)?,
        max_steering_rate_radps: at.field("max_steering_rate_radps").size(part.max_steering_rate_radps, 20.0)?,
        max_acceleration_mps2: at.field("max_acceleration_mps2").size(part.max_acceleration_mps2, 50.0)?,
        max_deceleration_mps2: at.field("max_deceleration_mps2").size(part.max_deceleration_mps2, 50.0)?,
        mass_kg: at.field("mass_kg").size(part.mass_kg, 100_000.0)?,
    })
}

fn size(at: &Place<'_>, length_m: f64, width_m: f64, height_m: f64) -> Result<Size, Fault> {
    Ok(Size {
        length_m: at.field("length_m").size(length_m, 60.0)?,
        width_m: at.field("width_m").size(width_m, 60.0)?,
        height_m: at.field("height_m").size(height_m, 20.0)?,
    })
}

fn cameras(at: &Place<'_>, parts: &[CameraPart]) -> Result<Vec<CameraModel>, Fault> {
    if parts.is_empty() || parts.len() > MAX_CAMERAS {
        return Err(at.fault(format!("has {} cameras, 1 to {MAX_CAMERAS} are needed", parts.len())));
    }
    let mut seen = BTreeSet::new();
    parts
        .iter()
        .enumerate()
        .map(|(i, part)| {
            let here = at.item(i);
            if !seen.insert(part.name.as_str()) {
                return Err(here.field("name").fault(format!("{:?} is used twice", part.name)));
            }
            camera(&here, part)
        })
        .collect()
}

fn camera(at: &Place<'_>, part: &CameraPart) -> Result<CameraModel, Fault> {
    let id = CameraId::new(&part.name).map_err(|error| at.field("name").fault(error.to_string()))?;
    let pixels = |name, value: u32| at.field(name).within(f64::from(value), 1.0, f64::from(MAX_PIXELS)).map(|_| value);
    let (width_px, height_px) = (pixels("width_px", part.width_px)?, pixels("height_px", part.height_px)?);
    let focal =
        |name, value: f64, size: u32| at.field(name).within(value, 0.05 * f64::from(size), 100.0 * f64::from(size));
    let centre = |name, value: f64, size: u32| at.field(name).within(value, -f64::from(size), 2.0 * f64::from(size));
    let intrinsics = Intrinsics {
        width_px,
        height_px,
        fx_px: focal("fx_px", part.fx_px, width_px)?,
        fy_px: focal("fy_px", part.fy_px, height_px)?,
        cx_px: centre("cx_px", part.cx_px, width_px)?,
        cy_px: centre("cy_px", part.cy_px, height_px)?,
        k1: at.field("k1").within(part.k1, -2.0, 2.0)?,
        k2: at.field("k2").within(part.k2, -2.0, 2.0)?,
    };
    let mounting = Mounting {
        position_m: DVec3::new(
            at.field("x_in_rig_m").within(part.x_in_rig_m, -30.0, 30.0)?,
            at.field("y_in_rig_m").within(part.y_in_rig_m, -30.0, 30.0)?,
            at.field("z_in_rig_m").within(part.z_in_rig_m, -5.0, 30.0)?,
        ),
        yaw_rad: at.field("yaw_left_rad").within(part.yaw_left_rad, -3.2, 3.2)?,
        pitch_rad: at.field("pitch_down_rad").within(part.pitch_down_rad, -1.5, 1.5)?,
        roll_rad: at.field("roll_rad").within(part.roll_rad, -3.2, 3.2)?,
    };
    let bare = CameraModel { id, intrinsics, rig_from_camera: Pose::new(DQuat::IDENTITY, DVec3::ZERO) };
    Ok(mounting.mount(&bare))
}

fn ego(at: &Place<'_>, part: &EgoPart) -> Result<Vec<EgoState>, Fault> {
    let count = part.x_m.len();
    if !(2..=MAX_TICKS).contains(&count) {
        return Err(at.field("x_m").fault(format!("has {count} values, a log has 2 to {MAX_TICKS} ticks")));
    }
    let columns: [(&'static str, &[f64], f64); 10] = [
        ("x_m", &part.x_m, FAR_M),
        ("y_m", &part.y_m, FAR_M),
        ("heading_rad", &part.heading_rad, 7.0),
        ("forward_mps", &part.forward_mps, MAX_SPEED_MPS),
        ("left_mps", &part.left_mps, MAX_SPEED_MPS),
        ("yaw_rate_radps", &part.yaw_rate_radps, 20.0),
        ("forward_mps2", &part.forward_mps2, 100.0),
        ("left_mps2", &part.left_mps2, 100.0),
        ("steering_rad", &part.steering_rad, 1.6),
        ("steering_rate_radps", &part.steering_rate_radps, 50.0),
    ];
    for (name, values, bound) in columns {
        at.field(name).series(values, count, bound)?;
    }
    let value = |values: &[f64], i: usize| if values.len() == 1 { values[0] } else { values[i] };
    let state = |i: usize| EgoState {
        pose: PoseSe2::new(part.x_m[i], value(&part.y_m, i), value(&part.heading_rad, i)),
        velocity_mps: DVec2::new(value(&part.forward_mps, i), value(&part.left_mps, i)),
        yaw_rate_radps: value(&part.yaw_rate_radps, i),
        acceleration_mps2: DVec2::new(value(&part.forward_mps2, i), value(&part.left_mps2, i)),
        steering_rad: value(&part.steering_rad, i),
        steering_rate_radps: value(&part.steering_rate_radps, i),
    };
    Ok((0..count).map(state).collect())
}

fn tracks(at: &Place<'_>, parts: &[TrackPart], ticks: usize) -> Result<Vec<Track>, Fault> {
    if parts.len().saturating_mul(ticks) > MAX_STATES {
        return Err(
            at.fault(format!("{} tracks of {ticks} ticks are over the limit of {MAX_STATES} states", parts.len()))
        );
    }
    let mut first_of = BTreeMap::new();
    let mut tracks = Vec::with_capacity(parts.len());
    for (i, part) in parts.iter().enumerate() {
        let here = at.item(i);
        here.field("name").name(&part.name)?;
        if let Some(first) = first_of.insert(part.name.as_str(), i) {
            return Err(here.field("name").fault(format!("{:?} is the name of tracks[{first}] too", part.name)));
        }
        tracks.push(track(&here, part, ticks)?);
    }
    Ok(tracks)
}

fn track(at: &Place<'_>, part: &TrackPart, ticks: usize) -> Result<Track, Fault> {
    let valid = valid_ticks(&at.field("valid_ticks"), &part.valid_ticks, ticks)?;
    let columns: [(&'static str, &[f64], f64); 6] = [
        ("x_m", &part.x_m, FAR_M),
        ("y_m", &part.y_m, FAR_M),
        ("z_m", &part.z_m, 10_000.0),
        ("heading_rad", &part.heading_rad, 7.0),
        ("vx_mps", &part.vx_mps, MAX_SPEED_MPS),
        ("vy_mps", &part.vy_mps, MAX_SPEED_MPS),
    ];
    for (name, values, bound) in columns {
        at.field(name).series(values, valid.len(), bound)?;
    }
    let value = |values: &[f64], i: usize| if values.len() == 1 { values[0] } else { values[i] };
    let mut points = vec![None; ticks];
    for (i, tick) in valid.into_iter().enumerate() {
        points[tick] = Some(TrackPoint {
            pose: PoseSe2::new(value(&part.x_m, i), value(&part.y_m, i), value(&part.heading_rad, i)),
            z_m: value(&part.z_m, i),
            velocity_mps: DVec2::new(value(&part.vx_mps, i), value(&part.vy_mps, i)),
        });
    }
    let size = size(at, part.length_m, part.width_m, part.height_m)?;
    Ok(Track { name: part.name.clone(), class: part.class, size, points })
}

fn valid_ticks(at: &Place<'_>, stretches: &[[u32; 2]], ticks: usize) -> Result<Vec<usize>, Fault> {
    let mut valid = Vec::new();
    for (i, [first, last]) in stretches.iter().enumerate() {
        let (first, last) = (*first as usize, *last as usize);
        let after_previous = valid.last().is_none_or(|before| first > *before);
        if first > last || last >= ticks || !after_previous {
            let problem = format!("is [{first}, {last}], not an increasing stretch of the {ticks} ticks");
            return Err(at.item(i).fault(problem));
        }
        valid.extend(first..=last);
    }
    Ok(valid)
}
