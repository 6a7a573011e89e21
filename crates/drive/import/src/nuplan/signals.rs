//! Traffic lights and stop lines: what the log says of lane connectors, hung above the end of the lane before them.
//!
//! A log tells for some connectors whether they show red; not red counts as green, nothing told as unknown. Connectors
//! that begin at one lane and always show the same share a light; where they differ the heads hang side by side, 0.8 m
//! apart and 4.5 m above the ground. Stop areas of lights (type 2) and stop signs (type 1) are lines on the road.

use std::collections::{BTreeMap, BTreeSet};

use ds_space::plane::path::Path;
use ds_space::plane::polygon::long_axis;
use ds_space::{DVec2, PoseSe2, angle};
use ds_world::{LaneId, LightState, StopLine, TrafficLight};

use super::{City, Connector, SignalReading, Stop};
use crate::scenarionet::lanes::across;

const HEAD_M: f64 = 4.5;
const BESIDE_M: f64 = 0.8;
/// What was told may be this old or early, in seconds: logs have two frames a second.
const APART_SECS: f64 = 0.3;
const STOP_SIGN: i64 = 1;
const LIGHT: i64 = 2;

/// Adds the lights with what they show at the given times, and the stop lines.
pub(crate) fn add(city: &mut City, shown: &[SignalReading], times_secs: &[f64]) {
    let frames: Vec<Option<&BTreeMap<i64, bool>>> = times_secs.iter().map(|secs| nearest(shown, *secs)).collect();
    let told: BTreeSet<i64> = shown.iter().flat_map(|(_, lights)| lights.keys().copied()).collect();
    // Of each lane that traffic comes from, the connectors with the same lights, in a fixed order.
    let mut groups: BTreeMap<i64, BTreeMap<Vec<LightState>, Vec<&Connector>>> = BTreeMap::new();
    for connector in &city.connectors {
        if !connector.stops.is_empty() || told.contains(&connector.fid) {
            let states = frames.iter().map(|lights| state(*lights, connector.fid)).collect();
            groups.entry(connector.from).or_default().entry(states).or_default().push(connector);
        }
    }
    // For each stop area, its lights with a connector of each.
    let mut lights_of: BTreeMap<i64, BTreeMap<u32, LaneId>> = BTreeMap::new();
    for group in groups.values() {
        let middle = 0.5 * (group.len() as f64 - 1.0);
        for (i, (states, connectors)) in group.iter().enumerate() {
            let Some(start) = start(city, connectors[0].lane) else { continue };
            let light = u32::try_from(city.map.traffic_lights.len()).unwrap_or(u32::MAX);
            for connector in connectors {
                for stop in &connector.stops {
                    lights_of.entry(*stop).or_default().entry(light).or_insert(connector.lane);
                }
            }
            let beside = start.left() * ((middle - i as f64) * BESIDE_M);
            city.map.traffic_lights.push(TrafficLight {
                position: (start.position + beside).extend(HEAD_M),
                facing_rad: angle::wrap(start.heading_rad + std::f64::consts::PI),
                lanes: connectors.iter().map(|connector| connector.lane).collect(),
                states: states.clone(),
            });
        }
    }
    let lines: Vec<StopLine> = city.stops.iter().flat_map(|stop| stop_lines(city, stop, &lights_of)).collect();
    city.map.stop_lines.extend(lines);
}

/// Returns where traffic stops before a connector: where the lane that leads to it ends, else where it begins.
fn start(city: &City, connector: LaneId) -> Option<PoseSe2> {
    let lane = city.map.lane(connector)?;
    let before = lane.predecessors.first().and_then(|id| city.map.lane(*id));
    let before = before.and_then(|lane| Path::new(&lane.centre_line)).map(|path| path.pose(path.length_m()));
    before.or_else(|| Path::new(&lane.centre_line).map(|path| path.pose(0.0)))
}

/// Returns what is told in the frame nearest to a time; frames are in order.
fn nearest(shown: &[SignalReading], secs: f64) -> Option<&BTreeMap<i64, bool>> {
    let after = shown.partition_point(|frame| frame.0 < secs);
    let near = [after.checked_sub(1), Some(after)].into_iter().flatten().filter_map(|i| shown.get(i));
    let apart = |frame: &&SignalReading| (frame.0 - secs).abs();
    let nearest = near.min_by(|a, b| apart(a).total_cmp(&apart(b))).filter(|frame| apart(frame) < APART_SECS);
    nearest.map(|(_, lights)| lights)
}

fn state(lights: Option<&BTreeMap<i64, bool>>, connector: i64) -> LightState {
    match lights.and_then(|lights| lights.get(&connector)) {
        Some(true) => LightState::Red,
        Some(false) => LightState::Green,
        None => LightState::Unknown,
    }
}

/// Returns the lines of a stop area: one with its light, or one for each light across the lanes that it governs.
fn stop_lines(city: &City, stop: &Stop, lights_of: &BTreeMap<i64, BTreeMap<u32, LaneId>>) -> Vec<StopLine> {
    let whole = |light: Option<u32>| long_axis(&stop.area).map(|points| StopLine { points, light });
    match (stop.kind, lights_of.get(&stop.fid)) {
        (STOP_SIGN, _) => whole(None).into_iter().collect(),
        (LIGHT, Some(lights)) if lights.len() == 1 => whole(lights.keys().next().copied()).into_iter().collect(),
        (LIGHT, Some(lights)) => {
            let middle = stop.area.iter().sum::<DVec2>() / stop.area.len() as f64;
            let line = |(light, lane): (&u32, &LaneId)| {
                let line = across(city.map.lane(*lane)?, middle)?;
                Some(StopLine { light: Some(*light), ..line })
            };
            lights.iter().filter_map(line).collect()
        }
        _ => Vec::new(),
    }
}
