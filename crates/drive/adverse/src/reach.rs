//! Where a point mass may get to once it has reacted: a set that leaves nothing out, so that an empty one proves that a variant
//! as planned cannot be avoided; one that is not empty proves nothing.
//!
//! Route coordinates along the logged drive, of the rear axle: station s and offset d to the left. With |a_t| ≤ 7.6 m/s² along
//! and |a_n| ≤ 4 m/s² across the route, s̈ = (a_t + 2κṡḋ + κ'dṡ²) / m and d̈ = a_n − κṡ²m, where m = 1 − κd; the car does not
//! go backwards. Every 0.2 s the set is a list of cells of the road with what speeds are possible there, as a polygon of
//! place and speed for either axis (Söntges and Althoff 2018, "Computing the Drivable Area"). A cell falls out if what
//! every body in it covers, whatever its place and heading there, touches somebody else's body or is off the drivable surface;
//! where a map has lanes only, the road cuts nothing out. However the route bends, nobody is faster than both accelerations
//! together make him: where the route bends around a place near by, speeds in its coordinates would go beyond all bounds.

use std::collections::BTreeMap;

use ds_space::plane::{OrientedBox, Path};
use ds_space::{DVec2, Tick, angle};
use ds_world::Scene;

use crate::road::Road;
use crate::shape::{Interval, STEP_SECS, Shape, over, plus, times};

const ALONG_MPS2: f64 = 7.6;
const ACROSS_MPS2: f64 = 4.0;
const CELL_M: DVec2 = DVec2::new(2.0, 0.75);
/// The start is known so well, in metres and metres per second.
const START: DVec2 = DVec2::new(0.1, 0.1);
/// Route coordinates end where the route bends around a point this near, as a share of its radius.
const LEAST_METRIC: f64 = 0.2;
/// Below this speed along the route the heading is not that of the velocity, in metres per second.
const SLOW_MPS: f64 = 1.0;
/// No car turns faster: with 4 m/s² across and a radius of 4 m or more, at whatever speed, in radians per second.
const TURN_RADPS: f64 = 1.0;
/// The rear axle slips by less, in radians.
const SLIP_RAD: f64 = 0.05;
/// Others are looked at as often as one goes on.
const STEP_TICKS: u32 = 2;
/// So long after the planned contact it is still looked.
const AFTER_TICKS: u32 = 10;

/// Speeds along and across the route that are possible in a cell.
type Cells = BTreeMap<(i32, i32), (Shape, Shape)>;

/// What the ego has to get through.
pub(crate) struct Reach<'a> {
    scene: &'a Scene,
    road: &'a Road<'a>,
    route: Path,
    /// Curvature and its change of each metre of the route.
    bends: Vec<[f64; 2]>,
}

impl<'a> Reach<'a> {
    /// Returns nothing where the log has no way.
    pub(crate) fn new(scene: &'a Scene, road: &'a Road<'a>) -> Option<Self> {
        let points: Vec<DVec2> = scene.ego_log.iter().map(|ego| ego.pose.position).collect();
        let route = Path::new(&points)?.smooth(2.0).even(1.0);
        let curvatures: Vec<f64> = (0..=route.length_m() as usize).map(|m| route.curvature_pm(m as f64)).collect();
        let change = |i: usize| curvatures.get(i + 1).map_or(0.0, |next| next - curvatures[i]);
        let bends = (0..curvatures.len()).map(|i| [curvatures[i], change(i)]).collect();
        Some(Self { scene, road, route, bends })
    }

    /// Returns the tick at which nothing is left of what an ego reaches that leaves its log at a tick, up to a second after a contact.
    pub(crate) fn emptied(&self, from: Tick, contact: Tick) -> Option<Tick> {
        let last = contact.plus(AFTER_TICKS).min(self.scene.last_tick());
        self.cells(from, last).err()
    }

    /// Returns the headings that are possible so long after an ego left its log.
    fn headings(&self, from: Tick, ticks: u32) -> Interval {
        let (heading_rad, most_rad) =
            (self.scene.logged_ego(from).pose.heading_rad, f64::from(ticks) * 0.1 * TURN_RADPS);
        [heading_rad - most_rad, heading_rad + most_rad]
    }

    /// Returns the cells that are left at a tick, or the tick at which none were.
    fn cells(&self, from: Tick, last: Tick) -> Result<Cells, Tick> {
        let mut cells = BTreeMap::from([((0, 0), self.start(from))]);
        for tick in from.plus(STEP_TICKS).to(last).step_by(STEP_TICKS as usize) {
            let Some(next) = self.next(&cells, tick, from) else { return Ok(cells) };
            if next.is_empty() {
                return Err(tick);
            }
            cells = next;
        }
        Ok(cells)
    }

    fn start(&self, from: Tick) -> (Shape, Shape) {
        let ego = self.scene.logged_ego(from);
        let foot = self.route.nearest(ego.pose.position);
        let along = DVec2::from_angle(self.route.heading_rad(foot.station_m));
        let velocity_mps = ego.pose.forward() * ego.speed_mps().max(0.0);
        let metric = 1.0 - self.route.curvature_pm(foot.station_m) * foot.left_m;
        let shape = |place_m: f64, mps: f64| Shape::around(DVec2::new(place_m, mps), START);
        (
            shape(foot.station_m, velocity_mps.dot(along) / metric.max(LEAST_METRIC)),
            shape(foot.left_m, along.perp_dot(velocity_mps)),
        )
    }

    /// Returns the greatest speed so long after an ego left its log, in metres per second.
    fn fastest_mps(&self, from: Tick, ticks: u32) -> f64 {
        let gained_mps = f64::from(ticks) * 0.1 * ALONG_MPS2.hypot(ACROSS_MPS2);
        self.scene.logged_ego(from).speed_mps().abs() + gained_mps + START.length()
    }

    /// Returns the cells one step later, at a tick, of an ego that left its log at another; nothing where route coordinates end.
    fn next(&self, cells: &Cells, tick: Tick, from: Tick) -> Option<Cells> {
        let headings = self.headings(from, tick.0 - from.0);
        let fastest_mps = self.fastest_mps(from, tick.0 - from.0);
        let mut next = Cells::new();
        for (along, across) in cells.values() {
            let [push_along, push_across] = self.pushes(along, across)?;
            let Some(along) = along.after(push_along).forwards() else { continue };
            let columns = along.cells(CELL_M.x);
            let Some(across) = across.after(push_across).slower_than(fastest_mps) else { continue };
            let rows = across.cells(CELL_M.y);
            for (i, along) in &columns {
                for (j, across) in &rows {
                    let metric = self.metric(along, across)[0];
                    let most_mps = if metric < LEAST_METRIC { f64::INFINITY } else { fastest_mps / metric };
                    let Some(along) = along.slower_than(most_mps) else { continue };
                    let joined = |(a, b): &mut (Shape, Shape)| (*a, *b) = (a.joined(&along), b.joined(across));
                    next.entry((*i, *j)).and_modify(joined).or_insert_with(|| (along.clone(), across.clone()));
                }
            }
        }
        let seen = |track: &ds_world::Track| track.at(tick).map(|point| track.size.footprint(&point.pose));
        let others: Vec<OrientedBox> = self.scene.tracks.iter().filter_map(seen).collect();
        next.retain(|_, (along, across)| !self.shut((along, across), headings, &others));
        Some(next)
    }

    /// Returns curvature and its change on a stretch of the route.
    fn bend(&self, [from_m, to_m]: Interval) -> [Interval; 2] {
        let index = |at_m: f64| (at_m.max(0.0) as usize).min(self.bends.len());
        let here = &self.bends[index(from_m - 1.0)..index(to_m + 2.0)];
        // Beyond its ends the route goes on straight.
        let beyond = from_m < 1.0 || to_m + 2.0 > self.bends.len() as f64;
        let none = if beyond { [0.0, 0.0] } else { [f64::INFINITY, f64::NEG_INFINITY] };
        [0, 1].map(|k| here.iter().fold(none, |[low, high], bend| [bend[k].min(low), bend[k].max(high)]))
    }

    fn metric(&self, along: &Shape, across: &Shape) -> Interval {
        let [low, high] = times(self.bend(along.places())[0], across.places());
        [1.0 - high, 1.0 - low]
    }

    /// Returns the accelerations along and across in route coordinates; nothing where these end.
    fn pushes(&self, along: &Shape, across: &Shape) -> Option<[Interval; 2]> {
        let ([from_m, to_m], mps) = (along.places(), along.speeds());
        let [bend, change] = self.bend([from_m, to_m + mps[1] * STEP_SECS]);
        let metric = self.metric(along, across);
        if metric[0] < LEAST_METRIC {
            return None;
        }
        let square = times(mps, mps);
        let carried = times([2.0, 2.0], times(bend, times(mps, across.speeds())));
        let twisted = times(times(change, across.places()), square);
        let push = over(plus(plus([-ALONG_MPS2, ALONG_MPS2], carried), twisted), metric);
        let [low, high] = times(times(bend, square), metric);
        Some([push, [-ACROSS_MPS2 - high, ACROSS_MPS2 - low]])
    }

    /// Says whether no body in a cell is free and on the road.
    fn shut(&self, cell: (&Shape, &Shape), headings: Interval, others: &[OrientedBox]) -> bool {
        self.covered(cell, headings).iter().any(|part| {
            let near = |other: &&OrientedBox| {
                let reach_m = 2.0 * (part.half_length_m + other.half_length_m);
                other.centre.distance_squared(part.centre) < reach_m * reach_m
            };
            others.iter().filter(near).any(|other| other.touches(part)) || self.road.off(&part.corners())
        })
    }

    /// Returns boxes that every body in a cell covers, whose heading is one of some and of those of its speeds: long and narrow,
    /// and shorter and wider ones.
    fn covered(&self, (along, across): (&Shape, &Shape), headings: Interval) -> Vec<OrientedBox> {
        let (stations, offsets) = (along.places(), across.places());
        let [middle_m, left_m] = [stations, offsets].map(|[low, high]| 0.5 * (low + high));
        let metric = self.metric(along, across);
        let half = DVec2::new(0.5 * (stations[1] - stations[0]) * metric[1], 0.5 * (offsets[1] - offsets[0]));
        let pose = self.route.pose(middle_m);
        let bent = stations.map(|station_m| angle::turn(pose.heading_rad, self.route.heading_rad(station_m)).abs());
        // Beside the heading of the route in the middle.
        let known = headings.map(|heading_rad| heading_rad - headings[0]);
        let first = angle::turn(pose.heading_rad, headings[0] + 0.5 * known[1]) - 0.5 * known[1];
        let (mut low, mut high) = (first, first + known[1]);
        let mps = times(along.speeds(), metric);
        if mps[0] >= SLOW_MPS {
            let [least, most] = turned(mps, across.speeds());
            let more_rad = bent[0].max(bent[1]);
            (low, high) = (low.max(least - more_rad), high.min(most + more_rad));
        }
        let about_rad = 0.5 * (high - low).max(0.0) + SLIP_RAD;
        let most = low.abs().max(high.abs()).min(std::f64::consts::FRAC_PI_2).sin();
        let spread = DVec2::new(half.x + most * half.y, half.y + most * half.x);
        let at = pose.position + pose.left() * left_m;
        let forward = DVec2::from_angle(pose.heading_rad + 0.5 * (low + high));
        let (size, arm_m) = (self.scene.vehicle.size, self.scene.vehicle.rear_axle_to_centre_m);
        let (front_m, rear_m, side_m) = (0.5 * size.length_m + arm_m, 0.5 * size.length_m - arm_m, 0.5 * size.width_m);
        let part = |share: f64| {
            let tip_m = share * front_m;
            let half_width_m = side_m - spread.y - tip_m.max(rear_m) * about_rad.sin();
            let lost_m = spread.x + half_width_m * about_rad.sin();
            let (tip_m, tail_m) = (tip_m.min(front_m - lost_m), rear_m - lost_m);
            let half_length_m = 0.5 * (tip_m + tail_m);
            let centre = at + forward * (0.5 * (tip_m - tail_m));
            let part = OrientedBox { centre, forward, half_length_m, half_width_m };
            (half_width_m > 0.0 && half_length_m > 0.0).then_some(part)
        };
        if about_rad < 1.0 {
            return [1.0, 0.7, 0.4, 0.2].into_iter().filter_map(part).collect();
        }
        // However it is turned, what is around the rear axle stays.
        let round_m = (rear_m.min(side_m) - half.length()) * std::f64::consts::FRAC_1_SQRT_2;
        let part = OrientedBox { centre: at, forward, half_length_m: round_m, half_width_m: round_m };
        if round_m > 0.0 { vec![part] } else { Vec::new() }
    }
}

/// Returns the headings beside the route of speeds along, which are positive, and across.
fn turned(along_mps: Interval, across_mps: Interval) -> Interval {
    let angle = |across: f64| along_mps.map(|along| across.atan2(along));
    let [a, b] = across_mps.map(angle);
    [a[0].min(a[1]), b[0].max(b[1])]
}

#[cfg(test)]
mod tests;
