//! The lanelet network → the map: lanes midway between their bounds, links, paint, junctions, edges of the road.
//!
//! A lanelet that an intersection names as a way through it, or whose type says so, is a connector and its surface a
//! junction; in a file that names none, those are connectors whose centre lines cross. Lanelets for walking are no lanes.

use std::collections::{BTreeMap, BTreeSet};

use ds_scenario::Warning;
use ds_space::DVec2;
use ds_space::plane::Bounds;
use ds_space::plane::path::{Path, thin};
use ds_world::{Crosswalk, Lane, LaneKind, LineColour, LineKind, LineMarking, Map};

use super::element::Node;
use super::{note, references};
use crate::boundary::{between, kerbs, midway, outline, place};
use crate::scenarionet::lanes::{Links, link_by_name};
use crate::view::FieldFault;

/// The farthest that a point may lie from the drive, in metres.
const FAR_M: f64 = 1e5;
const MOST_LANELETS: usize = 20_000;
/// The most pairs of segments that are looked at for centre lines that cross.
const MOST_LOOKS: usize = 200_000_000;
/// Ways through an intersection, as the format and its successors name them.
const WAYS: [&str; 6] =
    ["successorsRight", "successorsStraight", "successorsLeft", "outgoingRight", "outgoingStraight", "outgoingLeft"];

/// A lanelet's bounds, left and right, with the paint that is told of them.
type Bound = (Vec<DVec2>, Option<String>);

/// Reads the network, positions moved by `-origin`.
pub(super) fn map(root: &Node<'_>, origin: DVec2, notes: &mut Vec<Warning>) -> Result<Map, FieldFault> {
    let mut map = Map::default();
    let (mut links, mut bounds, mut walked) = (Vec::new(), Vec::new(), 0);
    let ways: BTreeSet<String> = ways(root)?;
    for (i, node) in root.all("lanelet").enumerate() {
        if i == MOST_LANELETS {
            return Err(node.fault(format!("is one of more than {MOST_LANELETS} lanelets")));
        }
        let (left, right) = (bound(&node, "leftBound", origin)?, bound(&node, "rightBound", origin)?);
        let surface = outline(between(left.0.clone(), right.0.clone()));
        let is = |kind: &str| node.all("laneletType").any(|given| given.text() == kind);
        if is("crosswalk") || is("sidewalk") {
            walked += usize::from(is("sidewalk"));
            map.crosswalks.extend(is("crosswalk").then_some(Crosswalk { polygon: surface }));
            continue;
        }
        let name = node.need_attribute("id")?.to_owned();
        let connects = is("intersection") || ways.contains(&name);
        let kind = if connects { LaneKind::Connector } else { LaneKind::Road };
        map.lanes.push(lane(&node, name, kind, &left.0, &right.0, surface)?);
        links.push(linked(&node)?);
        bounds.push((left, right));
    }
    link(&mut map, &links, notes);
    if map.lanes.iter().all(|lane| lane.kind == LaneKind::Road) {
        mark_crossing(&mut map, notes);
    }
    paint(&mut map, &bounds, notes);
    if walked > 0 {
        note(notes, "lanelet", format!("{walked} of type \"sidewalk\" are left out"));
    }
    let junctions = map.lanes.iter().filter(|lane| lane.kind == LaneKind::Connector);
    map.junctions = junctions.map(|lane| lane.polygon.clone()).collect();
    map.drivable = map.lanes.iter().map(|lane| lane.polygon.clone()).collect();
    map.road_edges = kerbs(&map.drivable)?;
    Ok(map)
}

/// Returns the lanelets that intersections name as ways through them.
fn ways(root: &Node<'_>) -> Result<BTreeSet<String>, FieldFault> {
    let mut ways = BTreeSet::new();
    for incoming in root.all("intersection").flat_map(|node| node.all("incoming")) {
        for way in WAYS {
            ways.extend(references(&incoming, way)?);
        }
    }
    Ok(ways)
}

fn bound(lanelet: &Node<'_>, side: &str, origin: DVec2) -> Result<Bound, FieldFault> {
    let node = lanelet.need(side)?;
    let mut points = Vec::new();
    for point in node.all("point") {
        let place = point.place()? - origin;
        if place.abs().max_element() > FAR_M {
            return Err(point.fault(format!("lies more than {FAR_M} m from the drive: {}", place + origin)));
        }
        points.push(place);
    }
    if points.len() < 2 {
        return Err(node.fault(format!("has {} points, at least 2 are needed", points.len())));
    }
    Ok((points, node.get("lineMarking").map(|marking| marking.text().to_owned())))
}

fn lane(
    node: &Node<'_>,
    name: String,
    kind: LaneKind,
    left: &[DVec2],
    right: &[DVec2],
    polygon: Vec<DVec2>,
) -> Result<Lane, FieldFault> {
    let centre = midway(left, right).and_then(|points| Path::new(&points));
    let centre = centre.ok_or_else(|| node.fault("has a bound without length"))?;
    let limit = node.get("speedLimit").map(|limit| limit.number()).transpose()?;
    Ok(Lane {
        name,
        kind,
        centre_line: thin(centre.points(), 0.01, 6.0),
        polygon,
        speed_limit_mps: limit.filter(|limit| *limit > 0.0),
        successors: Vec::new(),
        predecessors: Vec::new(),
        left: None,
        right: None,
    })
}

/// Returns the links of a lanelet; neighbours in the other direction are no one's.
fn linked(node: &Node<'_>) -> Result<Links, FieldFault> {
    let bicycles = node.all("laneletType").any(|given| given.text() == "bicycleLane");
    let beside = |side: &str| -> Result<Vec<String>, FieldFault> {
        let Some(other) = node.get(side) else { return Ok(Vec::new()) };
        let same = !bicycles && other.attribute("drivingDir") == Some("same");
        let name = other.need_attribute("ref")?.to_owned();
        Ok(if same { vec![name] } else { Vec::new() })
    };
    Ok(Links {
        exits: references(node, "successor")?,
        entries: references(node, "predecessor")?,
        left: beside("adjacentLeft")?,
        right: beside("adjacentRight")?,
    })
}

fn link(map: &mut Map, links: &[Links], notes: &mut Vec<Warning>) {
    link_by_name(map, links);
    let known: BTreeSet<&str> = map.lanes.iter().map(|lane| lane.name.as_str()).collect();
    let named = links.iter().flat_map(|links| [&links.exits, &links.entries, &links.left, &links.right]).flatten();
    let lost = named.filter(|name| !known.contains(name.as_str())).count();
    if lost > 0 {
        note(notes, "lanelet", format!("{lost} links name lanelets that the map does not have; left out"));
    }
}

/// Makes lanes connectors whose centre lines cross.
fn mark_crossing(map: &mut Map, notes: &mut Vec<Warning>) {
    let lines: Vec<&[DVec2]> = map.lanes.iter().map(|lane| lane.centre_line.as_slice()).collect();
    let boxes: Vec<Bounds> = lines.iter().map(|line| Bounds::of(line)).collect();
    let (mut crossing, mut looks) = (BTreeSet::new(), 0);
    for i in 0..lines.len() {
        for j in (0..i).filter(|j| boxes[i].overlaps(&boxes[*j])) {
            looks += lines[i].len() * lines[j].len();
            if looks > MOST_LOOKS {
                note(notes, "lanelet", "names no intersections, and is too large to look for them".to_owned());
                return;
            }
            if !(crossing.contains(&i) && crossing.contains(&j)) && crosses(lines[i], lines[j]) {
                crossing.extend([i, j]);
            }
        }
    }
    for i in &crossing {
        map.lanes[*i].kind = LaneKind::Connector;
    }
    if !crossing.is_empty() {
        let count = crossing.len();
        let message = format!("names no intersections; the {count} whose centre lines cross are taken as their lanes");
        note(notes, "lanelet", message);
    }
}

/// Says whether two lines cross at an angle, elsewhere than in the first or last metre of either.
fn crosses(one: &[DVec2], other: &[DVec2]) -> bool {
    const ENDS_M: f64 = 1.0;
    const LEAST_SINE: f64 = 0.26;
    let ends = [one[0], one[one.len() - 1], other[0], other[other.len() - 1]];
    one.windows(2).any(|a| {
        other.windows(2).any(|b| {
            let (along, across) = (a[1] - a[0], b[1] - b[0]);
            let area = along.perp_dot(across);
            let (here, there) = ((b[0] - a[0]).perp_dot(across) / area, (b[0] - a[0]).perp_dot(along) / area);
            area.abs() > LEAST_SINE * along.length() * across.length()
                && (0.0..=1.0).contains(&here)
                && (0.0..=1.0).contains(&there)
                && ends.iter().all(|end| end.distance(a[0] + along * here) > ENDS_M)
        })
    })
}

/// Paints the bounds, each line that two lanelets share once; where the file tells of no paint, what is usual.
fn paint(map: &mut Map, bounds: &[(Bound, Bound)], notes: &mut Vec<Warning>) {
    let both = |bounds: &(Bound, Bound)| [bounds.0.clone(), bounds.1.clone()];
    let told = bounds.iter().flat_map(both).any(|(_, marking)| marking.is_some());
    let (mut painted, mut unknown) = (BTreeSet::new(), BTreeMap::<String, usize>::new());
    for (lane, bounds) in map.lanes.iter().zip(bounds) {
        let usual = |beside: bool| if beside { "dashed" } else { "solid" };
        for ((points, marking), beside) in both(bounds).into_iter().zip([lane.left.is_some(), lane.right.is_some()]) {
            let inside = lane.kind == LaneKind::Connector;
            let word = if told || inside { marking.unwrap_or_default() } else { usual(beside).to_owned() };
            match kind(&word) {
                Some(Some(kind)) if painted.insert(place(&points)) => {
                    map.line_markings.push(LineMarking { kind, colour: LineColour::White, points });
                }
                Some(_) => {}
                None => *unknown.entry(word).or_default() += 1,
            }
        }
    }
    for (word, count) in unknown {
        note(notes, "lanelet.lineMarking", format!("{count} of type {word:?} are left out"));
    }
    if !told && !map.lanes.is_empty() {
        let message =
            "is nowhere told; lines between lanes of one direction are dashed, others solid, none in junctions";
        note(notes, "lanelet.lineMarking", message.to_owned());
    }
}

/// Returns what a word paints, if anything; `None` for a word that is not known.
fn kind(word: &str) -> Option<Option<LineKind>> {
    match word {
        "solid" | "broad_solid" => Some(Some(LineKind::Solid)),
        "dashed" | "broad_dashed" | "dashed_dashed" => Some(Some(LineKind::Dashed)),
        "solid_solid" | "solid_dashed" | "dashed_solid" => Some(Some(LineKind::Double)),
        "" | "unknown" | "no_marking" | "curb" | "lowered_curb" => Some(None),
        _ => None,
    }
}
