//! A straight road for tests: two lanes along +x (R0 around y = 0, R1 left of it), one against them (O0), 3.5 m each.
//!
//! The route is R0; drives are written down as states, so that scores can be worked out by hand.

use ds_space::{DVec2, PoseSe2};

use crate::constants::horizon::{DT_S, STATES, V1_AGENT_STEPS};
use crate::footprint::Footprint;
use crate::motion::{Executed, Plan, VehicleState};
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
pub(crate) fn plan(speed_mps: f64) -> Plan {
    Plan { dt_s: 0.5, poses: (1..=8).map(|i| PoseSe2::new(0.5 * speed_mps * f64::from(i), 0.0, 0.0)).collect() }
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

const _: () = assert!(STATES <= V1_AGENT_STEPS);
