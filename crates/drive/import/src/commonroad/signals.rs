//! Traffic lights, stop lines and signs that lanelets refer to.
//!
//! A light governs the lanes that follow the lanelets that refer to it, in the directions that it is for; a cycle's
//! durations and offset are counted in time steps of the file. Speeds of signs are metres per second. Of signs only
//! speed limits and stop have a place in the scene.

use std::collections::{BTreeMap, BTreeSet};

use ds_scenario::{MAX_STATES, Warning};
use ds_space::plane::path::Path;
use ds_space::{DVec2, angle};
use ds_world::{Lane, LaneId, LightState, Map, StopLine, TrafficLight};

use super::element::Node;
use super::{Window, note, references};
use crate::scenarionet::lanes::across;
use crate::view::FieldFault;

/// Height of a head above the road, in metres; the format tells none.
const HEAD_M: f64 = 4.5;
/// Signs of the largest speed, in the countries of the format.
const LIMITS: [&str; 4] = ["274", "274.1", "R2-1", "R301"];
const STOPS: [&str; 3] = ["206", "R1-1", "R2"];

/// Adds what lanelets refer to; `window` tells the time steps of the scene's ticks.
pub(super) fn add(map: &mut Map, root: &Node<'_>, window: &Window, notes: &mut Vec<Warning>) -> Result<(), FieldFault> {
    let index: BTreeMap<String, usize> = map.lanes.iter().enumerate().map(|(i, lane)| (lane.name.clone(), i)).collect();
    let signs = signs(root)?;
    let lights: Vec<Node<'_>> = root.all("trafficLight").collect();
    if lights.len().saturating_mul(window.count) > MAX_STATES {
        let problem = format!("are {} over {} ticks, over {MAX_STATES} states", lights.len(), window.count);
        return Err(FieldFault { at: "trafficLight".to_owned(), problem });
    }
    let mut numbers: BTreeMap<&str, u32> = BTreeMap::new();
    let mut referring: BTreeMap<String, Vec<usize>> = BTreeMap::new();
    for (number, light) in (0..).zip(&lights) {
        numbers.insert(light.need_attribute("id")?, number);
    }
    for node in root.all("lanelet") {
        let Some(at) = index.get(node.need_attribute("id")?).copied() else { continue };
        for sign in references(&node, "trafficSignRef")?.iter().filter_map(|name| signs.get(name)) {
            map.lanes[at].speed_limit_mps = sign.limit_mps.or(map.lanes[at].speed_limit_mps);
        }
        let governed = references(&node, "trafficLightRef")?;
        if let Some(line) = stop_line(&map.lanes[at], &node, &signs, &governed, &numbers, window)? {
            map.stop_lines.push(line);
        }
        governed.into_iter().for_each(|name| referring.entry(name).or_default().push(at));
    }
    let turns = turns(root)?;
    for light in &lights {
        let lanes = referring.get(light.need_attribute("id")?).map_or(&[][..], Vec::as_slice);
        let light = traffic_light(map, light, lanes, &turns, window)?;
        map.traffic_lights.push(light);
    }
    let lost = referring.keys().filter(|name| !numbers.contains_key(name.as_str())).count();
    if lost > 0 {
        note(notes, "trafficLightRef", format!("{lost} of the lights that lanelets name are not in the file"));
    }
    Ok(())
}

/// What a sign says.
#[derive(Debug, Default)]
struct Sign {
    limit_mps: Option<f64>,
    stop: bool,
}

fn signs(root: &Node<'_>) -> Result<BTreeMap<String, Sign>, FieldFault> {
    let mut signs = BTreeMap::new();
    for node in root.all("trafficSign") {
        let mut sign = Sign::default();
        for element in node.all("trafficSignElement") {
            let kind = element.need("trafficSignID")?;
            sign.stop |= STOPS.contains(&kind.text());
            if let Some(value) = element.get("additionalValue").filter(|_| LIMITS.contains(&kind.text())) {
                sign.limit_mps = Some(value.number()?).filter(|limit| *limit > 0.0);
            }
        }
        signs.insert(node.need_attribute("id")?.to_owned(), sign);
    }
    Ok(signs)
}

/// Returns a lanelet's stop line; where it is only implied by a light or a stop sign, across the end.
fn stop_line(
    lane: &Lane,
    node: &Node<'_>,
    signs: &BTreeMap<String, Sign>,
    governed: &[String],
    numbers: &BTreeMap<&str, u32>,
    window: &Window,
) -> Result<Option<StopLine>, FieldFault> {
    let line = node.get("stopLine");
    let named = line.as_ref().map(|line| references(line, "trafficLightRef")).transpose()?.unwrap_or_default();
    let light = named.iter().chain(governed).find_map(|name| numbers.get(name.as_str()).copied());
    let stops = references(node, "trafficSignRef")?.iter().any(|name| signs.get(name).is_some_and(|sign| sign.stop));
    if line.is_none() && light.is_none() && !stops {
        return Ok(None);
    }
    let mut points = Vec::new();
    for point in line.iter().flat_map(|line| line.all("point")) {
        points.push(point.place()? - window.origin);
    }
    Ok(match points.as_slice() {
        [a, b, ..] => Some(StopLine { points: [*a, *b], light }),
        _ => across(lane, lane.centre_line[lane.centre_line.len() - 1]).map(|line| StopLine { light, ..line }),
    })
}

/// Returns, by direction, the lanes that lead there through intersections.
fn turns(root: &Node<'_>) -> Result<BTreeMap<&'static str, BTreeSet<String>>, FieldFault> {
    let mut turns: BTreeMap<&str, BTreeSet<String>> = BTreeMap::new();
    for incoming in root.all("intersection").flat_map(|node| node.all("incoming")) {
        for (turn, ways) in [
            ("right", ["successorsRight", "outgoingRight"]),
            ("straight", ["successorsStraight", "outgoingStraight"]),
            ("left", ["successorsLeft", "outgoingLeft"]),
        ] {
            for way in ways {
                turns.entry(turn).or_default().extend(references(&incoming, way)?);
            }
        }
    }
    Ok(turns)
}

fn traffic_light(
    map: &Map,
    node: &Node<'_>,
    referring: &[usize],
    turns: &BTreeMap<&str, BTreeSet<String>>,
    window: &Window,
) -> Result<TrafficLight, FieldFault> {
    let approach = referring.first().and_then(|lane| Path::new(&map.lanes[*lane].centre_line));
    let end = approach.map(|path| path.pose(path.length_m()));
    let told = node.get("position").and_then(|position| position.get("point"));
    let position: Option<DVec2> = told.map(|point| point.place()).transpose()?.map(|place| place - window.origin);
    let position = position.or(end.map(|end| end.position));
    let position = position.ok_or_else(|| node.fault("has no position and no lanelet that refers to it"))?;
    let direction = node.get("direction").map_or("all", |direction| direction.text()).to_ascii_lowercase();
    let mut lanes: Vec<LaneId> = Vec::new();
    for next in referring.iter().flat_map(|lane| &map.lanes[*lane].successors) {
        let name = map.lane(*next).map_or("", |lane| lane.name.as_str());
        let turn = turns.iter().find(|(_, names)| names.contains(name)).map(|(turn, _)| *turn);
        let meant = direction == "all" || turn.is_none_or(|turn| direction.contains(turn));
        if meant && !lanes.contains(next) {
            lanes.push(*next);
        }
    }
    Ok(TrafficLight {
        position: position.extend(HEAD_M),
        facing_rad: end.map_or(0.0, |end| angle::wrap(end.heading_rad + std::f64::consts::PI)),
        lanes,
        states: states(node, window)?,
    })
}

/// Returns what a light shows at each tick of the scene.
fn states(node: &Node<'_>, window: &Window) -> Result<Vec<LightState>, FieldFault> {
    let whole = |node: Node<'_>| -> Result<u64, FieldFault> {
        let value = node.number()?;
        let sound = (0.0..=1e6).contains(&value) && value.fract() == 0.0;
        if sound { Ok(value as u64) } else { Err(node.fault(format!("is {value}, no whole time step from 0 to 1e6"))) }
    };
    let active = node.get("active").is_none_or(|active| active.text() != "false");
    let Some(cycle) = node.get("cycle").filter(|_| active) else { return Ok(vec![LightState::Unknown]) };
    let mut shown: Vec<(u64, LightState)> = Vec::new();
    let mut length = 0;
    for element in cycle.all("cycleElement") {
        length += whole(element.need("duration")?)?;
        let colour = element.need("color")?;
        let state = match colour.text() {
            "red" | "redYellow" => LightState::Red,
            "yellow" => LightState::Yellow,
            "green" => LightState::Green,
            "inactive" => LightState::Unknown,
            other => return Err(colour.fault(format!("is {other:?}, no colour of a traffic light"))),
        };
        shown.push((length, state));
    }
    if length == 0 {
        return Err(cycle.fault("has no duration"));
    }
    let offset = cycle.get("timeOffset").map(whole).transpose()?.unwrap_or(0);
    let at = |step: f64| {
        let step = ((step + 1e-6).floor() as u64 + length - offset % length) % length;
        shown.iter().find(|(until, _)| step < *until).map_or(LightState::Unknown, |(_, state)| *state)
    };
    Ok(window.steps().map(at).collect())
}
