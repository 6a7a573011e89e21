//! From the simulator's scene to what open-loop scores need: map, tracks of the log, the moment.
//!
//! Lanes come first among the areas, in map order, so that a lane's index is its area's. Drivable surfaces stand for road
//! blocks. The centreline is the scene's route, or the expert's path where there is none.

use ds_space::plane::{Line, corridor};
use ds_space::{DVec2, Tick};
use ds_world::{EgoState, Lane, LaneKind, LightState, Polygon, Scene, Track};

use super::governed::GovernedLanes;
use super::input::{AgentTrack, AreaKind, MapArea, MovingBox, OpenLoopMap, PastState, SceneNow};
use crate::constants::horizon::DT_S;
use crate::constants::strict::{LANE_WIDTH_M, ROUTE_OFFSET_M, ROUTE_SAMPLE_M, ROUTE_SHARE};
use crate::footprint::Footprint;
use crate::motion::VehicleState;

/// How far back the past must reach, in seconds (`scoring.md` §4, HC).
const PAST_S: f64 = 1.5;

/// Returns the path of the expert: the centre of its box at each tick, in metres.
#[must_use]
pub fn expert_path(scene: &Scene) -> Vec<DVec2> {
    scene.ego_log.iter().map(|ego| ego.centre(&scene.vehicle).position).collect()
}

/// Returns the line to drive along: the scene's route, else the expert's path; `None` if neither has a length.
pub(crate) fn route_line(scene: &Scene) -> Option<Line> {
    Line::new(&scene.route).or_else(|| Line::new(&expert_path(scene)))
}

/// Returns the surface of a lane; a strip of 3.5 m where the map gives none.
pub(crate) fn surface_of(lane: &Lane) -> Polygon {
    if lane.polygon.len() >= 3 { lane.polygon.clone() } else { corridor(&lane.centre_line, LANE_WIDTH_M) }
}

/// Says whether most of a lane, as far as it runs beside the route, lies on the route and leads its way.
pub(crate) fn lies_along(centre_line: &[DVec2], route: &Line) -> bool {
    let Some(lane) = Line::new(centre_line) else { return false };
    let (mut beside, mut along) = (0u32, 0u32);
    let samples = (lane.length_m() / ROUTE_SAMPLE_M).ceil().max(1.0);
    for sample in 0..=(samples as u32) {
        let at_m = lane.length_m() * f64::from(sample) / samples;
        let nearest = route.nearest(lane.at(at_m));
        if nearest.along_m <= 0.0 || nearest.along_m >= route.length_m() {
            continue;
        }
        beside += 1;
        let aligned = route.direction(nearest.segment).dot(lane.direction(lane.segment_at(at_m))) > 0.0;
        if aligned && nearest.distance_squared <= ROUTE_OFFSET_M * ROUTE_OFFSET_M {
            along += 1;
        }
    }
    beside > 0 && f64::from(along) >= ROUTE_SHARE * f64::from(beside)
}

/// Returns the map of a scene as open-loop scores see it.
#[must_use]
pub fn open_loop_map(scene: &Scene) -> OpenLoopMap {
    let route = route_line(scene);
    let lane = |lane: &Lane| MapArea {
        kind: if lane.kind == LaneKind::Connector { AreaKind::LaneConnector } else { AreaKind::Lane },
        on_route: route.as_ref().is_some_and(|route| lies_along(&lane.centre_line, route)),
        outline: surface_of(lane),
        holes: Vec::new(),
    };
    let area = |kind: AreaKind| {
        move |outline: &Polygon| MapArea { kind, on_route: false, outline: outline.clone(), holes: Vec::new() }
    };
    let sound = |polygon: &&Polygon| polygon.len() >= 3;
    let drivable = scene.map.drivable.iter().filter(sound).map(area(AreaKind::Roadblock));
    let junctions = scene.map.junctions.iter().filter(sound).map(area(AreaKind::Intersection));
    OpenLoopMap {
        areas: scene.map.lanes.iter().map(lane).chain(drivable).chain(junctions).collect(),
        centreline: route.map(|route| route.points().to_vec()).unwrap_or_default(),
    }
}

/// Returns the tracks of the log from a tick on, sampled every 0.1 s, linear between ticks.
#[must_use]
pub fn log_tracks(scene: &Scene, from: Tick, steps: usize) -> Vec<AgentTrack> {
    let sampled = |track: &Track| (0..steps).map(|step| sample(scene, track, from, step)).collect();
    (0u32..)
        .zip(&scene.tracks)
        .map(|(id, track)| AgentTrack {
            id,
            class: track.class.into(),
            length_m: track.size.length_m,
            width_m: track.size.width_m,
            steps: sampled(track),
        })
        .filter(|track: &AgentTrack| track.steps.iter().any(Option::is_some))
        .collect()
}

/// Returns the tick at or before a step after `from`, and how far the step lies beyond it, in ticks.
fn tick_at(scene: &Scene, from: Tick, step: usize) -> (Tick, f64) {
    let ticks = step as f64 * DT_S / scene.dt.secs();
    // A step that falls on a tick up to rounding is that tick.
    let whole = (ticks + 1e-6).floor();
    (from.plus(whole as u32), (ticks - whole).max(0.0))
}

fn sample(scene: &Scene, track: &Track, from: Tick, step: usize) -> Option<MovingBox> {
    let (tick, share) = tick_at(scene, from, step);
    let a = track.at(tick)?;
    let mut moving = MovingBox { pose: a.pose, velocity_mps: a.velocity_mps };
    if share > 1e-6 {
        let b = track.at(tick.plus(1))?;
        moving.pose = a.pose.lerp(&b.pose, share);
        moving.velocity_mps = a.velocity_mps.lerp(b.velocity_mps, share);
    }
    Some(moving)
}

/// Returns the moment of a tick: `history` holds the ego's states up to now, one per tick, the last being now.
///
/// `None` without any state. Without 1.5 s of history the past is unknown.
#[must_use]
pub fn scene_now(scene: &Scene, tick: Tick, history: &[EgoState], agents: Vec<AgentTrack>) -> Option<SceneNow> {
    let ego = VehicleState::from(history.last()?);
    let dt_s = scene.dt.secs();
    let past: Vec<PastState> = (0..history.len())
        .rev()
        .zip(history)
        .map(|(ticks_ago, ego)| PastState { time_s: -(ticks_ago as f64) * dt_s, state: VehicleState::from(ego) })
        .collect();
    let governed = GovernedLanes::of(scene);
    let red = |step| {
        let (shown, _) = tick_at(scene, tick, step);
        let lights: Vec<LightState> = scene.map.traffic_lights.iter().map(|light| light.at(shown)).collect();
        governed.red(&lights)
    };
    let reaches = past.len() >= 2 && past[0].time_s <= -PAST_S + 1e-9;
    Some(SceneNow {
        ego,
        past: reaches.then_some(past),
        agents,
        red_areas: (0..crate::constants::horizon::STATES).map(red).collect(),
        footprint: Footprint::from(&scene.vehicle),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::epdms::Yardstick;
    use crate::motion::PlannedPoses;
    use crate::planner::reference_plan;
    use crate::road::world;
    use crate::scene::PreparedScene;

    #[test]
    fn lanes_of_the_route_are_found() {
        let map = open_loop_map(&world());
        let kinds: Vec<(AreaKind, bool)> = map.areas.iter().map(|area| (area.kind, area.on_route)).collect();
        assert_eq!(
            kinds,
            [
                (AreaKind::Lane, true),
                (AreaKind::LaneConnector, true),
                (AreaKind::Lane, true),
                (AreaKind::Lane, false),
                (AreaKind::Roadblock, false),
                (AreaKind::Intersection, false),
            ]
        );
        assert_eq!(map.areas[1].outline.len(), 4, "a strip stands for the missing surface");
    }

    #[test]
    fn the_log_is_sampled_every_tenth_of_a_second() {
        let mut scene = world();
        scene.tracks[0].points[50] = None;
        let tracks = log_tracks(&scene, Tick(45), 10);
        assert_eq!(tracks[0].steps.iter().position(Option::is_none), Some(5));
        // The same ticks at 5 Hz: every other sample lies between two of them.
        let mut scene = world();
        scene.dt = ds_space::SimTime::from_secs(0.2);
        let steps = log_tracks(&scene, Tick(3), 4).remove(0).steps;
        let xs: Vec<f64> = steps.iter().flatten().map(|step| step.pose.position.x).collect();
        assert_eq!(xs, [33.0, 33.5, 34.0, 34.5]);
    }

    #[test]
    fn the_expert_s_own_plan_scores_full_marks() {
        let scene = world();
        let now = Tick(30);
        let history = &scene.ego_log[..=30];
        let moment = scene_now(&scene, now, history, log_tracks(&scene, now, 51)).expect("there is a state");
        assert_eq!(moment.past.as_ref().map(Vec::len), Some(31));
        assert_eq!((moment.red_areas[9].as_slice(), moment.red_areas[10].as_slice()), (&[1usize][..], &[][..]));
        let map = std::sync::Arc::new(crate::scene::PreparedMap::new(&open_loop_map(&scene)).expect("a sound map"));
        let prepared = PreparedScene::on(&map, &moment).expect("a sound moment");
        let start = scene.ego_log[30].pose;
        let poses = scene.ego_log[31..=70].iter().map(|ego| start.relative(&ego.pose)).collect();
        let plan = PlannedPoses { dt_s: DT_S, poses };
        let reference = reference_plan(&prepared, Some(10.0)).expect("a sound scene");
        let score = Yardstick::new(&prepared, &reference.plan, None).expect("a plan").score(&prepared, &plan);
        let score = score.expect("a plan");
        assert!(score.epdms > 0.999 && score.history_terms.is_some(), "{score:?}");
        assert!(scene_now(&scene, now, &[], vec![]).is_none());
        assert!(scene_now(&scene, now, &history[..10], vec![]).expect("a state").past.is_none());
    }
}
