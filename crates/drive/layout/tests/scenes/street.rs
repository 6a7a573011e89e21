//! A hand-made street: a straight two-way road with a crossing, lights, parked and moving cars, people, cones.
//!
//! World frame, metres; the road runs along +x, the ego stands at x = 0 in the right lane. Made of `ds_world` values only.

use ds_space::{AgentId, CameraId, CameraModel, DVec2, DVec3, Digest, Intrinsics, PoseSe2, SimTime, Tick};
use ds_world::{
    AgentClass, AgentState, Crosswalk, EgoState, Lane, LaneId, LaneKind, LightState, LineColour, LineKind, LineMarking,
    Map, Origin, RoadEdge, Scene, Size, StopLine, TrafficLight, VehicleParameters, WorldState,
};

const LANE_WIDTH_M: f64 = 3.5;

fn points(coordinates: &[(f64, f64)]) -> Vec<DVec2> {
    coordinates.iter().map(|(x, y)| DVec2::new(*x, *y)).collect()
}

fn rectangle(x0: f64, x1: f64, y0: f64, y1: f64) -> Vec<DVec2> {
    points(&[(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
}

fn lane(name: &str, kind: LaneKind, centre_line: Vec<DVec2>, polygon: Vec<DVec2>) -> Lane {
    Lane {
        name: name.to_owned(),
        kind,
        centre_line,
        polygon,
        speed_limit_mps: Some(13.9),
        successors: vec![],
        predecessors: vec![],
        left: None,
        right: None,
    }
}

/// Returns the map.
pub(crate) fn map() -> Map {
    let w = LANE_WIDTH_M;
    let mut lanes = Vec::new();
    for (from, to) in [(-60.0, 34.0), (50.0, 160.0)] {
        lanes.push(lane(
            "right",
            LaneKind::Road,
            points(&[(from, -0.5 * w), (to, -0.5 * w)]),
            rectangle(from, to, -w, 0.0),
        ));
        lanes.push(lane(
            "left",
            LaneKind::Road,
            points(&[(to, 0.5 * w), (from, 0.5 * w)]),
            rectangle(from, to, 0.0, w),
        ));
    }
    let across = rectangle(34.0, 50.0, -60.0, 60.0);
    lanes.push(lane("through", LaneKind::Connector, points(&[(34.0, -0.5 * w), (50.0, -0.5 * w)]), vec![]));
    let mut drivable: Vec<_> =
        lanes.iter().filter(|lane| !lane.polygon.is_empty()).map(|lane| lane.polygon.clone()).collect();
    drivable.push(across);
    drivable.push(rectangle(-60.0, 34.0, -w - 2.2, -w));
    let line = |kind, colour, points| LineMarking { kind, colour, points };
    let mut line_markings = Vec::new();
    for (from, to) in [(-60.0, 30.0), (54.0, 160.0)] {
        line_markings.push(line(LineKind::Double, LineColour::Yellow, points(&[(from, 0.0), (to, 0.0)])));
        line_markings.push(line(LineKind::Solid, LineColour::White, points(&[(from, w - 0.2), (to, w - 0.2)])));
        line_markings.push(line(LineKind::Dashed, LineColour::White, points(&[(from, -w), (to, -w)])));
    }
    Map {
        junctions: vec![rectangle(34.0, 50.0, -w, w)],
        drivable,
        road_edges: vec![
            RoadEdge { points: points(&[(-60.0, -w - 2.2), (34.0, -w - 2.2)]) },
            RoadEdge { points: points(&[(-60.0, w), (34.0, w)]) },
        ],
        line_markings,
        crosswalks: vec![Crosswalk { polygon: rectangle(30.0, 33.5, -w, w) }],
        stop_lines: vec![StopLine { points: [DVec2::new(28.5, -w), DVec2::new(28.5, 0.0)], light: Some(0) }],
        traffic_lights: vec![TrafficLight {
            position: DVec3::new(34.5, -w - 1.0, 3.6),
            facing_rad: std::f64::consts::PI,
            lanes: vec![LaneId(0)],
            states: vec![LightState::Red],
        }],
        structures: Vec::new(),
        lanes,
    }
}

fn agent(
    id: u32,
    class: AgentClass,
    [length_m, width_m, height_m]: [f64; 3],
    pose: PoseSe2,
    speed_mps: f64,
) -> AgentState {
    let size = Size { length_m, width_m, height_m };
    AgentState { id: AgentId(id), class, size, pose, z_m: 0.0, velocity_mps: pose.forward() * speed_mps }
}

/// Returns the state of the world at a tick: agents standing where they are drawn, the light red.
pub(crate) fn world() -> WorldState {
    use AgentClass::{Barrier, Cone, Cyclist, Pedestrian, Vehicle};
    let turned = std::f64::consts::PI;
    let agents = vec![
        agent(0, Vehicle, [4.6, 1.85, 1.5], PoseSe2::new(16.0, -1.75, 0.0), 4.0),
        agent(1, Vehicle, [4.4, 1.8, 1.48], PoseSe2::new(22.0, 1.75, turned), 9.0),
        agent(2, Vehicle, [4.8, 1.95, 1.85], PoseSe2::new(9.0, -4.7, 0.0), 0.0),
        agent(3, Vehicle, [8.5, 2.5, 3.3], PoseSe2::new(44.0, 9.0, -1.57), 3.0),
        agent(4, Pedestrian, [0.6, 0.6, 1.75], PoseSe2::new(31.8, 1.2, -1.57), 1.4),
        agent(5, Pedestrian, [0.6, 0.6, 1.68], PoseSe2::new(14.0, 5.0, turned), 1.2),
        agent(6, Cyclist, [1.8, 0.6, 1.75], PoseSe2::new(12.0, -3.2, 0.0), 4.0),
        agent(7, Cone, [0.4, 0.4, 0.8], PoseSe2::new(9.0, 3.0, 0.0), 0.0),
        agent(8, Barrier, [0.5, 2.2, 1.0], PoseSe2::new(18.5, -4.6, 0.0), 0.0),
        agent(9, Vehicle, [4.5, 1.8, 1.45], PoseSe2::new(60.0, -1.75, 0.0), 8.0),
    ];
    WorldState {
        tick: Tick(0),
        time: SimTime(0),
        ego: EgoState::default(),
        agents,
        lights: vec![LightState::Red],
        contacts: vec![],
    }
}

/// Returns the ego's pose.
pub(crate) fn ego() -> PoseSe2 {
    PoseSe2::new(0.0, -1.75, 0.0)
}

/// Returns the front camera of a size.
pub(crate) fn camera(width_px: u32, height_px: u32) -> CameraModel {
    let id = CameraId::new("front").expect("a plain word is an id");
    let lens = Intrinsics::centred(width_px, height_px, 70f64.to_radians());
    CameraModel::mounted(id, lens, DVec3::new(1.5, 0.0, 1.6), 0.0, 0.05)
}

/// Returns the whole scene.
pub(crate) fn scene() -> Scene {
    let ego_log =
        (0..80).map(|i| EgoState { pose: PoseSe2::new(f64::from(i), -1.75, 0.0), ..EgoState::default() }).collect();
    Scene {
        adversary: None,
        name: "street".to_owned(),
        family: String::new(),
        digest: Digest::of(b"street"),
        dt: SimTime::from_secs(0.1),
        map: map(),
        vehicle: VehicleParameters::ZOE,
        ego_log,
        route: points(&[(-10.0, -1.75), (100.0, -1.75)]),
        tracks: vec![],
        cameras: vec![camera(160, 96)],
        prompt: String::new(),
        origin: Origin::default(),
    }
}
