//! Builds junctions of up to four arms and roundabouts around the origin, with connectors, crosswalks, lights and edges.
//!
//! Arm 0 points south, the others follow counter-clockwise. Each arm's road leads outwards: its forward lanes leave
//! the junction, its backward lanes approach it.

use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_2;

use ds_space::plane::path::{bend, trace};
use ds_space::{DVec2, PoseSe2};
use ds_world::{Crosswalk, LaneId, LightState, RoadEdge, StopLine, TrafficLight};

use crate::family::dice::Dice;
use crate::family::roads::{Road, Roads, Section, drawn};
use crate::family::stage::TICKS;

/// A junction: its arms (`None` where there is none) and the connectors between their lanes.
#[derive(Debug)]
pub(crate) struct Junction {
    pub roads: Roads,
    pub arms: Vec<Option<Road>>,
    /// By arm from, arm to and lane counted from the middle.
    pub connectors: BTreeMap<(usize, usize, usize), LaneId>,
    /// From the mouth of an arm outwards to its stop line, in metres.
    pub stop_m: f64,
    /// From the origin to the mouths, in metres.
    pub mouth_m: f64,
    /// Directions of the arms, in radians.
    pub directions_rad: Vec<f64>,
}

/// What a junction is to look like.
#[derive(Debug, Clone, Copy)]
pub(crate) struct JunctionDesign {
    pub section: Section,
    pub mouth_m: f64,
    pub present: [bool; 4],
    pub crosswalks: bool,
}

const ARM_M: f64 = 170.0;

fn arms(dice: &mut Dice, plan: &JunctionDesign, roads: &mut Roads) -> (Vec<Option<Road>>, Vec<f64>) {
    let mut arms = Vec::new();
    let mut directions = Vec::new();
    for (i, present) in plan.present.iter().enumerate() {
        let direction = -FRAC_PI_2 + i as f64 * FRAC_PI_2 + dice.range(-0.12, 0.12);
        let start = PoseSe2 { position: DVec2::from_angle(direction) * plan.mouth_m, heading_rad: direction };
        let bend_pm = dice.range(-0.006, 0.006);
        let reference = trace(start, &[(50.0, 0.0), (60.0, bend_pm), (ARM_M - 110.0, 0.0)]);
        arms.push(present.then(|| roads.road(&format!("arm{i}"), &reference, plan.section)));
        directions.push(direction);
    }
    (arms, directions)
}

/// Returns the curves along the outside from each arm's left mouth corner to the next arm's right one.
fn corners(arms: &[Option<Road>]) -> Vec<(usize, Vec<DVec2>)> {
    let present: Vec<(usize, &Road)> =
        arms.iter().enumerate().filter_map(|(i, arm)| arm.as_ref().map(|arm| (i, arm))).collect();
    let mut curves = Vec::new();
    for (k, (index, arm)) in present.iter().enumerate() {
        let (_, next) = present[(k + 1) % present.len()];
        let mouth = arm.reference.pose(0.0);
        let left = mouth.to_outer(DVec2::new(0.0, arm.section.left_m() + arm.section.shoulder_m));
        let next_mouth = next.reference.pose(0.0);
        let right = next_mouth.to_outer(DVec2::new(0.0, -next.section.right_m() - next.section.shoulder_m));
        let from = PoseSe2 { position: left, heading_rad: mouth.heading_rad + std::f64::consts::PI };
        curves.push((*index, bend(from, PoseSe2 { position: right, heading_rad: next_mouth.heading_rad })));
    }
    curves
}

/// Builds a junction.
pub(crate) fn junction(dice: &mut Dice, plan: &JunctionDesign) -> Junction {
    let mut roads = Roads::default();
    let (arms, directions_rad) = arms(dice, plan, &mut roads);
    let mut connectors = BTreeMap::new();
    for (i, j) in (0..4usize).flat_map(|i| (0..4usize).map(move |j| (i, j))) {
        let (Some(from), Some(to)) = (&arms[i], &arms[j]) else { continue };
        let last = plan.section.forward - 1;
        let lanes: Vec<usize> = match (j + 4 - i) % 4 {
            0 => continue,
            1 => vec![last],
            2 => (0..=last).collect(),
            _ => vec![0],
        };
        for lane in lanes {
            let name = format!("turn{i}{j}.{lane}");
            let id = roads.connect(name, from.backward[lane], to.forward[lane], plan.section.lane_width_m);
            connectors.insert((i, j, lane), id);
        }
    }
    let mut outline = Vec::new();
    for (_, curve) in corners(&arms) {
        let curve = drawn(&curve);
        outline.extend_from_slice(&curve);
        roads.map.road_edges.push(RoadEdge { points: curve });
    }
    roads.map.junctions.push(outline.clone());
    roads.map.drivable.push(outline);
    let stop_m = if plan.crosswalks { 5.6 } else { 1.0 };
    for arm in arms.iter().flatten() {
        mark(&mut roads, arm, stop_m, plan.crosswalks);
    }
    Junction { roads, arms, connectors, stop_m, mouth_m: plan.mouth_m, directions_rad }
}

fn mark(roads: &mut Roads, arm: &Road, stop_m: f64, crosswalk: bool) {
    let at = |along: f64, left: f64| arm.reference.pose(along).to_outer(DVec2::new(0.0, left));
    let (left, right) = (arm.section.left_m() + arm.section.shoulder_m, arm.section.right_m() + arm.section.shoulder_m);
    if crosswalk {
        let polygon = vec![at(1.2, left), at(1.2, -right), at(4.4, -right), at(4.4, left)];
        roads.map.crosswalks.push(Crosswalk { polygon });
    }
    let points = [at(stop_m, 0.0), at(stop_m, arm.section.left_m())];
    roads.map.stop_lines.push(StopLine { points, light: None });
}

impl Junction {
    /// Returns the lanes that lead from one arm through the junction to another, by lane counted from the middle.
    pub(crate) fn way(&self, from: usize, to: usize, lane: usize) -> Option<[LaneId; 3]> {
        let connector = *self.connectors.get(&(from, to, lane))?;
        Some([self.arms[from].as_ref()?.backward[lane], connector, self.arms[to].as_ref()?.forward[lane]])
    }

    /// Returns the station of an arm's stop line on routes that begin with its lane.
    pub(crate) fn stop_station_m(&self, from: usize, lane: usize) -> f64 {
        self.arms[from].as_ref().map_or(0.0, |arm| self.roads.path(arm.backward[lane]).length_m() - self.stop_m)
    }

    /// Adds one light an arm, across the junction; `shows(arm, tick)` is its state.
    pub(crate) fn signal(&mut self, shows: impl Fn(usize, u32) -> LightState) {
        for i in 0..self.arms.len() {
            let Some(arm) = &self.arms[i] else { continue };
            let outwards = PoseSe2 { position: DVec2::ZERO, heading_rad: self.directions_rad[i] };
            let beside = arm.section.left_m().max(arm.section.right_m()) + arm.section.shoulder_m + 0.7;
            let position = outwards.to_outer(DVec2::new(-self.mouth_m - 0.5, beside)).extend(4.9);
            let light = u32::try_from(self.roads.map.traffic_lights.len()).unwrap_or(0);
            self.roads.map.traffic_lights.push(TrafficLight {
                position,
                facing_rad: ds_space::angle::wrap(self.directions_rad[i]),
                lanes: arm.backward.clone(),
                states: (0..TICKS).map(|tick| shows(i, tick)).collect(),
            });
            if let Some(stop) = self.roads.map.stop_lines.get_mut(light as usize) {
                stop.light = Some(light);
            }
        }
    }
}

/// A roundabout: arms, ring lanes and the ways on and off.
#[derive(Debug)]
pub(crate) struct Roundabout {
    pub roads: Roads,
    pub arms: Vec<Road>,
    /// By arm: the connectors onto and off the ring.
    pub entries: Vec<LaneId>,
    pub exits: Vec<LaneId>,
    /// Ring lanes counter-clockwise: from exit to entry of arm k, then from entry of arm k to exit of arm k + 1.
    pub ring: Vec<LaneId>,
    /// By arm, where its way on meets the ring.
    pub merges: Vec<DVec2>,
    pub stop_m: f64,
}

fn arc(radius_m: f64, from_rad: f64, to_rad: f64) -> Vec<DVec2> {
    let count = (((to_rad - from_rad) * radius_m / 0.5).abs().ceil() as usize).max(4);
    (0..=count)
        .map(|i| DVec2::from_angle(from_rad + (to_rad - from_rad) * i as f64 / count as f64) * radius_m)
        .collect()
}

/// Builds a roundabout of single lanes whose centre line has a radius, with a ring of `ring_width_m`.
pub(crate) fn roundabout(dice: &mut Dice, plan: &JunctionDesign, radius_m: f64, ring_width_m: f64) -> Roundabout {
    let mut roads = Roads::default();
    let (arms, directions) = arms(dice, plan, &mut roads);
    let arms: Vec<Road> = arms.into_iter().flatten().collect();
    let spread_rad = 0.62;
    let mut ring = Vec::new();
    let limit = 8.0;
    for k in 0..4 {
        let next = directions[(k + 1) % 4] + if k == 3 { std::f64::consts::TAU } else { 0.0 };
        let (off, on) = (directions[k] - spread_rad, directions[k] + spread_rad);
        ring.push(roads.ring_lane(format!("ring{k}.arm"), arc(radius_m, off, on), (ring_width_m, limit)));
        ring.push(roads.ring_lane(
            format!("ring{k}.side"),
            arc(radius_m, on, next - spread_rad),
            (ring_width_m, limit),
        ));
    }
    for k in 0..8 {
        roads.follow(ring[k], ring[(k + 1) % 8]);
    }
    let (mut entries, mut exits, mut merges) = (Vec::new(), Vec::new(), Vec::new());
    for (k, arm) in arms.iter().enumerate() {
        let on_rad = directions[k] + spread_rad;
        let on = PoseSe2 { position: DVec2::from_angle(on_rad) * radius_m, heading_rad: on_rad + FRAC_PI_2 };
        let approach = roads.path(arm.backward[0]);
        let curve = bend(approach.pose(approach.length_m()), on);
        let width = plan.section.lane_width_m + 0.6;
        entries.push(roads.connector(format!("on{k}"), arm.backward[0], ring[2 * k + 1], (curve, width)));
        let off_rad = directions[k] - spread_rad;
        let off = PoseSe2 { position: DVec2::from_angle(off_rad) * radius_m, heading_rad: off_rad + FRAC_PI_2 };
        let curve = bend(off, roads.path(arm.forward[0]).pose(0.0));
        exits.push(roads.connector(format!("off{k}"), ring[(2 * k + 7) % 8], arm.forward[0], (curve, width)));
        merges.push(on.position);
    }
    let inner_m = radius_m - 0.5 * ring_width_m;
    surround(&mut roads, &arms, &directions, (inner_m, radius_m + 0.5 * ring_width_m));
    for arm in &arms {
        mark(&mut roads, arm, 0.8, false);
    }
    Roundabout { roads, arms, entries, exits, ring, merges, stop_m: 0.8 }
}

/// Adds the edges and surface of a roundabout, sector by sector.
fn surround(roads: &mut Roads, arms: &[Road], directions: &[f64], radii_m: (f64, f64)) {
    use std::f64::consts::TAU;
    let (inner_m, outer_m) = (radii_m.0 - 0.3, radii_m.1 + 0.5);
    for (k, arm) in arms.iter().enumerate() {
        let here = directions[k];
        let after = directions[(k + 1) % 4] + if k == 3 { TAU } else { 0.0 };
        let before = directions[(k + 3) % 4] - if k == 0 { TAU } else { 0.0 };
        let (first, last) = (0.5 * (before + here), 0.5 * (here + after));
        let flare = 0.72;
        let mouth = arm.reference.pose(0.0);
        let side =
            |left_m: f64, heading_rad: f64| PoseSe2 { position: mouth.to_outer(DVec2::new(0.0, left_m)), heading_rad };
        let on_circle = |at: f64| PoseSe2 { position: DVec2::from_angle(at) * outer_m, heading_rad: at + FRAC_PI_2 };
        let mut right = arc(outer_m, first, here - flare);
        right.extend(bend(
            on_circle(here - flare),
            side(-arm.section.right_m() - arm.section.shoulder_m, mouth.heading_rad),
        ));
        let back = mouth.heading_rad + std::f64::consts::PI;
        let mut left = bend(side(arm.section.left_m() + arm.section.shoulder_m, back), on_circle(here + flare));
        left.extend(arc(outer_m, here + flare, last));
        let (right, left) = (drawn(&right), drawn(&left));
        let mut sector = right.clone();
        sector.extend_from_slice(&left);
        let mut island = drawn(&arc(inner_m, first, last));
        roads.map.road_edges.push(RoadEdge { points: right });
        roads.map.road_edges.push(RoadEdge { points: left });
        roads.map.road_edges.push(RoadEdge { points: island.clone() });
        island.reverse();
        sector.extend(island);
        roads.map.junctions.push(sector.clone());
        roads.map.drivable.push(sector);
    }
}
