//! A reference plan made on the scene, in the manner of PDM-Closed: fifteen proposals, scored by the score, best kept.
//!
//! Three paths beside the centreline (0, +1, −1 m) times five shares of the speed limit. Along each path the speed follows
//! the intelligent driver model behind the nearest thing on it: an agent of the scene at its own future places, or a red
//! connector. The offset eases from the present one within 2 s. Our own planner: it equals the reference's in parameters
//! and in kind, not in digits.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use ds_space::plane::{Line, OrientedBox};
use ds_space::{DVec2, PoseSe2};
use ds_vehicle::Lead;

use crate::constants::horizon::{DT_S, STATES, STEPS};
use crate::constants::planner::{
    EASE_S, FALLBACK_LIMIT_MPS, FOLLOWER, FORM, LATERAL_OFFSETS_M, SIDE_CLEARANCE_M, SPEED_FRACTIONS,
};
use crate::epdms::{Measured, measure};
use crate::error::ScoreError;
use crate::metric::ego_progress;
use crate::motion::PlannedPoses;
use crate::proposal::Memory;
use crate::scene::PreparedScene;

/// The reference plan and what became of it.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferencePlan {
    /// The plan, 40 poses at 0.1 s.
    pub plan: PlannedPoses,
    /// Its offset from the centreline, in metres, left positive.
    pub offset_m: f64,
    /// Its share of the speed limit.
    pub speed_fraction: f64,
    /// Its total among the proposals, without EC.
    pub epdms: f64,
}

/// Makes the reference plan of a scene; `speed_limit_mps` is that of the ego's lane, 15 m/s if unknown.
///
/// # Errors
/// [`ScoreError`] if the executed proposals cannot be measured.
pub fn reference_plan(scene: &PreparedScene, speed_limit_mps: Option<f64>) -> Result<ReferencePlan, ScoreError> {
    let limit_mps = speed_limit_mps.filter(|limit| *limit > 0.0).unwrap_or(FALLBACK_LIMIT_MPS);
    let road = Road::new(scene);
    let mut memory = Memory::default();
    let mut proposals: Vec<(ReferencePlan, Measured)> = Vec::new();
    for offset_m in LATERAL_OFFSETS_M {
        for speed_fraction in SPEED_FRACTIONS {
            let along_m = road.drive(offset_m, speed_fraction * limit_mps);
            let plan = road.plan(&along_m, offset_m);
            let states = scene.executor().execute(scene.ego(), &plan)?;
            let measured = measure(scene, &[&scene.traffic], scene.past.as_deref(), &states, &mut memory);
            proposals.push((ReferencePlan { plan, offset_m, speed_fraction, epdms: 0.0 }, measured));
        }
    }
    let best_m = ego_progress::best_m(proposals.iter().map(|(_, measured)| measured.progress()));
    let mut best: Option<ReferencePlan> = None;
    for (mut plan, measured) in proposals {
        plan.epdms = measured.with_progress(best_m).scores.epdms(None);
        if best.as_ref().is_none_or(|best| plan.epdms > best.epdms) {
            best = Some(plan);
        }
    }
    Ok(best.expect("there are fifteen proposals"))
}

/// Something on the road at one step: where it begins and ends along the centreline, and across.
#[derive(Debug, Clone, Copy)]
struct Obstacle {
    rear_m: f64,
    speed_mps: f64,
    /// Range of offsets from the centreline that it covers, in metres.
    covers_m: (f64, f64),
}

/// The centreline as a road with the ego and everything else on it.
struct Road<'a> {
    scene: &'a PreparedScene,
    line: &'a Line,
    start_m: f64,
    offset_m: f64,
    obstacles: Vec<Vec<Obstacle>>,
}

impl<'a> Road<'a> {
    fn new(scene: &'a PreparedScene) -> Self {
        let line = scene.map.centreline();
        let (start_m, offset_m) = place(line, scene.ego().position());
        let mut obstacles: Vec<Vec<Obstacle>> = vec![Vec::new(); STATES];
        for agent in scene.traffic.agents() {
            let spans: Vec<Option<Obstacle>> =
                agent.boxes.iter().map(|one| one.as_ref().map(|one| span(line, one))).collect();
            for (step, obstacle) in spans.iter().enumerate() {
                let Some(mut obstacle) = *obstacle else { continue };
                let neighbour = if step > 0 { spans[step - 1] } else { spans.get(1).copied().flatten() };
                let moved_m = neighbour.map_or(0.0, |neighbour| (obstacle.rear_m - neighbour.rear_m).abs());
                let forwards = neighbour.is_some_and(|other| (other.rear_m < obstacle.rear_m) == (step > 0));
                obstacle.speed_mps = if forwards { moved_m / DT_S } else { 0.0 };
                obstacles[step].push(obstacle);
            }
        }
        let mut entries: BTreeMap<u32, Option<f64>> = BTreeMap::new();
        for (step, red) in scene.red.iter().enumerate() {
            let mut entry_m = |id: &u32| *entries.entry(*id).or_insert_with(|| entry_m(scene, line, *id, start_m));
            let stops = red.iter().filter_map(&mut entry_m);
            obstacles[step].extend(stops.map(|rear_m| Obstacle {
                rear_m,
                speed_mps: 0.0,
                covers_m: (f64::NEG_INFINITY, f64::INFINITY),
            }));
        }
        Self { scene, line, start_m, offset_m, obstacles }
    }

    /// Returns how far along the centreline the rear axle is at each step, in metres.
    fn drive(&self, offset_m: f64, target_mps: f64) -> [f64; STATES] {
        let footprint = self.scene.footprint();
        let front_m = footprint.rear_axle_to_centre_m + 0.5 * footprint.length_m;
        let half_m = 0.5 * footprint.width_m + SIDE_CLEARANCE_M;
        let mut along_m = [self.start_m; STATES];
        let mut speed_mps = self.scene.ego().vx_mps.max(0.0);
        for step in 0..STEPS {
            let aside_m = self.offset_at(step, offset_m);
            let nose_m = along_m[step] + front_m;
            let blocks = |obstacle: &&Obstacle| {
                obstacle.rear_m > nose_m - footprint.length_m
                    && obstacle.covers_m.0 < aside_m + half_m
                    && obstacle.covers_m.1 > aside_m - half_m
            };
            let leader = self.obstacles[step].iter().filter(blocks).min_by(|a, b| a.rear_m.total_cmp(&b.rear_m));
            let leader = leader.map(|one| Lead { gap_m: one.rear_m - nose_m, speed_mps: one.speed_mps });
            let acceleration = FOLLOWER.acceleration_by(&FORM, speed_mps, target_mps, leader);
            along_m[step + 1] = along_m[step] + speed_mps * DT_S;
            speed_mps = (speed_mps + acceleration * DT_S).max(0.0);
        }
        along_m
    }

    fn offset_at(&self, step: usize, offset_m: f64) -> f64 {
        let share = (step as f64 * DT_S / EASE_S).min(1.0);
        let eased = 0.5 - 0.5 * (PI * share).cos();
        self.offset_m + (offset_m - self.offset_m) * eased
    }

    fn plan(&self, along_m: &[f64; STATES], offset_m: f64) -> PlannedPoses {
        let points: [DVec2; STATES] = std::array::from_fn(|step| {
            let (point, direction) = on_line(self.line, along_m[step]);
            point + direction.perp() * self.offset_at(step, offset_m)
        });
        let ego = self.scene.ego().pose();
        let mut heading_rad = ego.heading_rad;
        let poses = (1..STATES).map(|step| {
            let moved = points[step] - points[step - 1];
            // A standing car keeps its heading.
            if moved.length() > 1e-3 {
                heading_rad = moved.to_angle();
            }
            ego.relative(&PoseSe2 { position: points[step], heading_rad })
        });
        PlannedPoses { dt_s: DT_S, poses: poses.collect() }
    }
}

/// Returns distance along and signed offset of a point, in metres.
fn place(line: &Line, point: DVec2) -> (f64, f64) {
    let nearest = line.nearest(point);
    let side = line.direction(nearest.segment).perp_dot(point - line.points()[nearest.segment]);
    (nearest.along_m, nearest.distance_squared.sqrt().copysign(side))
}

/// Returns the point and direction at a distance along, the line going on straight at both ends.
fn on_line(line: &Line, along_m: f64) -> (DVec2, DVec2) {
    let direction = line.direction(line.segment_at(along_m));
    let inside_m = along_m.clamp(0.0, line.length_m());
    (line.at(along_m) + direction * (along_m - inside_m), direction)
}

fn span(line: &Line, one: &OrientedBox) -> Obstacle {
    let (along_m, offset_m) = place(line, one.centre);
    let direction = line.direction(line.segment_at(along_m));
    let (cos, sin) = (one.forward.dot(direction).abs(), one.forward.perp_dot(direction).abs());
    let across_m = one.half_length_m * sin + one.half_width_m * cos;
    let half_m = one.half_length_m * cos + one.half_width_m * sin;
    Obstacle { rear_m: along_m - half_m, speed_mps: 0.0, covers_m: (offset_m - across_m, offset_m + across_m) }
}

/// Returns where the centreline enters an area ahead of a place, in metres; `None` if it never does or is in it already.
fn entry_m(scene: &PreparedScene, line: &Line, area: u32, from_m: f64) -> Option<f64> {
    let polygon = &scene.map.areas.polygons[area as usize];
    let holds = |along_m: f64| polygon.holds(line.at(along_m));
    if holds(from_m) {
        return None;
    }
    let ahead_m = line.length_m() - from_m;
    (1..=(2.0 * ahead_m.max(0.0)) as u32).map(|half| from_m + 0.5 * f64::from(half)).find(|along_m| holds(*along_m))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::road;
    use crate::scene::{AreaKind, OpenLoopScene};

    fn planned(scene: &OpenLoopScene) -> (ReferencePlan, crate::epdms::NavsimV2) {
        let prepared = PreparedScene::new(scene).expect("a sound scene");
        let reference = reference_plan(&prepared, Some(10.0)).expect("a sound scene");
        let yardstick = crate::epdms::Yardstick::new(&prepared, &reference.plan, None).expect("a sound plan");
        let score = yardstick.score(&prepared, &reference.plan).expect("a sound plan");
        (reference, score)
    }

    #[test]
    fn a_free_road_is_driven_at_the_limit_on_the_centreline() {
        let (reference, score) = planned(&road::scene(10.0));
        assert_eq!((reference.offset_m, reference.speed_fraction), (0.0, 1.0));
        assert!(score.progress_raw_m > 39.0 && score.epdms == 1.0, "{score:?}");
    }

    #[test]
    fn a_standing_car_and_a_red_light_are_stopped_for() {
        let mut blocked = road::scene(10.0);
        blocked.now.agents.push(road::standing(1, 40.0, 0.0));
        let mut red = road::scene(10.0);
        red.map.areas.push(road::area(AreaKind::LaneConnector, true, [35.0, -1.75, 50.0, 1.75]));
        red.now.red_areas = vec![vec![red.map.areas.len() - 1]; 41];
        for scene in [blocked, red] {
            let (reference, score) = planned(&scene);
            assert_eq!(score.scores.multipliers(), 1.0, "{reference:?}");
            assert!(score.progress_raw_m > 10.0 && score.progress_raw_m < 32.0, "{}", score.progress_raw_m);
        }
    }
}
