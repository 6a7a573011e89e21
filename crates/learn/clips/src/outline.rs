//! The rectangle of an agent's box in a picture.

use ds_space::{CameraModel, DVec2, DVec3, Pose, Rig, World};
use ds_world::AgentState;

/// What is nearer to the camera's plane is cut off, in metres.
const NEAR_M: f64 = 0.1;

/// Returns left, top, right and bottom of the box's projection within the picture, in pixels; `None` if it is not seen.
#[must_use]
pub fn outline(agent: &AgentState, camera: &CameraModel, world_from_rig: Pose<World, Rig>) -> Option<[f64; 4]> {
    let camera_from_world = (world_from_rig * camera.rig_from_camera).inverse();
    let levels = [agent.z_m, agent.z_m + agent.size.height_m];
    let corners: Vec<DVec3> =
        levels.iter().flat_map(|z_m| agent.corners().map(|corner| camera_from_world * corner.extend(*z_m))).collect();
    // Corner i of the bottom is joined to its neighbours and to corner i + 4 of the top.
    let edges = (0..4).flat_map(|i| [(i, (i + 1) % 4), (i + 4, (i + 1) % 4 + 4), (i, i + 4)]);
    let mut bounds: Option<(DVec2, DVec2)> = None;
    for (a, b) in edges {
        let (a, b) = (corners[a], corners[b]);
        if a.z < NEAR_M && b.z < NEAR_M {
            continue;
        }
        let cut = |from: DVec3, to: DVec3| {
            if from.z >= NEAR_M { from } else { from.lerp(to, (NEAR_M - from.z) / (to.z - from.z)) }
        };
        for end in [cut(a, b), cut(b, a)] {
            if let Some(pixel) = camera.intrinsics.project(end) {
                bounds = Some(bounds.map_or((pixel, pixel), |(low, high)| (low.min(pixel), high.max(pixel))));
            }
        }
    }
    let (low, high) = bounds?;
    let size = DVec2::new(f64::from(camera.intrinsics.width_px), f64::from(camera.intrinsics.height_px));
    let (low, high) = (low.clamp(DVec2::ZERO, size), high.clamp(DVec2::ZERO, size));
    (high.x - low.x > 0.5 && high.y - low.y > 0.5).then_some([low.x, low.y, high.x, high.y])
}
