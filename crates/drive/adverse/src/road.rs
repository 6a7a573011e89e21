//! The road as an adversary sees it: lanes by place, the ways that lead through a lane, what may be driven on.
//!
//! World frame, metres. A vehicle is in a lane if it is within 2.5 m of its centre line and heads within 45° of it.

use std::f64::consts::{FRAC_PI_4, PI};

use ds_space::plane::{Bounds, Grid, IndexedPolygon, Line, Polyline};
use ds_space::{DVec2, PoseSe2, angle};
use ds_world::{LaneId, LaneKind, Map};

const IN_LANE_M: f64 = 2.5;
/// Lanes further along than this many links count as other roads.
const LINKS: usize = 4;
const MOST_WAYS: usize = 6;

/// The lanes and surfaces of a map, by place.
#[derive(Debug)]
pub(crate) struct Road<'a> {
    map: &'a Map,
    lines: Vec<Option<Line>>,
    grid: Grid,
    drivable: Vec<IndexedPolygon>,
    drivable_grid: Grid,
    junctions: Vec<IndexedPolygon>,
}

/// Where a pose lies in a lane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct InLane {
    pub lane: LaneId,
    /// Left of the centre line, in metres.
    pub left_m: f64,
    /// Heading of the lane there.
    pub heading_rad: f64,
}

/// A line that one may drive: lanes one after another.
#[derive(Debug, Clone)]
pub(crate) struct Way {
    pub line: Line,
    /// Stations at which lanes end, with their speed limits in metres per second.
    limits: Vec<(f64, f64)>,
    /// Means of the headings around each point: lane lines are coarse.
    headings_rad: Vec<f64>,
}

/// Where a point lies beside a way.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Beside {
    pub station_m: f64,
    pub left_m: f64,
    pub heading_rad: f64,
    pub curvature_pm: f64,
    pub segment: usize,
}

/// The speed that is taken as the limit where none is known, in metres per second: 1.3 times it is 25 m/s.
pub(crate) const UNKNOWN_LIMIT_MPS: f64 = 25.0 / 1.3;

impl Way {
    fn new(points: &[DVec2], limits: Vec<(f64, f64)>) -> Option<Self> {
        let even = ds_space::plane::Path::new(points)?.smooth(2.0).even(1.0);
        let line = Line::new(even.points())?;
        let headings_rad = line.arcs_m().iter().map(|arc_m| even.heading_rad(*arc_m)).collect();
        Some(Self { line, limits, headings_rad })
    }

    pub(crate) fn length_m(&self) -> f64 {
        self.line.length_m()
    }

    pub(crate) fn limit_mps(&self, station_m: f64) -> f64 {
        let at = self.limits.partition_point(|(end_m, _)| *end_m < station_m).min(self.limits.len() - 1);
        self.limits[at].1
    }

    /// Returns the place beside the way, searched from a segment on.
    pub(crate) fn beside(&self, point: DVec2, hint: usize) -> Beside {
        let near = self.line.nearest_from(point, hint);
        let (from_m, to_m) = (self.line.arcs_m()[near.segment], self.line.arcs_m()[near.segment + 1]);
        let share = (near.along_m - from_m) / (to_m - from_m);
        let (a, b) = (self.headings_rad[near.segment], self.headings_rad[near.segment + 1]);
        let direction = self.line.direction(near.segment);
        let start = self.line.points()[near.segment];
        Beside {
            station_m: near.along_m,
            left_m: direction.perp_dot(point - start),
            heading_rad: a + share * (b - a),
            curvature_pm: (b - a) / (to_m - from_m),
            segment: near.segment,
        }
    }

    /// Returns the pose at a station, so far to the left.
    pub(crate) fn pose(&self, station_m: f64, left_m: f64) -> PoseSe2 {
        let beside = self.beside(self.line.at(station_m), self.line.segment_at(station_m));
        let ahead = DVec2::from_angle(beside.heading_rad);
        PoseSe2 {
            position: self.line.at(station_m) + ahead.perp() * left_m,
            heading_rad: angle::wrap(beside.heading_rad),
        }
    }

    pub(crate) fn curvature_pm(&self, station_m: f64) -> f64 {
        self.beside(self.line.at(station_m), self.line.segment_at(station_m)).curvature_pm
    }

    /// Returns by how much the way turns between two stations, left positive.
    pub(crate) fn turn_rad(&self, from_m: f64, to_m: f64) -> f64 {
        let heading = |at_m: f64| self.headings_rad[self.line.segment_at(at_m.clamp(0.0, self.length_m()))];
        heading(to_m) - heading(from_m)
    }
}

impl<'a> Road<'a> {
    pub(crate) fn new(map: &'a Map) -> Self {
        let lines: Vec<Option<Line>> = map.lanes.iter().map(|lane| Line::new(&lane.centre_line)).collect();
        let around = |line: &Option<Line>| line.as_ref().map_or(Bounds::EMPTY, |line| wide(&Bounds::of(line.points())));
        let bounds: Vec<Bounds> = lines.iter().map(around).collect();
        let areas = |polygons: &[Vec<DVec2>]| -> Vec<IndexedPolygon> {
            polygons.iter().filter_map(|polygon| IndexedPolygon::new(polygon, &[])).collect()
        };
        let drivable = areas(&map.drivable);
        let surfaces: Vec<Bounds> = drivable.iter().map(|area| *area.bounds()).collect();
        let junctions = areas(&map.junctions);
        Self { map, lines, grid: Grid::new(&bounds), drivable_grid: Grid::new(&surfaces), drivable, junctions }
    }

    /// Returns the lane that a pose is in, the nearest of several.
    pub(crate) fn lane_at(&self, pose: &PoseSe2) -> Option<InLane> {
        let mut best: Option<(f64, InLane)> = None;
        for id in self.grid.near(pose.position) {
            let Some(line) = &self.lines[*id as usize] else { continue };
            let near = line.nearest(pose.position);
            let direction = line.direction(near.segment);
            let off_rad = angle::turn(direction.to_angle(), pose.heading_rad).abs();
            let distance_m = near.distance_squared.sqrt();
            if distance_m > IN_LANE_M || off_rad > FRAC_PI_4 {
                continue;
            }
            let cost = distance_m + 2.0 * off_rad;
            if best.is_none_or(|(least, _)| cost < least) {
                let left_m = direction.perp_dot(pose.position - line.points()[near.segment]);
                best = Some((cost, InLane { lane: LaneId(*id), left_m, heading_rad: direction.to_angle() }));
            }
        }
        best.map(|(_, lane)| lane)
    }

    /// Says whether a pose outside junctions is nearer to a lane that runs the other way than to any that runs its way.
    pub(crate) fn against(&self, pose: &PoseSe2) -> bool {
        let back = PoseSe2 { heading_rad: angle::wrap(pose.heading_rad + PI), ..*pose };
        let away_m = |lane: Option<InLane>| lane.map_or(f64::INFINITY, |lane| lane.left_m.abs());
        !self.in_junction(pose.position) && away_m(self.lane_at(&back)) < away_m(self.lane_at(pose))
    }

    /// Returns all lanes whose centre lines pass within a reach of a point, with the pose of the line there.
    pub(crate) fn lanes_near(&self, point: DVec2, reach_m: f64) -> Vec<(LaneId, PoseSe2)> {
        let mut near = Vec::new();
        for (id, line) in (0u32..).zip(&self.lines) {
            let Some(line) = line else { continue };
            let nearest = line.nearest(point);
            if nearest.distance_squared <= reach_m * reach_m {
                let pose = PoseSe2 {
                    position: line.at(nearest.along_m),
                    heading_rad: line.direction(nearest.segment).to_angle(),
                };
                near.push((LaneId(id), pose));
            }
        }
        near
    }

    /// Says whether a lane is another or leads to it or from it within a few links.
    pub(crate) fn one_way(&self, a: LaneId, b: LaneId) -> bool {
        self.reaches(a, b) || self.reaches(b, a)
    }

    fn reaches(&self, from: LaneId, to: LaneId) -> bool {
        self.onwards(from).contains(&to)
    }

    /// Returns a lane and those that it leads to within a few links.
    fn onwards(&self, from: LaneId) -> Vec<LaneId> {
        let (mut found, mut level) = (vec![from], vec![from]);
        for _ in 0..LINKS {
            level = level.iter().filter_map(|id| self.map.lane(*id)).flat_map(|lane| lane.successors.clone()).collect();
            level.retain(|id| !found.contains(id));
            level.dedup();
            found.extend(&level);
        }
        found
    }

    /// Returns how far a point lies beside where a vehicle would be that kept its place in a lane and went on through the lanes
    /// that it leads to, in metres; infinitely far where none of them passes.
    pub(crate) fn beside_m(&self, kept: &InLane, point: DVec2) -> f64 {
        let away = |id: &LaneId| {
            let line = self.lines[id.0 as usize].as_ref()?;
            let near = line.nearest(point);
            let left_m = line.direction(near.segment).perp_dot(point - line.points()[near.segment]);
            (near.distance_squared.sqrt() <= IN_LANE_M + kept.left_m.abs()).then_some((left_m - kept.left_m).abs())
        };
        self.onwards(kept.lane).iter().filter_map(away).fold(f64::INFINITY, f64::min)
    }

    /// Says whether one lane lies beside another of the same direction, or beside what leads to it or from it.
    pub(crate) fn adjacent(&self, a: LaneId, b: LaneId) -> bool {
        let sides = |id: LaneId| self.map.lane(id).map_or([None, None], |lane| [lane.left, lane.right]);
        let meets = |id: LaneId, other: LaneId| sides(id).into_iter().flatten().any(|side| self.one_way(side, other));
        meets(a, b) || meets(b, a)
    }

    /// Says whether a point lies in a junction or on a connector's surface.
    pub(crate) fn in_junction(&self, point: DVec2) -> bool {
        let on = |id: &u32| {
            let lane = &self.map.lanes[*id as usize];
            lane.kind == LaneKind::Connector && ds_space::plane::polygon::holds(&lane.polygon, point)
        };
        self.junctions.iter().any(|junction| junction.holds(point)) || self.grid.near(point).iter().any(on)
    }

    /// Says whether a body stands on what may be driven on: all corners; with lanes only, its centre near a lane.
    pub(crate) fn holds(&self, corners: &[DVec2; 4], centre: &PoseSe2) -> bool {
        if self.drivable.is_empty() {
            return self.lane_at(centre).is_some_and(|lane| lane.left_m.abs() <= 1.75 + 0.5);
        }
        corners.iter().all(|point| self.on(*point))
    }

    /// Says whether one of some points is off the drivable surface; none is where a map has lanes only.
    pub(crate) fn off(&self, points: &[DVec2; 4]) -> bool {
        !self.drivable.is_empty() && points.iter().any(|point| !self.on(*point))
    }

    fn on(&self, point: DVec2) -> bool {
        self.drivable_grid.near(point).iter().any(|id| self.drivable[*id as usize].holds(point))
    }

    /// Says whether traffic keeps left: more lanes have their oncoming neighbour on their right.
    pub(crate) fn keeps_left(&self) -> bool {
        let mut votes = 0i32;
        for line in self.lines.iter().flatten() {
            let at_m = 0.5 * line.length_m();
            let (point, direction) = (line.at(at_m), line.direction_at(at_m));
            for (_, pose) in self.lanes_near(point, 8.0) {
                if pose.forward().dot(direction) < -0.9 {
                    votes += if direction.perp_dot(pose.position - point) > 0.0 { 1 } else { -1 };
                }
            }
        }
        votes < 0
    }

    /// Returns ways through a lane, so far before its start and after its end at least where the road goes on.
    pub(crate) fn ways(&self, lane: LaneId, before_m: f64, after_m: f64) -> Vec<Way> {
        let back = self.chains(lane, before_m, false);
        let ahead = self.chains(lane, after_m, true);
        let mut ways = Vec::new();
        for before in &back {
            for after in &ahead {
                let ids: Vec<LaneId> = before.iter().rev().copied().chain(after.iter().skip(1).copied()).collect();
                ways.extend(self.way(ids));
                if ways.len() >= MOST_WAYS {
                    return ways;
                }
            }
        }
        ways
    }

    fn chains(&self, lane: LaneId, reach_m: f64, ahead: bool) -> Vec<Vec<LaneId>> {
        let mut done = Vec::new();
        let mut open = vec![(vec![lane], 0.0)];
        while let Some((chain, length_m)) = open.pop() {
            let next = chain.last().and_then(|id| self.map.lane(*id));
            let next = next.map_or(&[][..], |lane| if ahead { &lane.successors } else { &lane.predecessors });
            let fresh: Vec<LaneId> = next.iter().copied().filter(|id| !chain.contains(id)).collect();
            if length_m >= reach_m || fresh.is_empty() || done.len() >= 4 {
                done.push(chain);
                continue;
            }
            for id in fresh.into_iter().rev() {
                let more_m = self.lines[id.0 as usize].as_ref().map_or(0.0, |line| line.length_m());
                let mut longer = chain.clone();
                longer.push(id);
                open.push((longer, length_m + more_m));
            }
        }
        done.truncate(4);
        done
    }

    fn way(&self, lanes: Vec<LaneId>) -> Option<Way> {
        let mut points: Vec<DVec2> = Vec::new();
        let mut limits = Vec::new();
        for id in &lanes {
            let line = self.lines[id.0 as usize].as_ref()?;
            points.extend(line.points());
            let length_m = Polyline::new(&points)?.length_m();
            limits.push((length_m, self.map.lane(*id)?.speed_limit_mps.unwrap_or(UNKNOWN_LIMIT_MPS)));
        }
        Way::new(&points, limits)
    }
}

fn wide(bounds: &Bounds) -> Bounds {
    Bounds { low: bounds.low - IN_LANE_M, high: bounds.high + IN_LANE_M }
}
