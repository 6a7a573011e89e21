//! Where paths of road users cross or merge, who has the right of way there, and whether a gap is long enough.
//!
//! A *zone* is where two paths come closer than two bodies need. Right of way: whoever passes an unlit stop line
//! yields, then whoever turns more, then whoever comes from the left; vehicles yield to people at a crosswalk. Oncoming
//! and parallel paths have no zone (following and lane changes take care). Metres along a path, SI units.

use ds_space::DVec2;
use ds_space::plane::polygon;
use ds_world::Map;

use crate::agent_path::{AgentPath, KNOT_M};

/// Paths nearer than this meet: vehicles, and a vehicle with somebody on foot.
const VEHICLES_M: f64 = 2.5;
const ON_FOOT_M: f64 = 2.0;
/// Paths within 20° of parallel do not cross.
const PARALLEL: f64 = 0.94;
/// A merge is over for the one who yields after this way.
const LONGEST_M: f64 = 12.0;
/// The turn of a path counts from so far before a zone to so far behind its begin.
const TURN_M: (f64, f64) = (15.0, 15.0);
/// Turns count as different beyond this.
const TURN_RAD: f64 = 0.4;
/// A stop line governs zones so far behind it.
const LINE_M: f64 = 25.0;
/// Time between the one and the other in a zone that drivers demand.
pub(crate) const MARGIN_SECS: f64 = 1.0;
/// Drivers who would have to brake harder go on.
const HARDEST_MPS2: f64 = 4.0;
/// Vehicles let people cross who are so near the zone, if they can stop by braking so.
const WAITING_M: f64 = 4.0;
const COURTEOUS_MPS2: f64 = 3.0;
/// Slower than this a vehicle counts as waiting.
const WAITING_MPS: f64 = 1.0;

/// Who goes first in a zone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Duty {
    /// This one waits.
    Yield,
    /// This one has the right of way.
    Go,
    /// A vehicle waits for people at a crosswalk.
    Crosswalk,
    /// Somebody on foot waits for a gap; at a crosswalk for vehicles that can still stop.
    Step {
        /// Whether there is a crosswalk.
        marked: bool,
    },
}

/// A zone as one of the two sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Zone {
    /// Index of the other one.
    pub other: usize,
    /// Own stretch, m along the path.
    pub own_m: [f64; 2],
    /// The other's stretch, m along its path.
    pub other_m: [f64; 2],
    /// Who goes first.
    pub duty: Duty,
}

/// A path with what matters at zones.
pub(crate) struct Way<'a> {
    pub(crate) path: &'a AgentPath,
    pub(crate) on_foot: bool,
    points: Vec<DVec2>,
    bounds: (DVec2, DVec2),
    lines_m: Vec<f64>,
}

impl<'a> Way<'a> {
    pub(crate) fn new(path: &'a AgentPath, on_foot: bool, map: &Map) -> Self {
        let points: Vec<DVec2> = path.positions().collect();
        let low = points.iter().copied().fold(DVec2::INFINITY, DVec2::min);
        let high = points.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
        let unlit = map.stop_lines.iter().filter(|line| line.light.is_none());
        let mut lines_m: Vec<f64> = unlit.filter_map(|line| crossed(&points, line.points)).collect();
        lines_m.sort_by(f64::total_cmp);
        Self { path, on_foot, points, bounds: (low - VEHICLES_M, high + VEHICLES_M), lines_m }
    }

    fn turn_rad(&self, at_m: f64) -> f64 {
        let heading = |along_m: f64| self.path.direction_at(along_m.clamp(0.0, self.path.length_m())).to_angle();
        ds_space::angle::turn(heading(at_m - TURN_M.0), heading(at_m + TURN_M.1)).abs()
    }

    fn stops_before(&self, at_m: f64) -> bool {
        self.lines_m.iter().any(|line_m| (0.0..LINE_M).contains(&(at_m - line_m)))
    }
}

fn crossed(points: &[DVec2], [a, b]: [DVec2; 2]) -> Option<f64> {
    let side = |p: DVec2| (b - a).perp_dot(p - a);
    points.windows(2).enumerate().find_map(|(index, ends)| {
        let (from, to) = (side(ends[0]), side(ends[1]));
        let share = from / (from - to);
        let across = (ends[0].lerp(ends[1], share) - a).dot(b - a) / (b - a).length_squared();
        let meets = from * to < 0.0 && (0.0..=1.0).contains(&across);
        meets.then_some((index as f64 + share) * KNOT_M)
    })
}

/// Returns the zones of two ways, as the first and as the second one sees each; `unmarked` treats every place where
/// people cross as a crosswalk.
pub(crate) fn zones(a: (usize, &Way<'_>), b: (usize, &Way<'_>), map: &Map, unmarked: bool) -> Vec<[Zone; 2]> {
    // Who is looked at first must not depend on the order of the tracks.
    let first = |way: &Way<'_>| (way.points[0].x, way.points[0].y, way.points.len() as f64);
    let (one, other) = (first(a.1), first(b.1));
    let later = one.0.total_cmp(&other.0).then(one.1.total_cmp(&other.1)).then(one.2.total_cmp(&other.2)).is_gt();
    if later {
        return zones(b, a, map, unmarked).into_iter().map(|[mine, theirs]| [theirs, mine]).collect();
    }
    let ((i, a), (j, b)) = (a, b);
    let apart = a.bounds.0.cmpgt(b.bounds.1).any() || b.bounds.0.cmpgt(a.bounds.1).any();
    if apart || (a.on_foot && b.on_foot) {
        return Vec::new();
    }
    let reach_m = if a.on_foot || b.on_foot { ON_FOOT_M } else { VEHICLES_M };
    let mut found = Vec::new();
    let mut run: Option<([f64; 2], [f64; 2], bool)> = None;
    for k in 0..=a.points.len() {
        let near = a.points.get(k).and_then(|point| nearest(*point, &b.points, reach_m));
        let along_m = k as f64 * KNOT_M;
        match (near, &mut run) {
            (Some((other_m, span_m)), None) => {
                let cosine = a.path.direction_at(along_m).dot(b.path.direction_at(other_m));
                run = Some(([along_m; 2], span_m, cosine.abs() < PARALLEL));
            }
            (Some((_, span_m)), Some((own, other, _))) if along_m - own[0] <= LONGEST_M => {
                own[1] = along_m;
                *other = [other[0].min(span_m[0]), other[1].max(span_m[1])];
            }
            (None, Some((own, other, true))) => {
                let (own, other) = (Side { agent: i, way: a, zone_m: *own }, Side { agent: j, way: b, zone_m: *other });
                found.push(pair(&own, &other, map, unmarked));
                run = None;
            }
            (None, Some(_)) => run = None,
            _ => {}
        }
    }
    found
}

/// Returns the nearest place of another path in reach, and its stretch in reach.
fn nearest(point: DVec2, others: &[DVec2], reach_m: f64) -> Option<(f64, [f64; 2])> {
    let mut best: Option<(f64, usize)> = None;
    let mut k = 0;
    while k < others.len() {
        let squared = point.distance_squared(others[k]);
        if squared < reach_m * reach_m && best.is_none_or(|(least, _)| squared < least) {
            best = Some((squared, k));
        }
        // Knots are a metre apart: none nearer than this many further on can be in reach.
        k += ((squared.sqrt() - reach_m) / KNOT_M).max(1.0) as usize;
    }
    let (_, at) = best?;
    let near = |k: &usize| point.distance_squared(others[*k]) < reach_m * reach_m;
    let low = (0..=at).rev().take_while(near).last().unwrap_or(at);
    let high = (at..others.len()).take_while(near).last().unwrap_or(at);
    Some((at as f64 * KNOT_M, [low, high].map(|k| k as f64 * KNOT_M)))
}

/// One of two ways that meet, and where on it.
struct Side<'a, 'w> {
    agent: usize,
    way: &'a Way<'w>,
    zone_m: [f64; 2],
}

fn pair(own: &Side<'_, '_>, other: &Side<'_, '_>, map: &Map, unmarked: bool) -> [Zone; 2] {
    let (a, b) = (own.way, other.way);
    let duties = if a.on_foot || b.on_foot {
        let walker = if a.on_foot { own } else { other };
        let marked = unmarked || on_crosswalk(walker.way.path, walker.zone_m, map);
        let vehicle = if marked { Duty::Crosswalk } else { Duty::Go };
        if a.on_foot { [Duty::Step { marked }, vehicle] } else { [vehicle, Duty::Step { marked }] }
    } else if yields(a, own.zone_m[0], b, other.zone_m[0]) {
        [Duty::Yield, Duty::Go]
    } else {
        [Duty::Go, Duty::Yield]
    };
    [
        Zone { other: other.agent, own_m: own.zone_m, other_m: other.zone_m, duty: duties[0] },
        Zone { other: own.agent, own_m: other.zone_m, other_m: own.zone_m, duty: duties[1] },
    ]
}

fn yields(a: &Way<'_>, own_m: f64, b: &Way<'_>, other_m: f64) -> bool {
    let (mine, theirs) = (a.stops_before(own_m), b.stops_before(other_m));
    if mine != theirs {
        return mine;
    }
    let turned = a.turn_rad(own_m) - b.turn_rad(other_m);
    if turned.abs() > TURN_RAD {
        return turned > 0.0;
    }
    a.path.direction_at(own_m).perp_dot(b.path.direction_at(other_m)) > 0.0
}

fn on_crosswalk(walker: &AgentPath, [from_m, to_m]: [f64; 2], map: &Map) -> bool {
    let places = [from_m, 0.5 * (from_m + to_m), to_m].map(|along_m| walker.at(along_m).pose.position);
    map.crosswalks.iter().any(|crosswalk| places.iter().any(|place| polygon::holds(&crosswalk.polygon, *place)))
}

/// Where somebody is on its path.
#[derive(Debug, Clone, Copy)]
pub struct Placed {
    /// Distance of its centre along the path, m.
    pub along_m: f64,
    /// Speed along the path, m/s.
    pub speed_mps: f64,
    /// Half its length, m.
    pub half_length_m: f64,
    /// Where a red light holds it, m along the path; infinite without.
    pub held_before_m: f64,
}

impl Placed {
    fn window(&self, [from_m, to_m]: [f64; 2]) -> [f64; 2] {
        let speed_mps = self.speed_mps.max(0.1);
        let reach = |at_m: f64| ((at_m - self.along_m) / speed_mps).max(0.0);
        [reach(from_m - self.half_length_m), reach(to_m + self.half_length_m)]
    }

    /// Returns when it can be at a distance ahead, speeding up as far as it may.
    fn hurry_secs(&self, ahead_m: f64, accel_mps2: f64) -> f64 {
        let v = self.speed_mps.max(0.0);
        ((v * v + 2.0 * accel_mps2 * ahead_m.max(0.0)).sqrt() - v) / accel_mps2
    }
}

/// Returns the distance to the place at which a vehicle waits at a zone; nothing where it may go.
#[must_use]
pub fn wait_ahead(me: &Placed, zone: &Zone, other: Option<&Placed>, accel_mps2: f64) -> Option<f64> {
    let (other, gap_m) = (other?, zone.own_m[0] - me.along_m - me.half_length_m);
    let braking_m = |deceleration: f64| me.speed_mps * me.speed_mps / (2.0 * deceleration);
    let passed = other.along_m - other.half_length_m > zone.other_m[1];
    let held = other.held_before_m < zone.other_m[0] && other.along_m < other.held_before_m;
    if gap_m < 0.0 || passed || held {
        return None;
    }
    match zone.duty {
        Duty::Yield if gap_m >= braking_m(HARDEST_MPS2) => {
            let inside = other.along_m + other.half_length_m > zone.other_m[0];
            if other.speed_mps < WAITING_MPS && !inside {
                return None;
            }
            let [in_secs, out_secs] = other.window(zone.other_m);
            let mine_in = me.hurry_secs(gap_m, accel_mps2);
            let mine_out = me.hurry_secs(zone.own_m[1] - me.along_m + me.half_length_m, accel_mps2);
            (in_secs < mine_out + MARGIN_SECS && out_secs + 0.5 > mine_in).then_some(gap_m)
        }
        Duty::Crosswalk if gap_m >= braking_m(COURTEOUS_MPS2) => {
            (other.along_m > zone.other_m[0] - WAITING_M).then_some(gap_m)
        }
        _ => None,
    }
}

/// Tells whether somebody on foot lets a vehicle pass before stepping into a zone.
#[must_use]
pub fn lets_pass(me: &Placed, zone: &Zone, other: Option<&Placed>, gap_secs: f64, pace_mps: f64) -> bool {
    let (Duty::Step { marked }, Some(other)) = (zone.duty, other) else { return false };
    let ahead_m = zone.own_m[0] - me.along_m;
    let passed = other.along_m - other.half_length_m > zone.other_m[1];
    if !(0.0..=1.2).contains(&ahead_m) || passed || other.speed_mps < WAITING_MPS {
        return false;
    }
    let held = other.held_before_m < zone.other_m[0] && other.along_m < other.held_before_m;
    let clear_secs = if marked { 0.0 } else { (zone.own_m[1] - me.along_m) / pace_mps.max(0.3) };
    !held && other.window(zone.other_m)[0] < clear_secs + gap_secs
}
