//! A straight road for tests: two lanes along +x (R0 around y = 0, R1 left of it), one against them (O0), 3.5 m each.
//!
//! The route is R0; drives are written down as states, so that scores can be worked out by hand.

use ds_space::{DVec2, DVec3, Digest, PoseSe2, SimTime};
use ds_world::{
    AgentClass, EgoState, Lane, LaneId, LaneKind, LightState, Map, Origin, Scene, Size, Track, TrackPoint,
    TrafficLight, VehicleParameters,
};

use crate::constants::horizon::{DT_S, STATES, V1_AGENT_STEPS};
use crate::footprint::Footprint;
use crate::motion::{Executed, PlannedPoses, VehicleState};
use crate::scene::{AgentTrack, AreaKind, MapArea, MovingBox, ObjectClass, OpenLoopMap, OpenLoopScene, SceneNow};

/// Makes a rectangle of x and y limits.
pub(crate) fn area(kind: AreaKind, on_route: bool, [x0, y0, x1, y1]: [f64; 4]) -> MapArea {
    let outline = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)].map(|(x, y)| DVec2::new(x, y)).to_vec();
    MapArea { kind, on_route, outline, holes: Vec::new() }
}

/// Makes the road with the ego at its origin and nothing on it.
pub(crate) fn scene(speed_mps: f64) -> OpenLoopScene {
    let areas = vec![
        area(AreaKind::Roadblock, false, [-50.0, -1.75, 250.0, 5.25]),
        area(AreaKind::Roadblock, false, [-50.0, 5.25, 250.0, 8.75]),
        area(AreaKind::Lane, true, [-50.0, -1.75, 250.0, 1.75]),
        area(AreaKind::Lane, false, [-50.0, 1.75, 250.0, 5.25]),
        area(AreaKind::Lane, false, [-50.0, 5.25, 250.0, 8.75]),
    ];
    OpenLoopScene {
        map: OpenLoopMap { areas, centreline: vec![DVec2::new(-50.0, 0.0), DVec2::new(250.0, 0.0)] },
        now: SceneNow {
            ego: VehicleState { vx_mps: speed_mps, ..VehicleState::default() },
            past: None,
            agents: Vec::new(),
            red_areas: Vec::new(),
            footprint: Footprint::NAVSIM,
        },
    }
}

/// Makes a plan straight on at a speed.
pub(crate) fn plan(speed_mps: f64) -> PlannedPoses {
    PlannedPoses { dt_s: 0.5, poses: (1..=8).map(|i| PoseSe2::new(0.5 * speed_mps * f64::from(i), 0.0, 0.0)).collect() }
}

/// Makes the states of a drive straight on at a speed, beside the centreline.
pub(crate) fn drive(speed_mps: f64, aside_m: f64) -> Executed {
    std::array::from_fn(|step| VehicleState {
        x_m: speed_mps * DT_S * step as f64,
        y_m: aside_m,
        vx_mps: speed_mps,
        ..VehicleState::default()
    })
}

/// Makes a car of 4.5 x 1.9 m that drives on at a velocity.
pub(crate) fn moving(id: u32, pose: PoseSe2, velocity_mps: DVec2) -> AgentTrack {
    let at = |step: usize| {
        let position = pose.position + velocity_mps * (DT_S * step as f64);
        Some(MovingBox { pose: PoseSe2 { position, ..pose }, velocity_mps })
    };
    let steps = (0..V1_AGENT_STEPS).map(at).collect();
    AgentTrack { id, class: ObjectClass::Agent, length_m: 4.5, width_m: 1.9, steps }
}

/// Makes a standing car.
pub(crate) fn standing(id: u32, x_m: f64, y_m: f64) -> AgentTrack {
    moving(id, PoseSe2::new(x_m, y_m, 0.0), DVec2::ZERO)
}

/// Makes a simulator's scene: a road of 200 m, the connector "J" of 60..72 m with a light that is red in ticks 20..40, the
/// expert on it at 10 m/s for 12 s, and a car 30 m ahead at the expert's speed.
pub(crate) fn world() -> Scene {
    let at = |x: f64, y: f64| DVec2::new(x, y);
    let lane = |name: &str, kind, x0: f64, x1: f64| Lane {
        name: name.to_owned(),
        kind,
        centre_line: vec![at(x0, 0.0), at(x1, 0.0)],
        polygon: if kind == LaneKind::Road {
            area(AreaKind::Lane, true, [x0, -1.75, x1, 1.75]).outline
        } else {
            vec![]
        },
        speed_limit_mps: None,
        successors: Vec::new(),
        predecessors: Vec::new(),
        left: None,
        right: None,
    };
    let opposite =
        Lane { centre_line: vec![at(200.0, 3.5), at(-20.0, 3.5)], ..lane("O", LaneKind::Road, -20.0, 200.0) };
    let expert = |tick: i32| EgoState {
        pose: PoseSe2::new(f64::from(tick) - VehicleParameters::ZOE.rear_axle_to_centre_m, 0.0, 0.0),
        velocity_mps: at(10.0, 0.0),
        ..EgoState::default()
    };
    let car = |tick: i32| {
        let pose = PoseSe2::new(30.0 + f64::from(tick), 0.0, 0.0);
        Some(TrackPoint { pose, z_m: 0.0, velocity_mps: at(10.0, 0.0) })
    };
    let red = |tick: i32| if (20..40).contains(&tick) { LightState::Red } else { LightState::Green };
    Scene {
        adversary: None,
        name: "road".to_owned(),
        family: String::new(),
        digest: Digest::default(),
        dt: SimTime::from_secs(DT_S),
        map: Map {
            lanes: vec![
                lane("A", LaneKind::Road, -20.0, 60.0),
                lane("J", LaneKind::Connector, 60.0, 72.0),
                lane("B", LaneKind::Road, 72.0, 200.0),
                opposite,
            ],
            junctions: vec![area(AreaKind::Intersection, false, [60.0, -1.75, 72.0, 5.25]).outline],
            drivable: vec![area(AreaKind::Roadblock, false, [-20.0, -1.75, 200.0, 5.25]).outline],
            traffic_lights: vec![TrafficLight {
                position: DVec3::ZERO,
                facing_rad: 0.0,
                lanes: vec![LaneId(1)],
                states: (0..=120).map(red).collect(),
            }],
            ..Map::default()
        },
        vehicle: VehicleParameters::ZOE,
        ego_log: (0..=120).map(expert).collect(),
        route: vec![at(-15.0, 0.0), at(190.0, 0.0)],
        tracks: vec![Track {
            name: "lead".to_owned(),
            class: AgentClass::Vehicle,
            size: Size { length_m: 4.5, width_m: 1.9, height_m: 1.5 },
            points: (0..=120).map(car).collect(),
        }],
        cameras: Vec::new(),
        prompt: String::new(),
        origin: Origin::default(),
    }
}

const _: () = assert!(STATES <= V1_AGENT_STEPS);
