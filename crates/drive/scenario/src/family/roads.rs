//! Builds maps piece by piece: roads of parallel lanes along a reference line, and connectors between lanes.
//!
//! Traffic keeps right: forward lanes lie right of the reference line, backward lanes left of it, index 0 innermost.
//! Everything is painted as built: edge, divider and centre lines, road edges, drivable bands.

use ds_space::plane::path::{Path, bend, thin};
use ds_space::{DVec2, PoseSe2};
use ds_world::{Lane, LaneId, LaneKind, LineColour, LineKind, LineMarking, Map, RoadEdge};

/// How a road is laid out across.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Section {
    pub forward: usize,
    pub backward: usize,
    pub lane_width_m: f64,
    /// Paved strip outside the outermost lanes, on both sides.
    pub shoulder_m: f64,
    pub speed_limit_mps: f64,
}

impl Section {
    /// Returns the half width of the lanes right of the reference line.
    pub(crate) fn right_m(&self) -> f64 {
        self.forward as f64 * self.lane_width_m
    }

    /// Returns the width of the lanes left of the reference line.
    pub(crate) fn left_m(&self) -> f64 {
        self.backward as f64 * self.lane_width_m
    }
}

/// A built road.
#[derive(Debug, Clone)]
pub(crate) struct Road {
    pub reference: Path,
    pub section: Section,
    pub forward: Vec<LaneId>,
    pub backward: Vec<LaneId>,
}

/// A map under construction, with the fine paths of its lanes.
#[derive(Debug, Default)]
pub(crate) struct Roads {
    pub map: Map,
    /// One for each lane of the map.
    pub paths: Vec<Path>,
    /// Where people walk beside the roads.
    pub pavements: Vec<Path>,
}

/// Leaves out what a map does not need of a fine curve.
pub(crate) fn drawn(points: &[DVec2]) -> Vec<DVec2> {
    thin(points, 0.015, 12.0)
}

fn path_of(points: &[DVec2]) -> Path {
    Path::new(points).expect("a built curve is longer than a millimetre")
}

impl Roads {
    /// Adds a road along a reference line.
    pub(crate) fn road(&mut self, name: &str, reference: &[DVec2], section: Section) -> Road {
        let reference = path_of(reference);
        let width = section.lane_width_m;
        let mut road = Road { reference: reference.clone(), section, forward: Vec::new(), backward: Vec::new() };
        for i in 0..section.forward {
            let centre = reference.offset(-(i as f64 + 0.5) * width);
            road.forward.push(self.lane(
                format!("{name}.f{i}"),
                (LaneKind::Road, centre),
                width,
                section.speed_limit_mps,
            ));
        }
        for i in 0..section.backward {
            let mut centre = reference.offset((i as f64 + 0.5) * width);
            centre.reverse();
            road.backward.push(self.lane(
                format!("{name}.b{i}"),
                (LaneKind::Road, centre),
                width,
                section.speed_limit_mps,
            ));
        }
        for side in [&road.forward, &road.backward] {
            for pair in side.windows(2) {
                self.map.lanes[pair[0].0 as usize].right = Some(pair[1]);
                self.map.lanes[pair[1].0 as usize].left = Some(pair[0]);
            }
        }
        self.paint(&reference, &section);
        road
    }

    fn lane(&mut self, name: String, kind_and_centre: (LaneKind, Vec<DVec2>), width_m: f64, limit_mps: f64) -> LaneId {
        let (kind, centre) = kind_and_centre;
        let id = LaneId(u32::try_from(self.map.lanes.len()).unwrap_or(u32::MAX));
        let path = path_of(&centre);
        let half = 0.5 * width_m;
        let mut polygon = drawn(&path.offset(half));
        polygon.extend(drawn(&path.offset(-half)).into_iter().rev());
        let drivable = half + if kind == LaneKind::Connector { 0.6 } else { 0.0 };
        let mut surface = drawn(&path.offset(drivable));
        surface.extend(drawn(&path.offset(-drivable)).into_iter().rev());
        self.map.drivable.push(surface);
        self.map.lanes.push(Lane {
            name,
            kind,
            centre_line: thin(path.points(), 0.015, 5.0),
            polygon,
            speed_limit_mps: Some(limit_mps),
            successors: Vec::new(),
            predecessors: Vec::new(),
            left: None,
            right: None,
        });
        self.paths.push(path);
        id
    }

    fn paint(&mut self, reference: &Path, section: &Section) {
        let width = section.lane_width_m;
        let (left, right) = (section.left_m(), section.right_m());
        let mut line = |offset_m: f64, kind, colour| {
            self.map.line_markings.push(LineMarking { kind, colour, points: drawn(&reference.offset(offset_m)) });
        };
        if section.forward > 0 && section.backward > 0 {
            let kind = if section.forward + section.backward > 2 { LineKind::Double } else { LineKind::Dashed };
            line(0.0, kind, LineColour::Yellow);
        }
        for i in 1..section.forward {
            line(-(i as f64) * width, LineKind::Dashed, LineColour::White);
        }
        for i in 1..section.backward {
            line(i as f64 * width, LineKind::Dashed, LineColour::White);
        }
        line(left - 0.1, LineKind::Solid, LineColour::White);
        line(0.1 - right, LineKind::Solid, LineColour::White);
        let edge = section.shoulder_m;
        for offset in [left + edge, -right - edge] {
            self.map.road_edges.push(RoadEdge { points: drawn(&reference.offset(offset)) });
            let beside = offset + 1.8 * offset.signum();
            self.pavements.push(path_of(&reference.offset(beside)));
        }
        let mut whole = drawn(&reference.offset(left + edge));
        whole.extend(drawn(&reference.offset(-right - edge)).into_iter().rev());
        self.map.drivable.push(whole);
    }

    /// Adds a connector from the end of one lane to the start of another.
    pub(crate) fn connect(&mut self, name: String, from: LaneId, to: LaneId, width_m: f64) -> LaneId {
        let (before, after) = (&self.paths[from.0 as usize], &self.paths[to.0 as usize]);
        let curve = bend(before.pose(before.length_m()), after.pose(0.0));
        self.connector(name, from, to, (curve, width_m))
    }

    /// Adds a connector along a given curve between two lanes.
    pub(crate) fn connector(&mut self, name: String, from: LaneId, to: LaneId, curve: (Vec<DVec2>, f64)) -> LaneId {
        let limit = self.map.lanes[from.0 as usize].speed_limit_mps.unwrap_or(10.0).min(9.0);
        let id = self.lane(name, (LaneKind::Connector, curve.0), curve.1, limit);
        self.follow(from, id);
        self.follow(id, to);
        id
    }

    /// Adds a lane of a roundabout, of a width in metres and a limit in metres per second.
    pub(crate) fn ring_lane(&mut self, name: String, curve: Vec<DVec2>, width_and_limit: (f64, f64)) -> LaneId {
        self.lane(name, (LaneKind::Road, curve), width_and_limit.0, width_and_limit.1)
    }

    /// Notes that a lane begins where another ends.
    pub(crate) fn follow(&mut self, from: LaneId, to: LaneId) {
        self.map.lanes[from.0 as usize].successors.push(to);
        self.map.lanes[to.0 as usize].predecessors.push(from);
    }

    /// Returns one smooth path over consecutive lanes.
    pub(crate) fn route(&self, lanes: &[LaneId]) -> Path {
        let points: Vec<DVec2> =
            lanes.iter().flat_map(|id| self.paths[id.0 as usize].points().iter().copied()).collect();
        path_of(&points).smooth(2.5).smooth(2.0)
    }

    /// Returns the path of one lane.
    pub(crate) fn path(&self, lane: LaneId) -> &Path {
        &self.paths[lane.0 as usize]
    }
}

/// Returns a reference line of (length, curvature) pieces that passes the origin along +x, `before_m` after its start.
pub(crate) fn line(pieces: &[(f64, f64)], before_m: f64) -> Vec<DVec2> {
    ds_space::plane::path::trace(PoseSe2::new(-before_m, 0.0, 0.0), pieces)
}
