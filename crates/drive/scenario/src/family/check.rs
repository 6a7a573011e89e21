//! What makes a generated scenario plausible: nobody overlaps, the expert keeps to the road and within comfort bounds.

use ds_space::plane::{oriented_box::overlap, polygon::holds};
use ds_space::{DVec2, Tick};
use ds_world::agent::corners;
use ds_world::{AgentClass, Scene, Track};

/// Bounds that every expert log keeps (the usual comfort bounds; accelerations, jerk, rates).
pub(crate) const ACCELERATION_MPS2: (f64, f64) = (-4.05, 2.4);
pub(crate) const LATERAL_MPS2: f64 = 4.0;
pub(crate) const JERK_MPS3: f64 = 4.13;
pub(crate) const YAW_RATE_RADPS: f64 = 0.95;
pub(crate) const YAW_ACCELERATION_RADPS2: f64 = 1.93;
/// The room that the expert keeps to everyone.
pub(crate) const CLEARANCE_M: f64 = 0.25;

/// Says what is wrong with an expert log or the traffic around it, if anything.
pub(crate) fn fault(scene: &Scene) -> Option<String> {
    limits(scene)
        .or_else(|| leaves_road(scene))
        .or_else(|| touches(scene))
        .or_else(|| overlapping(scene).map(|(a, b)| format!("{a} overlaps {b}")))
}

fn limits(scene: &Scene) -> Option<String> {
    let dt = scene.dt.secs();
    for (tick, pair) in scene.ego_log.windows(2).enumerate() {
        let (a, b) = (&pair[0], &pair[1]);
        let acceleration = (b.velocity_mps.x - a.velocity_mps.x) / dt;
        let jerk = (b.acceleration_mps2.x - a.acceleration_mps2.x) / dt;
        let yaw_acceleration = (b.yaw_rate_radps - a.yaw_rate_radps) / dt;
        let sound = acceleration > ACCELERATION_MPS2.0
            && acceleration < ACCELERATION_MPS2.1
            && b.acceleration_mps2.y.abs() < LATERAL_MPS2
            && jerk.abs() < JERK_MPS3
            && b.yaw_rate_radps.abs() < YAW_RATE_RADPS
            && yaw_acceleration.abs() < YAW_ACCELERATION_RADPS2;
        if !sound {
            let lateral = b.acceleration_mps2.y;
            let yaw_rate = b.yaw_rate_radps;
            return Some(format!(
                "tick {tick}: acceleration {acceleration}, lateral {lateral}, jerk {jerk}, yaw rate {yaw_rate}, yaw acceleration {yaw_acceleration}"
            ));
        }
    }
    let driven: f64 = scene.ego_log.windows(2).map(|pair| pair[0].pose.position.distance(pair[1].pose.position)).sum();
    (driven < 20.0).then(|| format!("the expert drives {driven} m only"))
}

fn leaves_road(scene: &Scene) -> Option<String> {
    for (tick, state) in scene.ego_log.iter().enumerate() {
        for corner in state.corners(&scene.vehicle) {
            if !scene.map.drivable.iter().any(|polygon| holds(polygon, corner)) {
                return Some(format!("tick {tick}: corner {corner} leaves the road"));
            }
        }
    }
    None
}

fn box_of(track: &Track, tick: usize, grow_m: f64) -> Option<[DVec2; 4]> {
    let point = track.at(Tick(u32::try_from(tick).ok()?))?;
    Some(corners(&point.pose, track.size.length_m + grow_m, track.size.width_m + grow_m))
}

fn near(a: &[DVec2; 4], b: &[DVec2; 4]) -> bool {
    a[0].distance_squared(b[0]) < 25.0 * 25.0
}

/// Returns the index of a track that the expert comes too close to, with what to say of it.
fn touched(scene: &Scene) -> Option<(usize, usize)> {
    for (tick, state) in scene.ego_log.iter().enumerate() {
        let ego = state.corners(&scene.vehicle);
        for (i, track) in scene.tracks.iter().enumerate() {
            let grow_m =
                if track.class == AgentClass::Pedestrian { 2.0 * CLEARANCE_M + 0.3 } else { 2.0 * CLEARANCE_M };
            if box_of(track, tick, grow_m).is_some_and(|other| near(&ego, &other) && overlap(&ego, &other)) {
                return Some((tick, i));
            }
        }
    }
    None
}

fn touches(scene: &Scene) -> Option<String> {
    touched(scene).map(|(tick, i)| format!("tick {tick}: the expert comes too close to {}", scene.tracks[i].name))
}

fn overlapping(scene: &Scene) -> Option<(String, String)> {
    let walks = |track: &Track| track.class == AgentClass::Pedestrian;
    for tick in 0..scene.ego_log.len() {
        let boxes: Vec<Option<[DVec2; 4]>> = scene.tracks.iter().map(|track| box_of(track, tick, 0.0)).collect();
        for (i, a) in boxes.iter().enumerate() {
            for (j, b) in boxes.iter().enumerate().skip(i + 1) {
                let both_walk = walks(&scene.tracks[i]) && walks(&scene.tracks[j]);
                if let (false, Some(a), Some(b)) = (both_walk, a, b)
                    && near(a, b)
                    && overlap(a, b)
                {
                    return Some((scene.tracks[i].name.clone(), scene.tracks[j].name.clone()));
                }
            }
        }
    }
    None
}

/// Takes out of a scene every track that the expert or another track comes too close to.
pub(crate) fn thin_out(scene: &mut Scene) {
    while let Some((_, i)) = touched(scene) {
        scene.tracks.remove(i);
    }
    while let Some((_, name)) = overlapping(scene) {
        scene.tracks.retain(|track| track.name != name);
    }
}
