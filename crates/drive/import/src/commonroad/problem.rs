//! A planning problem: where a drive begins and where and when it should end. Nobody drove it, so its log is drawn.
//!
//! The way follows the lanes, with changes to neighbours where the goal lies on another one; without lanes from start
//! to goal it is one curve. Along it the speed goes from the initial to the middle of the goal's interval, as a
//! parabola over time; where that would roll backwards, at even acceleration, else to a stop. Others are not looked at.

use std::collections::{BTreeMap, BinaryHeap};

use ds_space::plane::path::{Path, bend};
use ds_space::{DVec2, PoseSe2, angle};
use ds_world::{LaneId, Map};

use super::element::Node;
use super::obstacles::position;
use crate::view::FieldFault;

/// Over what length the way goes over from the start to the lane and from the lane to the goal, in metres.
const JOIN_M: f64 = 15.0;
/// A lane farther from a place than this is not its lane, in metres.
const NEAR_M: f64 = 4.0;
/// What changing lanes costs, in metres of way.
const CHANGE_M: f64 = 10.0;

/// A planning problem of the file.
#[derive(Debug)]
pub(super) struct Problem {
    pub name: String,
    /// The first and the last time step.
    pub steps: (u32, u32),
    /// The centre of the body.
    pub start: PoseSe2,
    speed_mps: f64,
    goal: Option<DVec2>,
    goal_lanelets: Vec<String>,
    goal_heading_rad: Option<f64>,
    goal_speed_mps: Option<f64>,
}

impl Problem {
    /// Reads a problem; of several goals the first counts.
    pub(super) fn of(node: &Node<'_>) -> Result<Self, FieldFault> {
        let initial = node.need("initialState")?;
        let heading_rad = angle::wrap(initial.need("orientation")?.value()?);
        let goal = node.need("goalState")?;
        let first = initial.get("time").map(|time| time.step()).transpose()?.unwrap_or(0);
        let time = goal.need("time")?;
        let last = time.step()?;
        if last <= first {
            return Err(time.fault(format!("ends at step {last}, not after the initial step {first}")));
        }
        let place = goal.get("position");
        let goal_lanelets: Vec<String> =
            place.iter().map(|place| super::references(place, "lanelet")).collect::<Result<Vec<_>, _>>()?.concat();
        let area = place.filter(|_| goal_lanelets.is_empty()).map(|_| position(&goal)).transpose()?;
        let value = |name: &str| goal.get(name).map(|value| value.value()).transpose();
        Ok(Self {
            name: node.need_attribute("id")?.to_owned(),
            steps: (first, last),
            start: PoseSe2 { position: position(&initial)?, heading_rad },
            speed_mps: initial.need("velocity")?.value()?.max(0.0),
            goal: area,
            goal_lanelets,
            goal_heading_rad: value("orientation")?,
            goal_speed_mps: value("velocity")?,
        })
    }

    /// Draws the drive: the centre of the body at each of two or more ticks, `origin` being where the map's origin lies.
    pub(super) fn drawn(&self, map: &Map, origin: DVec2, count: usize, dt_secs: f64) -> Vec<PoseSe2> {
        let start = PoseSe2 { position: self.start.position - origin, ..self.start };
        let secs = (count - 1) as f64 * dt_secs;
        let (way, bound) = self.way(map, start, origin, self.speed_mps * secs);
        let Some(way) = Path::new(&way).filter(|way| way.length_m() > 0.1) else { return vec![start; count] };
        let length_m = if bound { way.length_m() } else { way.length_m().min(self.speed_mps * secs) };
        let speed = Speed::new(length_m, secs, self.speed_mps, self.goal_speed_mps);
        (0..count).map(|tick| way.pose(speed.driven_m(tick as f64 * dt_secs).clamp(0.0, way.length_m()))).collect()
    }

    /// Returns the way and whether it ends at the goal; a goal without a place is `reach_m` along the lane.
    fn way(&self, map: &Map, start: PoseSe2, origin: DVec2, reach_m: f64) -> (Vec<DVec2>, bool) {
        let named = map.lanes.iter().find(|lane| self.goal_lanelets.contains(&lane.name));
        let middle = named.and_then(|lane| Path::new(&lane.centre_line)).map(|path| path.point(0.5 * path.length_m()));
        let Some(goal) = self.goal.map(|goal| goal - origin).or(middle) else {
            let ahead = start.position + start.forward() * reach_m.max(1.0);
            return (vec![start.position, ahead], false);
        };
        let direct = || {
            let towards = || (goal - start.position).to_angle();
            let heading_rad = self.goal_heading_rad.unwrap_or_else(towards);
            bend(start, PoseSe2 { position: goal, heading_rad })
        };
        let centre = centre_line(map, start, goal).and_then(|points| Path::new(&points)).map(|path| path.smooth(3.0));
        let Some(centre) = centre.filter(|centre| centre.length_m() > 4.0) else { return (direct(), true) };
        let (length_m, join_m) = (centre.length_m(), JOIN_M.min(0.5 * centre.length_m()));
        let mut points = bend(start, centre.pose(join_m));
        let count = (length_m - 2.0 * join_m).floor().max(0.0) as usize;
        points.extend((1..count).map(|metre| centre.point(join_m + metre as f64)));
        let end = PoseSe2 { position: goal, heading_rad: centre.heading_rad(length_m) };
        points.extend(bend(centre.pose(length_m - join_m), end).into_iter().skip(1));
        (points, true)
    }
}

/// How far is driven over time: a parabola of speed, or an even change of it until it stands.
#[derive(Debug)]
struct Speed {
    from_mps: f64,
    change_mps2: f64,
    bend_mps3: f64,
    until_secs: f64,
}

impl Speed {
    fn new(length_m: f64, secs: f64, from_mps: f64, to_mps: Option<f64>) -> Self {
        let even = Self {
            from_mps,
            change_mps2: 2.0 * (length_m - from_mps * secs) / (secs * secs),
            bend_mps3: 0.0,
            until_secs: secs,
        };
        // Both the way and the last speed are met: v0 T + c T² / 2 + b T³ / 3 = s, v0 + c T + b T² = v1.
        let parabola = to_mps.map(|to_mps| {
            let mean = length_m / secs;
            let change_mps2 = (6.0 * mean - 4.0 * from_mps - 2.0 * to_mps) / secs;
            let bend_mps3 = 3.0 * (from_mps + to_mps - 2.0 * mean) / (secs * secs);
            Self { change_mps2, bend_mps3, ..even }
        });
        let stop = Self {
            change_mps2: -from_mps * from_mps / (2.0 * length_m),
            until_secs: 2.0 * length_m / from_mps,
            ..even
        };
        let forwards = |speed: &Self| (0..=100).all(|i| speed.at_mps(secs * f64::from(i) / 100.0) >= -1e-9);
        parabola.into_iter().chain([even]).find(forwards).unwrap_or(stop)
    }

    fn at_mps(&self, secs: f64) -> f64 {
        self.from_mps + self.change_mps2 * secs + self.bend_mps3 * secs * secs
    }

    fn driven_m(&self, secs: f64) -> f64 {
        let secs = secs.min(self.until_secs);
        secs * (self.from_mps + secs * (self.change_mps2 / 2.0 + secs * self.bend_mps3 / 3.0))
    }
}

/// Returns the centre line of the lanes from beside the start to beside the goal.
fn centre_line(map: &Map, start: PoseSe2, goal: DVec2) -> Option<Vec<DVec2>> {
    let paths: Vec<Option<Path>> = map.lanes.iter().map(|lane| Path::new(&lane.centre_line)).collect();
    let beside = |point: DVec2, heading_rad: Option<f64>| {
        let near = paths.iter().enumerate().filter_map(|(i, path)| {
            let path = path.as_ref()?;
            let station_m = path.nearest(point).station_m.clamp(0.0, path.length_m());
            let off_m = path.point(station_m).distance(point);
            let turn = heading_rad.map_or(0.0, |heading| angle::turn(heading, path.heading_rad(station_m)).abs());
            (off_m < NEAR_M && turn < 0.8).then_some((off_m + 4.0 * turn, i, station_m))
        });
        near.min_by(|a, b| a.0.total_cmp(&b.0))
    };
    let (_, first, mut along_m) = beside(start.position, Some(start.heading_rad))?;
    let (_, last, goal_m) = beside(goal, None)?;
    let lanes = chain(map, &paths, first, last)?;
    let mut points = Vec::new();
    for pair in lanes.windows(2) {
        let (here, next) = (paths[pair[0]].as_ref()?, paths[pair[1]].as_ref()?);
        if map.lanes[pair[0]].successors.iter().any(|id| id.0 as usize == pair[1]) {
            points.extend(walked(here, along_m, here.length_m()));
            along_m = 0.0;
            continue;
        }
        let ends = if pair[1] == last { here.nearest(goal).station_m } else { here.length_m() };
        let room_m = ends - along_m;
        if room_m < 4.0 {
            return None;
        }
        let (leave_m, arrive) = (along_m + 0.2 * room_m, here.point(along_m + 0.8 * room_m));
        points.extend(walked(here, along_m, leave_m));
        along_m = next.nearest(arrive).station_m.clamp(0.0, next.length_m());
        points.extend(bend(here.pose(leave_m), next.pose(along_m)));
    }
    points.extend(walked(paths[last].as_ref()?, along_m, goal_m));
    Some(points)
}

fn walked(path: &Path, from_m: f64, to_m: f64) -> Vec<DVec2> {
    let count = (to_m - from_m).max(0.0).ceil() as usize;
    (0..=count).map(|metre| path.point((from_m + metre as f64).min(to_m.max(from_m)))).collect()
}

/// Returns the lanes of the shortest way from one to another, over successors and neighbours.
fn chain(map: &Map, paths: &[Option<Path>], first: usize, last: usize) -> Option<Vec<usize>> {
    let mut before: BTreeMap<usize, (u64, usize)> = BTreeMap::from([(first, (0, first))]);
    let mut open = BinaryHeap::from([(std::cmp::Reverse(0), first)]);
    while let Some((std::cmp::Reverse(cost), at)) = open.pop() {
        if at == last {
            let mut lanes = vec![last];
            while lanes[lanes.len() - 1] != first {
                lanes.push(before.get(&lanes[lanes.len() - 1])?.1);
            }
            lanes.reverse();
            return Some(lanes);
        }
        let lane = &map.lanes[at];
        let length_m = paths[at].as_ref().map_or(0.0, Path::length_m);
        let on = lane.successors.iter().map(|id| (*id, length_m));
        let aside = lane.left.iter().chain(&lane.right).map(|id| (*id, CHANGE_M));
        for (LaneId(next), more_m) in on.chain(aside) {
            let (next, reached) = (next as usize, cost + (more_m * 100.0) as u64);
            if before.get(&next).is_none_or(|(known, _)| reached < *known) {
                before.insert(next, (reached, at));
                open.push((std::cmp::Reverse(reached), next));
            }
        }
    }
    None
}
