//! The content of a scene as the format keeps it: rounded numbers, and a digest over them in a fixed order.
//!
//! Positions are kept to 1 mm, angles and rates to 1e-5, pixels to 1e-4, so that a saved scene and a loaded one are equal in every bit.

use ds_space::{CameraModel, DMat3, DQuat, DVec2, DVec3, Digest, DigestWriter, Pose};
use ds_world::{Adversary, EgoState, LaneKind, LineColour, Map, Scene, Structure, Track};

/// Rounds to `steps_per_unit`; never gives a negative zero.
#[must_use]
pub fn rounded(value: f64, steps_per_unit: f64) -> f64 {
    let steps = (value * steps_per_unit).round();
    if steps == 0.0 { 0.0 } else { steps / steps_per_unit }
}

fn milli(value: &mut f64) {
    *value = rounded(*value, 1e3);
}

fn fine(value: &mut f64) {
    *value = rounded(*value, 1e5);
}

fn milli2(point: &mut DVec2) {
    milli(&mut point.x);
    milli(&mut point.y);
}

/// The mounting of a camera as files give it: position in the rig, yaw (left), pitch (down), roll, in radians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Mounting {
    pub position_m: DVec3,
    pub yaw_rad: f64,
    pub pitch_rad: f64,
    pub roll_rad: f64,
}

impl Mounting {
    /// The rotation from camera axes to rig axes of a camera that looks straight ahead.
    fn ahead() -> DQuat {
        DQuat::from_mat3(&DMat3::from_cols(DVec3::NEG_Y, DVec3::NEG_Z, DVec3::X))
    }

    /// Reads the mounting of a camera, angles to 1e-6 rad.
    pub(crate) fn of(camera: &CameraModel) -> Self {
        let turned = camera.rig_from_camera.rotation * Self::ahead().inverse();
        let (forward, left, up) = (turned * DVec3::X, turned * DVec3::Y, turned * DVec3::Z);
        let position = camera.rig_from_camera.translation;
        Self {
            position_m: DVec3::new(rounded(position.x, 1e3), rounded(position.y, 1e3), rounded(position.z, 1e3)),
            yaw_rad: rounded(forward.y.atan2(forward.x), 1e6),
            pitch_rad: rounded((-forward.z).atan2(forward.x.hypot(forward.y)), 1e6),
            roll_rad: rounded(left.z.atan2(up.z), 1e6),
        }
    }

    /// Returns the camera with this mounting.
    pub(crate) fn mount(&self, camera: &CameraModel) -> CameraModel {
        let turned = DQuat::from_rotation_z(self.yaw_rad)
            * DQuat::from_rotation_y(self.pitch_rad)
            * DQuat::from_rotation_x(self.roll_rad)
            * Self::ahead();
        CameraModel { rig_from_camera: Pose::new(turned.normalize(), self.position_m), ..camera.clone() }
    }
}

/// Rounds a scene to what the format keeps, and sets its digest.
pub(crate) fn seal(scene: &mut Scene) {
    for state in &mut scene.ego_log {
        round_state(state);
    }
    scene.route.iter_mut().for_each(milli2);
    for track in &mut scene.tracks {
        for value in [&mut track.size.length_m, &mut track.size.width_m, &mut track.size.height_m] {
            milli(value);
        }
        for point in track.points.iter_mut().flatten() {
            milli2(&mut point.pose.position);
            milli2(&mut point.velocity_mps);
            fine(&mut point.pose.heading_rad);
            milli(&mut point.z_m);
        }
    }
    for camera in &mut scene.cameras {
        *camera = Mounting::of(camera).mount(camera);
        let lens = &mut camera.intrinsics;
        for value in [&mut lens.fx_px, &mut lens.fy_px, &mut lens.cx_px, &mut lens.cy_px] {
            *value = rounded(*value, 1e4);
        }
    }
    if let Some(adversary) = &mut scene.adversary {
        adversary.corridor.iter_mut().for_each(milli2);
        let budget = &mut adversary.budget;
        [&mut budget.attack_secs, &mut budget.effort_mps, &mut budget.aside_m].into_iter().for_each(milli);
    }
    round_map(&mut scene.map);
    scene.digest = digest(scene);
}

fn round_state(state: &mut EgoState) {
    milli2(&mut state.pose.position);
    milli2(&mut state.velocity_mps);
    milli2(&mut state.acceleration_mps2);
    for value in [
        &mut state.pose.heading_rad,
        &mut state.yaw_rate_radps,
        &mut state.steering_rad,
        &mut state.steering_rate_radps,
    ] {
        fine(value);
    }
}

fn round_map(map: &mut Map) {
    for lane in &mut map.lanes {
        lane.centre_line.iter_mut().for_each(milli2);
        lane.polygon.iter_mut().for_each(milli2);
        lane.speed_limit_mps.iter_mut().for_each(milli);
    }
    map.junctions.iter_mut().chain(&mut map.drivable).flatten().for_each(milli2);
    map.road_edges.iter_mut().flat_map(|edge| &mut edge.points).for_each(milli2);
    map.line_markings.iter_mut().flat_map(|line| &mut line.points).for_each(milli2);
    map.crosswalks.iter_mut().flat_map(|crosswalk| &mut crosswalk.polygon).for_each(milli2);
    map.stop_lines.iter_mut().flat_map(|stop| &mut stop.points).for_each(milli2);
    for light in &mut map.traffic_lights {
        for value in [&mut light.position.x, &mut light.position.y, &mut light.position.z] {
            milli(value);
        }
        fine(&mut light.facing_rad);
    }
    for structure in &mut map.structures {
        structure.outline.iter_mut().for_each(milli2);
        [&mut structure.bottom_m, &mut structure.top_m].into_iter().for_each(milli);
    }
}

fn points(writer: &mut DigestWriter, points: &[DVec2]) {
    writer.u64(points.len() as u64);
    for point in points {
        writer.f64s(&[point.x, point.y]);
    }
}

/// Returns the digest of all that a scene holds, in the order of the format; how a file is laid out has no part in it.
/// Kinds count by their place in their enums.
pub(crate) fn digest(scene: &Scene) -> Digest {
    let mut writer = DigestWriter::new();
    writer.text("dreamstream-scenario/1").text(&scene.name).text(&scene.family).i64(scene.dt.0).text(&scene.prompt);
    let origin = &scene.origin;
    writer.text(&origin.source).text(&origin.licence).text(&origin.attribution);
    digest_map(&mut writer, &scene.map);
    let vehicle = &scene.vehicle;
    writer.f64s(&[vehicle.size.length_m, vehicle.size.width_m, vehicle.size.height_m, vehicle.wheel_base_m]);
    writer.f64s(&[vehicle.rear_axle_to_centre_m, vehicle.max_steering_rad, vehicle.max_steering_rate_radps]);
    writer.f64s(&[vehicle.max_acceleration_mps2, vehicle.max_deceleration_mps2, vehicle.mass_kg]);
    writer.u64(scene.ego_log.len() as u64);
    for state in &scene.ego_log {
        writer.f64s(&[state.pose.position.x, state.pose.position.y, state.pose.heading_rad]);
        writer.f64s(&[state.velocity_mps.x, state.velocity_mps.y, state.yaw_rate_radps]);
        writer.f64s(&[state.acceleration_mps2.x, state.acceleration_mps2.y]);
        writer.f64s(&[state.steering_rad, state.steering_rate_radps]);
    }
    points(&mut writer, &scene.route);
    writer.u64(scene.tracks.len() as u64);
    for track in &scene.tracks {
        digest_track(&mut writer, track);
    }
    writer.u64(scene.cameras.len() as u64);
    for camera in &scene.cameras {
        let (lens, mounting) = (&camera.intrinsics, &camera.rig_from_camera);
        writer.text(camera.id.as_str()).u32(lens.width_px).u32(lens.height_px);
        writer.f64s(&[lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px, lens.k1, lens.k2]);
        writer.f64s(&mounting.translation.to_array()).f64s(&mounting.rotation.to_array());
    }
    // Scenes without adversary or structures keep the digest that they had before there were any.
    if let Some(adversary) = &scene.adversary {
        digest_adversary(&mut writer, adversary);
    }
    if !scene.map.structures.is_empty() {
        digest_structures(&mut writer, &scene.map.structures);
    }
    writer.finish()
}

fn digest_structures(writer: &mut DigestWriter, structures: &[Structure]) {
    writer.text("structures").u64(structures.len() as u64);
    for structure in structures {
        writer.u32(structure.kind as u32).f64s(&[structure.bottom_m, structure.top_m]);
        points(writer, &structure.outline);
    }
}

fn digest_adversary(writer: &mut DigestWriter, adversary: &Adversary) {
    writer.text("adversary").u32(adversary.track.0).text(adversary.class.name()).text(adversary.mode.name());
    writer.u32(adversary.attack.0).u32(adversary.contact.0);
    let budget = &adversary.budget;
    writer.f64s(&[budget.attack_secs, budget.effort_mps, budget.aside_m]).u32(budget.reaims);
    points(writer, &adversary.corridor);
}

fn digest_track(writer: &mut DigestWriter, track: &Track) {
    writer.text(&track.name).u32(track.class as u32);
    writer.f64s(&[track.size.length_m, track.size.width_m, track.size.height_m]);
    writer.u64(track.points.len() as u64);
    for point in &track.points {
        writer.bool(point.is_some());
        if let Some(point) = point {
            writer.f64s(&[point.pose.position.x, point.pose.position.y, point.pose.heading_rad, point.z_m]);
            writer.f64s(&[point.velocity_mps.x, point.velocity_mps.y]);
        }
    }
}

fn digest_map(writer: &mut DigestWriter, map: &Map) {
    writer.u64(map.lanes.len() as u64);
    for lane in &map.lanes {
        writer.text(&lane.name).bool(lane.kind == LaneKind::Connector);
        points(writer, &lane.centre_line);
        points(writer, &lane.polygon);
        writer.f64(lane.speed_limit_mps.unwrap_or(-1.0));
        for lanes in [&lane.successors, &lane.predecessors] {
            writer.u64(lanes.len() as u64);
            lanes.iter().for_each(|id| {
                writer.u32(id.0);
            });
        }
        for side in [lane.left, lane.right] {
            writer.u32(side.map_or(u32::MAX, |id| id.0));
        }
    }
    for polygons in [&map.junctions, &map.drivable] {
        writer.u64(polygons.len() as u64);
        polygons.iter().for_each(|polygon| points(writer, polygon));
    }
    writer.u64(map.road_edges.len() as u64);
    map.road_edges.iter().for_each(|edge| points(writer, &edge.points));
    writer.u64(map.line_markings.len() as u64);
    for line in &map.line_markings {
        writer.u32(line.kind as u32).bool(line.colour == LineColour::Yellow);
        points(writer, &line.points);
    }
    writer.u64(map.crosswalks.len() as u64);
    map.crosswalks.iter().for_each(|crosswalk| points(writer, &crosswalk.polygon));
    writer.u64(map.stop_lines.len() as u64);
    for stop in &map.stop_lines {
        points(writer, &stop.points);
        writer.u32(stop.light.unwrap_or(u32::MAX));
    }
    writer.u64(map.traffic_lights.len() as u64);
    for light in &map.traffic_lights {
        writer.f64s(&light.position.to_array()).f64(light.facing_rad).u64(light.lanes.len() as u64);
        light.lanes.iter().for_each(|id| {
            writer.u32(id.0);
        });
        writer.u64(light.states.len() as u64);
        for state in &light.states {
            writer.u32(*state as u32);
        }
    }
}
