//! Boxes of agents as a camera sees them: world boxes → line strips in pixels.
//!
//! Each of the twelve edges is cut at the near plane, projected with the camera's lens, and cut at the picture's border.
//! Nothing is hidden behind anything.

use ds_space::pose::Camera;
use ds_space::{CameraModel, DVec2, DVec3, Pose, PoseSe2, World};
use ds_world::AgentState;

/// Edges nearer than this are cut, in metres.
const NEAR_M: f64 = 0.3;
/// Boxes farther than this are not drawn, in metres.
const RANGE_M: f64 = 80.0;
/// The twelve edges; corners 0 to 3 are the bottom, 4 to 7 the top above them.
const EDGES: [(usize, usize); 12] =
    [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)];

/// Returns the edges of an agent's box that a camera sees, in pixels.
pub(crate) fn edges(camera: &CameraModel, ego_in_world: &PoseSe2, agent: &AgentState) -> Vec<[[f32; 2]; 2]> {
    let camera_from_world: Pose<Camera, World> = (ego_in_world.world_from_rig(0.0) * camera.rig_from_camera).inverse();
    if agent.pose.position.distance(ego_in_world.position) > RANGE_M {
        return Vec::new();
    }
    let base = agent.corners();
    let corner = |index: usize| {
        let z_m = agent.z_m + if index < 4 { 0.0 } else { agent.size.height_m };
        camera_from_world * base[index % 4].extend(z_m)
    };
    EDGES.iter().filter_map(|(from, to)| edge(camera, corner(*from), corner(*to))).collect()
}

#[expect(clippy::cast_possible_truncation, reason = "the viewer works in single precision")]
fn edge(camera: &CameraModel, from: DVec3, to: DVec3) -> Option<[[f32; 2]; 2]> {
    let (from, to) = clipped(from, to)?;
    let ends = (camera.intrinsics.project(from)?, camera.intrinsics.project(to)?);
    let size = DVec2::new(camera.intrinsics.width_px.into(), camera.intrinsics.height_px.into());
    let (from, to) = within(size, ends.0, ends.1)?;
    Some([from, to].map(|pixel| [pixel.x as f32, pixel.y as f32]))
}

/// Cuts a line at the border of a picture (Liang and Barsky).
fn within(size: DVec2, from: DVec2, to: DVec2) -> Option<(DVec2, DVec2)> {
    let along = to - from;
    let (mut enter, mut leave) = (0.0f64, 1.0f64);
    let borders = [(-along.x, from.x), (along.x, size.x - from.x), (-along.y, from.y), (along.y, size.y - from.y)];
    for (outwards, room) in borders {
        if outwards < 0.0 {
            enter = enter.max(room / outwards);
        } else if outwards > 0.0 {
            leave = leave.min(room / outwards);
        } else if room < 0.0 {
            return None;
        }
    }
    (enter < leave).then(|| (from + along * enter, from + along * leave))
}

fn clipped(from: DVec3, to: DVec3) -> Option<(DVec3, DVec3)> {
    let cut = |front: DVec3, behind: DVec3| front + (behind - front) * ((front.z - NEAR_M) / (front.z - behind.z));
    match (from.z >= NEAR_M, to.z >= NEAR_M) {
        (true, true) => Some((from, to)),
        (true, false) => Some((from, cut(from, to))),
        (false, true) => Some((cut(to, from), to)),
        (false, false) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ds_space::{AgentId, CameraId, Intrinsics};
    use ds_world::{AgentClass, Size};

    fn seen(x_m: f64, y_m: f64) -> Vec<[[f32; 2]; 2]> {
        let id = CameraId::new("front").expect("a plain word is an id");
        let lens = Intrinsics::centred(160, 96, 1.2);
        let camera = CameraModel::mounted(id, lens, DVec3::new(1.5, 0.0, 1.6), 0.0, 0.05);
        let agent = AgentState {
            id: AgentId(0),
            class: AgentClass::Vehicle,
            size: Size { length_m: 4.0, width_m: 2.0, height_m: 1.5 },
            pose: PoseSe2::new(x_m, y_m, 0.0),
            z_m: 0.0,
            velocity_mps: DVec2::ZERO,
        };
        edges(&camera, &PoseSe2::default(), &agent)
    }

    #[test]
    fn a_box_ahead_has_twelve_edges_around_the_middle() {
        let edges = seen(20.0, 0.0);
        assert_eq!(edges.len(), 12);
        assert!(edges.iter().flatten().all(|[x, y]| (70.0..90.0).contains(x) && (30.0..70.0).contains(y)), "{edges:?}");
    }

    #[test]
    fn a_box_behind_is_not_seen_and_one_beside_is_cut() {
        assert_eq!(seen(-10.0, 0.0).len(), 0);
        assert_eq!(seen(200.0, 0.0).len(), 0);
        let beside = seen(6.0, 3.0);
        assert!((1..12).contains(&beside.len()), "{beside:?}");
        let inside = |[x, y]: &[f32; 2]| (-0.01..=160.01).contains(x) && (-0.01..=96.01).contains(y);
        assert!(beside.iter().flatten().all(inside), "{beside:?}");
    }
}
