//! Makes a scenario document of a scene; lanes are referred to by name, series of equal values become one value.

use ds_space::DVec2;
use ds_world::{Adversary, Lane, LaneId, Map, Scene, Structure, Track, TrafficLight};

use crate::content::Mounting;
use crate::document::{
    AdversaryPart, BudgetPart, CameraPart, Document, EgoPart, FORMAT, FRAME, LanePart, LastingPart, LightPart,
    LinePart, MapPart, OriginPart, Point, RICHER_VERSION, StopPart, StructurePart, TrackPart, VERSION, VehiclePart,
};

fn pairs(points: &[DVec2]) -> Vec<Point> {
    points.iter().map(DVec2::to_array).collect()
}

fn series(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.collect();
    if values.len() > 1 && values.iter().all(|value| value.to_bits() == values[0].to_bits()) {
        values.truncate(1);
    }
    values
}

/// Returns the document of a scene.
pub(crate) fn document(scene: &Scene) -> Document {
    let vehicle = &scene.vehicle;
    Document {
        format: FORMAT.to_owned(),
        version: if scene.adversary.is_none() && scene.map.structures.is_empty() { VERSION } else { RICHER_VERSION },
        name: scene.name.clone(),
        family: scene.family.clone(),
        origin: OriginPart {
            source: scene.origin.source.clone(),
            licence: scene.origin.licence.clone(),
            attribution: scene.origin.attribution.clone(),
        },
        prompt: scene.prompt.clone(),
        frame: FRAME.to_owned(),
        dt_secs: scene.dt.secs(),
        vehicle: VehiclePart {
            length_m: vehicle.size.length_m,
            width_m: vehicle.size.width_m,
            height_m: vehicle.size.height_m,
            wheel_base_m: vehicle.wheel_base_m,
            rear_axle_to_centre_m: vehicle.rear_axle_to_centre_m,
            max_steering_rad: vehicle.max_steering_rad,
            max_steering_rate_radps: vehicle.max_steering_rate_radps,
            max_acceleration_mps2: vehicle.max_acceleration_mps2,
            max_deceleration_mps2: vehicle.max_deceleration_mps2,
            mass_kg: vehicle.mass_kg,
        },
        cameras: scene.cameras.iter().map(camera).collect(),
        ego_log: ego(scene),
        route_m: pairs(&scene.route),
        tracks: scene.tracks.iter().map(track).collect(),
        adversary: scene.adversary.as_ref().map(adversary),
        map: map(&scene.map),
    }
}

fn adversary(adversary: &Adversary) -> AdversaryPart {
    let budget = &adversary.budget;
    AdversaryPart {
        track: adversary.track.0,
        class: adversary.class.name().to_owned(),
        mode: adversary.mode.name().to_owned(),
        attack_tick: adversary.attack.0,
        contact_tick: adversary.contact.0,
        budget: BudgetPart {
            attack_secs: budget.attack_secs,
            effort_mps: budget.effort_mps,
            aside_m: budget.aside_m,
            reaims: budget.reaims,
        },
        corridor_m: pairs(&adversary.corridor),
    }
}

fn camera(camera: &ds_space::CameraModel) -> CameraPart {
    let (lens, mounting) = (&camera.intrinsics, Mounting::of(camera));
    CameraPart {
        name: camera.id.to_string(),
        width_px: lens.width_px,
        height_px: lens.height_px,
        fx_px: lens.fx_px,
        fy_px: lens.fy_px,
        cx_px: lens.cx_px,
        cy_px: lens.cy_px,
        k1: lens.k1,
        k2: lens.k2,
        x_in_rig_m: mounting.position_m.x,
        y_in_rig_m: mounting.position_m.y,
        z_in_rig_m: mounting.position_m.z,
        yaw_left_rad: mounting.yaw_rad,
        pitch_down_rad: mounting.pitch_rad,
        roll_rad: mounting.roll_rad,
    }
}

/// The ego log is never shortened to constants: its length is the number of ticks.
fn ego(scene: &Scene) -> EgoPart {
    let column = |value: fn(&ds_world::EgoState) -> f64| scene.ego_log.iter().map(value).collect();
    EgoPart {
        x_m: column(|state| state.pose.position.x),
        y_m: column(|state| state.pose.position.y),
        heading_rad: column(|state| state.pose.heading_rad),
        forward_mps: column(|state| state.velocity_mps.x),
        left_mps: column(|state| state.velocity_mps.y),
        yaw_rate_radps: column(|state| state.yaw_rate_radps),
        forward_mps2: column(|state| state.acceleration_mps2.x),
        left_mps2: column(|state| state.acceleration_mps2.y),
        steering_rad: column(|state| state.steering_rad),
        steering_rate_radps: column(|state| state.steering_rate_radps),
    }
}

fn track(track: &Track) -> TrackPart {
    let mut valid_ticks: Vec<[u32; 2]> = Vec::new();
    for (tick, point) in (0u32..).zip(&track.points) {
        if point.is_some() {
            match valid_ticks.last_mut() {
                Some(last) if last[1] + 1 == tick => last[1] = tick,
                _ => valid_ticks.push([tick, tick]),
            }
        }
    }
    let column = |value: fn(&ds_world::TrackPoint) -> f64| series(track.points.iter().flatten().map(value));
    TrackPart {
        name: track.name.clone(),
        class: track.class,
        length_m: track.size.length_m,
        width_m: track.size.width_m,
        height_m: track.size.height_m,
        valid_ticks,
        x_m: column(|point| point.pose.position.x),
        y_m: column(|point| point.pose.position.y),
        z_m: column(|point| point.z_m),
        heading_rad: column(|point| point.pose.heading_rad),
        vx_mps: column(|point| point.velocity_mps.x),
        vy_mps: column(|point| point.velocity_mps.y),
    }
}

fn names(map: &Map, lanes: &[LaneId]) -> Vec<String> {
    lanes.iter().filter_map(|id| name(map, *id)).collect()
}

fn name(map: &Map, lane: LaneId) -> Option<String> {
    map.lane(lane).map(|lane| lane.name.clone())
}

fn map(map: &Map) -> MapPart {
    let polygons = |polygons: &[Vec<DVec2>]| polygons.iter().map(|polygon| pairs(polygon)).collect();
    MapPart {
        lanes: map.lanes.iter().map(|part| lane(map, part)).collect(),
        junctions_m: polygons(&map.junctions),
        drivable_m: polygons(&map.drivable),
        road_edges_m: map.road_edges.iter().map(|edge| pairs(&edge.points)).collect(),
        lane_lines: map
            .line_markings
            .iter()
            .map(|line| LinePart { kind: line.kind, colour: line.colour, points_m: pairs(&line.points) })
            .collect(),
        crosswalks_m: map.crosswalks.iter().map(|crosswalk| pairs(&crosswalk.polygon)).collect(),
        stop_lines: map
            .stop_lines
            .iter()
            .map(|stop| StopPart { light: stop.light, points_m: stop.points.map(|point| point.to_array()) })
            .collect(),
        traffic_lights: map.traffic_lights.iter().map(|part| light(map, part)).collect(),
        structures: map.structures.iter().map(structure).collect(),
    }
}

fn structure(structure: &Structure) -> StructurePart {
    StructurePart {
        kind: structure.kind,
        bottom_m: structure.bottom_m,
        top_m: structure.top_m,
        outline_m: pairs(&structure.outline),
    }
}

fn lane(map: &Map, lane: &Lane) -> LanePart {
    LanePart {
        name: lane.name.clone(),
        kind: lane.kind,
        speed_limit_mps: lane.speed_limit_mps,
        successors: names(map, &lane.successors),
        predecessors: names(map, &lane.predecessors),
        left: lane.left.and_then(|id| name(map, id)),
        right: lane.right.and_then(|id| name(map, id)),
        centre_line_m: pairs(&lane.centre_line),
        polygon_m: pairs(&lane.polygon),
    }
}

fn light(map: &Map, light: &TrafficLight) -> LightPart {
    let mut states: Vec<LastingPart> = Vec::new();
    for state in &light.states {
        match states.last_mut() {
            Some(last) if last.0 == *state => last.1 += 1,
            _ => states.push(LastingPart(*state, 1)),
        }
    }
    LightPart {
        x_m: light.position.x,
        y_m: light.position.y,
        z_m: light.position.z,
        facing_rad: light.facing_rad,
        lanes: names(map, &light.lanes),
        states,
    }
}
