//! Where the paths of reactive agents meet traffic lights: stop lines crossed in the governed direction.
//!
//! A light without a stop line stops traffic where its lanes begin (connectors) or end (roads).

use ds_space::{DVec2, Tick};
use ds_vehicle::IdmParameters;
use ds_world::{LaneKind, LightState, Map, StopLine, TrafficLight};

use crate::agent_path::{AgentPath, KNOT_M};
use crate::lane_index::LaneIndex;

/// A place on a path at which a light is obeyed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SignalStop {
    /// Distance along the path, m.
    pub along_m: f64,
    /// Index of the light.
    pub light: usize,
}

/// A stop line with its light and the direction of the traffic that it stops.
#[derive(Debug, Clone, Copy)]
pub(crate) struct GovernedLine {
    ends: [DVec2; 2],
    direction: DVec2,
    light: usize,
}

/// Half the width of a stop line made for a lane that has none.
const HALF_LANE_M: f64 = 2.0;
/// A lane farther than this from a stop line does not give its direction.
const NEAR_M: f64 = 15.0;

/// Returns the governed stop lines of a map, in map order.
pub(crate) fn governed_lines(map: &Map, lanes: &LaneIndex<'_>) -> Vec<GovernedLine> {
    let mut lines = Vec::new();
    for stop_line in &map.stop_lines {
        let Some(light) = stop_line.light.map(|light| light as usize) else { continue };
        if let Some(head) = map.traffic_lights.get(light) {
            lines.push(GovernedLine { ends: stop_line.points, direction: direction(stop_line, head, lanes), light });
        }
    }
    for (light, head) in map.traffic_lights.iter().enumerate() {
        if map.stop_lines.iter().any(|line| line.light.is_some_and(|index| index as usize == light)) {
            continue;
        }
        for id in &head.lanes {
            let (Some(lane), Some(line)) = (map.lane(*id), lanes.line(*id)) else { continue };
            let along_m = if lane.kind == LaneKind::Connector { 0.0 } else { line.length_m() };
            let (point, direction) = (line.at(along_m), line.direction_at(along_m));
            let across = direction.perp() * HALF_LANE_M;
            lines.push(GovernedLine { ends: [point + across, point - across], direction, light });
        }
    }
    lines
}

fn direction(line: &StopLine, head: &TrafficLight, lanes: &LaneIndex<'_>) -> DVec2 {
    let middle = line.points[0].midpoint(line.points[1]);
    let mut best = (NEAR_M, -DVec2::from_angle(head.facing_rad));
    for lane in head.lanes.iter().filter_map(|id| lanes.line(*id)) {
        let near = lane.project(middle);
        if near.distance_m < best.0 {
            best = (near.distance_m, lane.direction(near.segment));
        }
    }
    best.1
}

/// Returns where a path crosses governed stop lines, in order along it.
pub(crate) fn stops_on(path: &AgentPath, lines: &[GovernedLine]) -> Vec<SignalStop> {
    let positions: Vec<DVec2> = path.positions().collect();
    let mut stops = Vec::new();
    for (index, ends) in positions.windows(2).enumerate() {
        for line in lines {
            let step = ends[1] - ends[0];
            if step.dot(line.direction) <= 0.3 * step.length() {
                continue;
            }
            if let Some(share) = crossing(ends[0], step, line.ends) {
                stops.push(SignalStop { along_m: (index as f64 + share) * KNOT_M, light: line.light });
            }
        }
    }
    stops
}

/// Returns the share of `step` at which it crosses a segment.
fn crossing(from: DVec2, step: DVec2, [a, b]: [DVec2; 2]) -> Option<f64> {
    let edge = b - a;
    let cross = step.perp_dot(edge);
    if cross.abs() < 1e-12 {
        return None;
    }
    let share = (a - from).perp_dot(edge) / cross;
    let across = (a - from).perp_dot(step) / cross;
    ((0.0..1.0).contains(&share) && (0.0..=1.0).contains(&across)).then_some(share)
}

/// Returns the gap to the first line ahead at which to stop: red if braking can do it, yellow if gentle braking can.
#[must_use]
pub fn stop_ahead(
    idm: &IdmParameters,
    stops: &[SignalStop],
    nose_m: f64,
    speed_mps: f64,
    lights: &[LightState],
) -> Option<f64> {
    let braking_m = |deceleration: f64| speed_mps * speed_mps / (2.0 * deceleration);
    stops.iter().find_map(|stop| {
        let gap_m = stop.along_m - nose_m;
        let needed_m = match lights.get(stop.light)? {
            LightState::Red => braking_m(idm.emergency_deceleration_mps2),
            LightState::Yellow => braking_m(idm.deceleration_mps2),
            LightState::Green | LightState::Unknown => return None,
        };
        (gap_m >= 0.0 && gap_m >= needed_m).then_some(gap_m)
    })
}

/// Fills in what each light shows at a tick.
pub(crate) fn show(lights: &[TrafficLight], tick: Tick, out: &mut Vec<LightState>) {
    out.clear();
    out.extend(lights.iter().map(|light| light.at(tick)));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crossings_by_table() {
        let line = [DVec2::new(0.5, -1.0), DVec2::new(0.5, 1.0)];
        for (from, step, expected) in [
            (DVec2::ZERO, DVec2::X, Some(0.5)),
            (DVec2::new(0.0, 2.0), DVec2::X, None),
            (DVec2::new(0.6, 0.0), DVec2::X, None),
            (DVec2::ZERO, DVec2::Y, None),
        ] {
            assert_eq!(crossing(from, step, line), expected, "{from} {step}");
        }
    }
}
