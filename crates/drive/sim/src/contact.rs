//! Contacts of the ego body with agents: boxes by rapier's narrow phase after a distance test, kind and fault by rule.
//!
//! Kind: rear if the agent's centre lies more than 150° off the heading as seen from the rear axle, else front if the
//! front edge touches the box, else side. Fault: none while the ego stands (≤ 0.05 m/s), else with any standing agent
//! and in front contacts; side contacts depend on the road and are judged by the score.

use ds_space::{AgentId, DVec2, PoseSe2, Vec3};
use ds_world::agent::corners;
use ds_world::{AgentState, Contact, ContactKind, EgoState, VehicleParameters};
use rapier3d::parry::math::{Pose, Rotation};
use rapier3d::parry::query::sat;
use rapier3d::parry::shape::Cuboid;

const STANDING_MPS: f64 = 0.05;
/// Cosine of 150°.
const REAR_COSINE: f64 = -0.866_025_403_784_438_6;
/// Boxes are tested in the plane, as columns of this half height, once their height ranges overlap.
const HALF_COLUMN_M: f32 = 10.0;

/// Fills in the contacts of the ego, in the order of the agents.
pub(crate) fn find(ego: &EgoState, vehicle: &VehicleParameters, agents: &[AgentState], out: &mut Vec<Contact>) {
    out.clear();
    let centre = ego.centre(vehicle);
    let ego_radius_m = 0.5 * vehicle.size.length_m.hypot(vehicle.size.width_m);
    for agent in agents {
        let reach_m = ego_radius_m + 0.5 * agent.size.length_m.hypot(agent.size.width_m);
        let apart = (agent.pose.position - centre.position).length_squared() > reach_m * reach_m;
        if apart || agent.z_m > vehicle.size.height_m || agent.z_m + agent.size.height_m < 0.0 {
            continue;
        }
        if let Some(touch) = touch(&centre, vehicle, agent) {
            out.push(judge(ego, vehicle, agent, touch));
        }
    }
}

/// Where two boxes touch: a point of the ego body and the unit normal towards the other, in the frame of its centre.
#[derive(Debug, Clone, Copy)]
struct Touch {
    point: DVec2,
    normal: DVec2,
}

fn touch(centre: &PoseSe2, vehicle: &VehicleParameters, agent: &AgentState) -> Option<Touch> {
    let relative = centre.relative(&agent.pose);
    let position = relative.position.as_vec2().extend(0.0);
    #[expect(clippy::cast_possible_truncation, reason = "an angle and lengths within metres of the ego")]
    let (turn, sizes) = (
        relative.heading_rad as f32,
        [vehicle.size.length_m, vehicle.size.width_m, agent.size.length_m, agent.size.width_m].map(|m| 0.5 * m as f32),
    );
    let ego_box = Cuboid::new(Vec3::new(sizes[0], sizes[1], HALF_COLUMN_M));
    let agent_box = Cuboid::new(Vec3::new(sizes[2], sizes[3], HALF_COLUMN_M));
    let agent_from_centre = Pose::from_parts(position, Rotation::from_rotation_z(turn));
    // Separating axes are the face normals of both: edges of upright boxes add none.
    let (ego_gap, ego_axis) =
        sat::cuboid_cuboid_find_local_separating_normal_oneway(&ego_box, &agent_box, &agent_from_centre);
    let (agent_gap, agent_axis) =
        sat::cuboid_cuboid_find_local_separating_normal_oneway(&agent_box, &ego_box, &agent_from_centre.inverse());
    if ego_gap > 0.0 || agent_gap > 0.0 {
        return None;
    }
    let axis = if ego_gap >= agent_gap { ego_axis } else { agent_from_centre.rotation * -agent_axis };
    let normal = axis.truncate().as_dvec2().normalize_or(relative.position.normalize_or(DVec2::X));
    let half = DVec2::new(0.5 * vehicle.size.length_m, 0.5 * vehicle.size.width_m);
    let deepest = corners(&relative, agent.size.length_m, agent.size.width_m)
        .into_iter()
        .min_by(|a, b| a.dot(normal).total_cmp(&b.dot(normal)))
        .unwrap_or(relative.position);
    Some(Touch { point: deepest.clamp(-half, half), normal })
}

fn judge(ego: &EgoState, vehicle: &VehicleParameters, agent: &AgentState, touch: Touch) -> Contact {
    let kind = kind(ego, vehicle, agent);
    let ego_standing = ego.velocity_mps.length() <= STANDING_MPS;
    let agent_standing = agent.class.is_static() || agent.velocity_mps.length() <= STANDING_MPS;
    let arm = touch.point + DVec2::new(vehicle.rear_axle_to_centre_m, 0.0);
    let ego_mps = ego.velocity_mps + ego.yaw_rate_radps * arm.perp();
    let agent_mps = DVec2::new(agent.velocity_mps.dot(ego.pose.forward()), agent.velocity_mps.dot(ego.pose.left()));
    Contact {
        agent: AgentId(agent.id.0),
        kind,
        at_fault: !ego_standing && (agent_standing || kind == ContactKind::Front),
        closing_speed_mps: (ego_mps - agent_mps).dot(touch.normal).max(0.0),
    }
}

fn kind(ego: &EgoState, vehicle: &VehicleParameters, agent: &AgentState) -> ContactKind {
    let bearing = (agent.pose.position - ego.pose.position).normalize_or(ego.pose.forward());
    if bearing.dot(ego.pose.forward()) < REAR_COSINE {
        return ContactKind::Rear;
    }
    let body = corners(&ego.centre(vehicle), vehicle.size.length_m, vehicle.size.width_m);
    if segment_meets_box(agent, [body[0], body[3]]) { ContactKind::Front } else { ContactKind::Side }
}

/// Says whether a segment touches the box of an agent (closed sets).
fn segment_meets_box(agent: &AgentState, ends: [DVec2; 2]) -> bool {
    let [from, to] = ends.map(|end| agent.pose.to_local(end));
    let step = to - from;
    let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
    for (start, change, half) in
        [(from.x, step.x, 0.5 * agent.size.length_m), (from.y, step.y, 0.5 * agent.size.width_m)]
    {
        if change.abs() < 1e-12 {
            if start.abs() > half {
                return false;
            }
            continue;
        }
        let (a, b) = ((-half - start) / change, (half - start) / change);
        enter = enter.max(a.min(b));
        leave = leave.min(a.max(b));
    }
    enter <= leave
}

#[cfg(test)]
mod tests {
    use ds_world::{AgentClass, Size};

    use super::*;

    fn ego(speed_mps: f64) -> EgoState {
        EgoState { velocity_mps: DVec2::new(speed_mps, 0.0), ..EgoState::default() }
    }

    /// An agent of 4 x 2 m at a pose relative to the rear axle of a 4.084 x 1.73 m ego, moving along its heading.
    fn agent(x_m: f64, y_m: f64, heading_rad: f64, speed_mps: f64) -> AgentState {
        let pose = PoseSe2::new(x_m, y_m, heading_rad);
        AgentState {
            id: AgentId(7),
            class: AgentClass::Vehicle,
            size: Size { length_m: 4.0, width_m: 2.0, height_m: 1.5 },
            pose,
            z_m: 0.0,
            velocity_mps: pose.forward() * speed_mps,
        }
    }

    fn found(ego: &EgoState, agent: &AgentState) -> Option<Contact> {
        let mut out = Vec::new();
        find(ego, &VehicleParameters::ZOE, std::slice::from_ref(agent), &mut out);
        out.first().copied()
    }

    #[test]
    fn kinds_and_fault_by_table() {
        use ContactKind::{Front, Rear, Side};
        // Ego reaches from -0.832 to 3.252 m along x and ±0.865 m across.
        for (what, ego_mps, other, expected) in [
            ("clear ahead", 10.0, agent(5.4, 0.0, 0.0, 0.0), None),
            ("rear-ends a moving car", 10.0, agent(5.0, 0.0, 0.0, 5.0), Some((Front, true, 5.0))),
            ("drives into a standing car", 10.0, agent(5.0, 0.0, 0.0, 0.0), Some((Front, true, 10.0))),
            ("is hit from behind", 5.0, agent(-2.7, 0.0, 0.0, 9.0), Some((Rear, false, 4.0))),
            ("scrapes a parked car", 5.0, agent(1.0, 1.8, 0.0, 0.0), Some((Side, true, 0.0))),
            ("is scraped by a moving car", 5.0, agent(1.0, 1.8, 0.0, 6.0), Some((Side, false, 0.0))),
            (
                "is hit across while standing",
                0.0,
                agent(1.0, 2.8, -std::f64::consts::FRAC_PI_2, 6.0),
                Some((Side, false, 6.0)),
            ),
            ("stands nose to nose", 0.0, agent(5.0, 0.0, std::f64::consts::PI, 2.0), Some((Front, false, 2.0))),
        ] {
            let got = found(&ego(ego_mps), &other);
            assert_eq!(got.map(|c| (c.kind, c.at_fault)), expected.map(|(kind, fault, _)| (kind, fault)), "{what}");
            if let (Some(got), Some((_, _, closing))) = (got, expected) {
                assert!((got.closing_speed_mps - closing).abs() < 1e-3, "{what}: {}", got.closing_speed_mps);
            }
        }
    }

    #[test]
    fn what_is_overhead_does_not_touch() {
        let mut bridge = agent(2.0, 0.0, 0.0, 0.0);
        bridge.z_m = 3.0;
        assert_eq!(found(&ego(5.0), &bridge), None);
    }

    #[test]
    fn the_narrow_phase_agrees_with_separating_axes() {
        // The same boxes by the four face normals in double precision, skipping cases within 1 mm of touching.
        let draws = ds_space::Draws::from_seed(3, "contact");
        let (mut met, mut parted) = (0, 0);
        for i in 0..2000 {
            let other = agent(
                draws.range(4 * i, -5.0, 8.0),
                draws.range(4 * i + 1, -4.0, 4.0),
                draws.range(4 * i + 2, -3.1, 3.1),
                1.0,
            );
            let gap_m = separation(&ego(1.0).corners(&VehicleParameters::ZOE), &other.corners());
            if gap_m.abs() > 1e-3 {
                assert_eq!(found(&ego(1.0), &other).is_some(), gap_m < 0.0, "{:?}: {gap_m}", other.pose);
                if gap_m < 0.0 { met += 1 } else { parted += 1 }
            }
        }
        assert!(met > 200 && parted > 200, "{met} met, {parted} parted");
    }

    fn separation(a: &[DVec2; 4], b: &[DVec2; 4]) -> f64 {
        let axes = [a[0] - a[1], a[1] - a[2], b[0] - b[1], b[1] - b[2]].map(DVec2::normalize);
        axes.into_iter()
            .map(|axis| {
                let range = |corners: &[DVec2; 4]| {
                    corners.iter().map(|c| c.dot(axis)).fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)))
                };
                let ((al, ah), (bl, bh)) = (range(a), range(b));
                (bl - ah).max(al - bh)
            })
            .fold(f64::MIN, f64::max)
    }
}
