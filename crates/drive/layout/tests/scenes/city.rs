//! A large map for benchmarks: a grid of streets with curved outlines, some hundred lanes, and sixty agents.
//!
//! World frame, metres; the ego stands at the origin, in the lane along +x.

use ds_space::{AgentId, DVec2, PoseSe2, SimTime, Tick};
use ds_world::{
    AgentClass, AgentState, Crosswalk, EgoState, Lane, LaneKind, LineColour, LineKind, LineMarking, Map, Size,
    WorldState,
};

const BLOCK_M: f64 = 90.0;
const STREETS: i32 = 5;

/// Returns a street's point: `along` metres on it, `left` metres beside it; streets sway a little.
fn on_street(street: i32, across: bool, along: f64, left: f64) -> DVec2 {
    let sway = 2.0 * (along * 0.02 + f64::from(street)).sin() - 2.0 * f64::from(street).sin();
    let beside = BLOCK_M * f64::from(street) + sway + left;
    if across { DVec2::new(beside, along) } else { DVec2::new(along, beside) }
}

/// Returns the map: 2 × 11 streets with 4 lanes, each cut into blocks.
pub(crate) fn map() -> Map {
    let mut map = Map::default();
    for across in [false, true] {
        for street in -STREETS..=STREETS {
            for block in -STREETS..STREETS {
                add_block(&mut map, street, across, f64::from(block) * BLOCK_M);
            }
        }
    }
    map
}

fn add_block(map: &mut Map, street: i32, across: bool, from: f64) {
    let steps = || (0..=30).map(|i| from + BLOCK_M * f64::from(i) / 30.0);
    let line = |left: f64| steps().map(|along| on_street(street, across, along, left)).collect::<Vec<_>>();
    for lane in -2..2 {
        let right = 3.5 * f64::from(lane);
        let mut polygon = line(right);
        polygon.extend(line(right + 3.5).into_iter().rev());
        map.drivable.push(polygon.clone());
        map.lanes.push(Lane {
            name: String::new(),
            kind: LaneKind::Road,
            centre_line: line(right + 1.75),
            polygon,
            speed_limit_mps: None,
            successors: vec![],
            predecessors: vec![],
            left: None,
            right: None,
        });
    }
    for (left, kind, colour) in [
        (-3.5, LineKind::Dashed, LineColour::White),
        (0.0, LineKind::Double, LineColour::Yellow),
        (3.5, LineKind::Dashed, LineColour::White),
    ] {
        map.line_markings.push(LineMarking { kind, colour, points: line(left) });
    }
    let corner = |along: f64, left: f64| on_street(street, across, from + along, left);
    map.crosswalks
        .push(Crosswalk { polygon: vec![corner(9.0, -7.0), corner(12.0, -7.0), corner(12.0, 7.0), corner(9.0, 7.0)] });
}

/// Returns sixty vehicles and people along the ego's street.
pub(crate) fn world() -> WorldState {
    let agent = |i: u32| {
        let position = on_street(0, false, 8.0 + 1.5 * f64::from(i), [-5.2, -1.7, 1.7, 5.2, 8.0][i as usize % 5]);
        let (class, size) = if i % 5 == 4 {
            (AgentClass::Pedestrian, Size { length_m: 0.6, width_m: 0.6, height_m: 1.7 })
        } else {
            (AgentClass::Vehicle, Size { length_m: 4.5, width_m: 1.8, height_m: 1.5 })
        };
        let pose = PoseSe2 { position, heading_rad: 0.0 };
        AgentState { id: AgentId(i), class, size, pose, z_m: 0.0, velocity_mps: DVec2::new(5.0, 0.0) }
    };
    WorldState {
        tick: Tick(0),
        time: SimTime(0),
        ego: EgoState::default(),
        agents: (0..60).map(agent).collect(),
        lights: vec![],
        contacts: vec![],
    }
}
