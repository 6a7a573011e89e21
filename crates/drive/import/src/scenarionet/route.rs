//! The route: the logged path, led in from behind the start and led on along lanes past the end.
//!
//! A standing ego gets a route along its lane. Which way the driver meant to go is not in a log: past its end the
//! route takes the straightest of the lanes that follow.

use ds_space::plane::path::{Path, bend, thin};
use ds_space::{DVec2, angle};
use ds_world::{EgoState, Lane, Map};

const LEAD_IN_M: f64 = 15.0;
const LEAD_ON_M: f64 = 80.0;
/// Over what length the route goes over from the log to the lane, in metres.
const JOIN_M: f64 = 12.0;

pub(crate) fn route(log: &[EgoState], map: &Map) -> Vec<DVec2> {
    let first = &log[0];
    let mut points = Vec::new();
    for metre in (1..=15).rev() {
        points.push(first.pose.position - first.pose.forward() * (f64::from(metre) * LEAD_IN_M / 15.0));
    }
    points.push(first.pose.position);
    for state in log {
        let last = points[points.len() - 1];
        // Backward creep and jitter of a standing car are left out.
        if state.pose.position.distance(last) > 0.5 && state.pose.forward().dot(state.pose.position - last) > 0.0 {
            points.push(state.pose.position);
        }
    }
    points.extend(ahead(&log[log.len() - 1], map));
    thin(&points, 0.01, 5.0)
}

/// Returns the way from the end of the log on: over to the nearest lane of the same direction and along it.
fn ahead(last: &EgoState, map: &Map) -> Vec<DVec2> {
    let position = last.pose.position;
    let straight = || (1..=8).map(|i| position + last.pose.forward() * (5.0 * f64::from(i))).collect();
    let mut best: Option<(f64, &Lane, Path, f64)> = None;
    for lane in &map.lanes {
        let Some(path) = Path::new(&lane.centre_line) else { continue };
        let foot = path.nearest(position);
        let turn = angle::turn(last.pose.heading_rad, path.heading_rad(foot.station_m)).abs();
        let off_m = path.point(foot.station_m.clamp(0.0, path.length_m())).distance(position);
        let cost = off_m + 4.0 * turn;
        if off_m < 4.0 && turn < 0.8 && best.as_ref().is_none_or(|best| cost < best.0) {
            best = Some((cost, lane, path, foot.station_m));
        }
    }
    let Some((_, lane, path, station_m)) = best else { return straight() };
    let along = Path::new(&follow(lane, &path, station_m, map)).map(|path| path.smooth(3.0));
    let Some(along) = along.filter(|along| along.length_m() > JOIN_M + 1.0) else { return straight() };
    let mut points = bend(last.pose, along.pose(JOIN_M));
    points.remove(0);
    let count = (along.length_m() - JOIN_M) as usize;
    points.extend((1..=count).map(|metre| along.point(JOIN_M + metre as f64)));
    points
}

/// Returns the centre line of a lane from a station on, and of the lanes that follow.
fn follow(lane: &Lane, path: &Path, station_m: f64, map: &Map) -> Vec<DVec2> {
    let walk = |path: &Path, from_m: f64| -> Vec<DVec2> {
        let count = (path.length_m() - from_m).max(0.0).ceil() as usize;
        (0..=count).map(|metre| path.point((from_m + metre as f64).min(path.length_m()))).collect()
    };
    let mut points = walk(path, station_m.clamp(0.0, path.length_m()));
    let mut lane = lane;
    for _ in 0..64 {
        let Some(next) = straightest(lane, map).filter(|_| (points.len() as f64) < LEAD_ON_M) else { break };
        let Some(path) = Path::new(&next.centre_line) else { break };
        points.extend(walk(&path, 0.0));
        lane = next;
    }
    points.truncate(LEAD_ON_M as usize);
    points
}

/// Returns the lane that follows with the least turn over its length.
fn straightest<'a>(lane: &Lane, map: &'a Map) -> Option<&'a Lane> {
    let turn = |lane: &Lane| {
        let path = Path::new(&lane.centre_line);
        path.map_or(f64::INFINITY, |path| (path.heading_rad(path.length_m()) - path.heading_rad(0.0)).abs())
    };
    lane.successors.iter().filter_map(|id| map.lane(*id)).min_by(|a, b| turn(a).total_cmp(&turn(b)))
}
