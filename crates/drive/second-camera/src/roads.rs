//! Roads of this world's own: boulevards with a median, narrow country roads without a centre line, ways round a square.
//!
//! Geometry and traffic are drawn from the seed alone; everything moves along lanes at steady speeds and keeps apart.
//! Nothing is shared with the generator that training scenarios come from. Metres, world frame, 151 ticks at 10 Hz.

use std::f64::consts::TAU;

use ds_raster::shape;
use ds_space::plane::Polyline;
use ds_space::{CameraId, CameraModel, DVec2, DVec3, DigestWriter, Draws, Intrinsics, PoseSe2, SimTime, angle};
use ds_world::{
    AgentClass, Crosswalk, EgoState, Lane, LaneKind, LightState, LineColour, LineKind, LineMarking, Map, Origin,
    RoadEdge, Scene, Size, StopLine, Track, TrackPoint, TrafficLight, VehicleParameters,
};

use crate::town;

const TICKS: u32 = 151;
const DT_SECS: f64 = 0.1;
/// Where along its lane the ego starts.
const START_M: f64 = 70.0;

/// A scene under construction, along lines that all begin near the origin.
struct Site {
    map: Map,
    tracks: Vec<Track>,
    draws: Draws,
    next: u64,
}

/// What a lane is like.
#[derive(Clone, Copy)]
struct Strip {
    width_m: f64,
    limit_mps: f64,
}

impl Site {
    fn range(&mut self, low: f64, high: f64) -> f64 {
        self.next += 1;
        self.draws.range(self.next, low, high)
    }

    fn chance(&mut self, share: f64) -> bool {
        self.range(0.0, 1.0) < share
    }

    fn lane(&mut self, name: &str, centre: Vec<DVec2>, strip: Strip) -> Polyline {
        let half = 0.5 * strip.width_m;
        let mut polygon = shape::shifted(&centre, half);
        polygon.extend(shape::shifted(&centre, -half).into_iter().rev());
        self.map.drivable.push(polygon.clone());
        self.map.lanes.push(Lane {
            name: name.to_owned(),
            kind: LaneKind::Road,
            centre_line: centre.clone(),
            polygon,
            speed_limit_mps: Some(strip.limit_mps),
            successors: Vec::new(),
            predecessors: Vec::new(),
            left: None,
            right: None,
        });
        Polyline::new(&centre).expect("a drawn lane has a length")
    }

    fn line(&mut self, kind: LineKind, colour: LineColour, points: Vec<DVec2>) {
        self.map.line_markings.push(LineMarking { kind, colour, points });
    }

    fn edge(&mut self, points: Vec<DVec2>) {
        self.map.road_edges.push(RoadEdge { points });
    }

    /// Adds someone who moves along a line at a steady speed.
    fn along(&mut self, class: AgentClass, size: Size, line: &Polyline, from_m: f64, speed_mps: f64) {
        let points = (0..TICKS)
            .map(|tick| {
                let at = from_m + speed_mps * f64::from(tick) * DT_SECS;
                (0.5..line.length_m() - 0.5).contains(&at).then(|| {
                    let ahead = smooth_direction(line, at);
                    let pose = PoseSe2 { position: line.at(at), heading_rad: ahead.to_angle() };
                    TrackPoint { pose, z_m: 0.0, velocity_mps: ahead * speed_mps }
                })
            })
            .collect::<Vec<_>>();
        if points.iter().any(Option::is_some) {
            let name = format!("{}", self.tracks.len());
            self.tracks.push(Track { name, class, size, points });
        }
    }

    fn car(&mut self) -> Size {
        if self.chance(0.15) {
            let length_m = self.range(7.5, 11.0);
            Size { length_m, width_m: 2.45, height_m: self.range(2.8, 3.5) }
        } else {
            Size { length_m: self.range(3.7, 5.0), width_m: self.range(1.68, 1.95), height_m: self.range(1.4, 1.95) }
        }
    }

    /// Fills a lane with vehicles of one speed, leaving the span `free` of stations at the start empty.
    fn traffic(&mut self, line: &Polyline, speed_mps: f64, gaps_m: (f64, f64), free: (f64, f64)) {
        let mut at = self.range(0.0, gaps_m.1) - 60.0;
        while at < line.length_m() {
            let size = self.car();
            if at + size.length_m < free.0 || at - size.length_m > free.1 {
                self.along(AgentClass::Vehicle, size, line, at, speed_mps);
            }
            at += size.length_m + self.range(gaps_m.0, gaps_m.1);
        }
    }

    /// Lets people walk along a line beside the road, either way.
    fn walkers(&mut self, line: &[DVec2], count: u32) {
        for _ in 0..count {
            let mut way = line.to_vec();
            if self.chance(0.5) {
                way.reverse();
            }
            let Some(way) = Polyline::new(&way) else { continue };
            let size = Size { length_m: 0.6, width_m: 0.6, height_m: self.range(1.5, 1.9) };
            let (from, speed) = (self.range(20.0, way.length_m() - 40.0), self.range(0.8, 1.7));
            self.along(AgentClass::Pedestrian, size, &way, from, speed);
        }
    }

    /// Lays a crosswalk with a stop line and a light over the lanes between two offsets from a line.
    fn crossing(&mut self, line: &Polyline, at_m: f64, left_m: f64, right_m: f64) {
        let ahead = smooth_direction(line, at_m);
        let place = |along: f64, left: f64| line.at(at_m) + ahead * along + ahead.perp() * left;
        let polygon = vec![place(0.0, left_m), place(0.0, right_m), place(3.2, right_m), place(3.2, left_m)];
        self.map.crosswalks.push(Crosswalk { polygon });
        let light = u32::try_from(self.map.traffic_lights.len()).unwrap_or(0);
        let stop = [place(-1.5, left_m), place(-1.5, right_m)];
        self.map.stop_lines.push(StopLine { points: stop, light: Some(light) });
        self.map.traffic_lights.push(TrafficLight {
            position: place(5.0, right_m - 1.2).extend(3.4),
            facing_rad: angle::wrap(ahead.to_angle() + std::f64::consts::PI),
            lanes: Vec::new(),
            states: vec![LightState::Green],
        });
        let across = [place(1.6, left_m + 1.5), place(1.6, left_m + 6.0)];
        self.walkers_standing(&across);
    }

    /// People who wait at the side of a crossing.
    fn walkers_standing(&mut self, side: &[DVec2; 2]) {
        for k in 0..2u8 {
            if self.chance(0.6) {
                let position = side[0].lerp(side[1], 0.3 * f64::from(k));
                let pose = PoseSe2 { position, heading_rad: (side[0] - side[1]).to_angle() };
                let size = Size { length_m: 0.6, width_m: 0.6, height_m: self.range(1.5, 1.9) };
                let point = TrackPoint { pose, z_m: 0.0, velocity_mps: DVec2::ZERO };
                let name = format!("{}", self.tracks.len());
                let points = vec![Some(point); TICKS as usize];
                self.tracks.push(Track { name, class: AgentClass::Pedestrian, size, points });
            }
        }
    }
}

/// Returns the direction over a few metres around a station.
fn smooth_direction(line: &Polyline, at_m: f64) -> DVec2 {
    (line.at(at_m + 1.5) - line.at(at_m - 1.5)).normalize_or(line.direction_at(at_m))
}

/// Returns a wavy line from behind the start on, with a point every two metres.
fn wave(site: &mut Site, length_m: f64, slope: f64) -> Vec<DVec2> {
    let (long, short) = (site.range(90.0, 160.0), site.range(45.0, 80.0));
    let (a, b) = (site.range(0.4, 1.0) * slope, site.range(0.0, 0.6) * slope);
    let (p, q) = (site.range(0.0, TAU), site.range(0.0, TAU));
    let heading = |s: f64| a * (TAU * s / long + p).sin() + b * (TAU * s / short + q).sin();
    let mut at = DVec2::ZERO;
    let mut points = vec![at];
    let mut s = 0.0;
    while s < length_m {
        at += DVec2::from_angle(heading(s + 1.0)) * 2.0;
        s += 2.0;
        points.push(at);
    }
    points
}

fn reversed(mut points: Vec<DVec2>) -> Vec<DVec2> {
    points.reverse();
    points
}

/// Two carriageways of three lanes on either side of a median; the ego in one of them.
fn boulevard(site: &mut Site) -> (Polyline, f64) {
    let middle = wave(site, 380.0, 0.22);
    let (width, median) = (site.range(2.9, 3.2), site.range(2.0, 5.0));
    let speed = site.range(8.5, 14.0);
    let strip = Strip { width_m: width, limit_mps: speed * 1.1 };
    let lanes = 2 + u8::from(site.chance(0.6));
    let offset = |k: f64| 0.5 * median + k * width;
    let (mut ahead, mut back) = (Vec::new(), Vec::new());
    for k in 0..lanes {
        let centre = offset(f64::from(k) + 0.5);
        ahead.push(site.lane(&format!("a{k}"), shape::shifted(&middle, -centre), strip));
        back.push(site.lane(&format!("b{k}"), reversed(shape::shifted(&middle, centre)), strip));
    }
    for side in [1.0, -1.0] {
        let at = |m: f64| shape::shifted(&middle, side * m);
        for k in 1..lanes {
            site.line(LineKind::Dashed, LineColour::White, at(offset(f64::from(k))));
        }
        site.line(LineKind::Solid, LineColour::Yellow, at(offset(0.0) + 0.1));
        site.line(LineKind::Solid, LineColour::White, at(offset(f64::from(lanes)) - 0.1));
        site.edge(at(offset(0.0)));
        site.edge(at(offset(f64::from(lanes))));
        let count = 3 + u32::from(site.chance(0.5)) * 3;
        site.walkers(&at(offset(f64::from(lanes)) + 2.5), count);
    }
    let mine = usize::from(site.chance(0.5));
    let reference = Polyline::new(&middle).expect("a drawn line has a length");
    let at = START_M + site.range(25.0, 90.0);
    site.crossing(&reference, at, -0.5 * median, -offset(f64::from(lanes)));
    for (k, lane) in ahead.iter().enumerate() {
        let pace = if k == mine { speed } else { speed * site.range(0.75, 1.15) };
        // In the ego's own lane everyone drives as fast as the ego.
        let free = if k == mine { (START_M - 14.0, START_M + 16.0) } else { (0.0, 0.0) };
        site.traffic(lane, pace, (14.0, 70.0), free);
    }
    for lane in &back {
        let pace = speed * site.range(0.8, 1.1);
        site.traffic(lane, pace, (16.0, 80.0), (0.0, 0.0));
    }
    (ahead.swap_remove(mine), speed)
}

/// A narrow two-way road with edge lines alone.
fn country(site: &mut Site) -> (Polyline, f64) {
    let middle = wave(site, 320.0, 0.55);
    let width = site.range(2.5, 2.85);
    let speed = site.range(6.0, 10.0);
    let strip = Strip { width_m: width, limit_mps: speed * 1.2 };
    let ahead = site.lane("a", shape::shifted(&middle, -0.5 * width), strip);
    let back = site.lane("b", reversed(shape::shifted(&middle, 0.5 * width)), strip);
    for side in [1.0, -1.0] {
        site.line(LineKind::Solid, LineColour::White, shape::shifted(&middle, side * (width - 0.15)));
        site.edge(shape::shifted(&middle, side * width));
    }
    site.traffic(&ahead, speed, (35.0, 140.0), (START_M - 20.0, START_M + 22.0));
    let pace = speed * site.range(0.8, 1.1);
    site.traffic(&back, pace, (30.0, 120.0), (0.0, 0.0));
    let count = u32::from(site.chance(0.6)) * 2;
    site.walkers(&shape::shifted(&middle, width + 1.4), count);
    (ahead, speed)
}

/// A one-way road of two lanes around a square with round corners, with parked cars outside.
fn square(site: &mut Site) -> (Polyline, f64) {
    let (side, radius) = (site.range(50.0, 80.0), site.range(14.0, 22.0));
    let speed = site.range(5.5, 8.0);
    let width = site.range(3.0, 3.4);
    let mut middle = Vec::new();
    let (mut at, mut heading) = (DVec2::ZERO, 0.0f64);
    for _ in 0..4 {
        let straight = (side / 2.0).round().max(1.0) as u32;
        for _ in 0..straight {
            middle.push(at);
            at += DVec2::from_angle(heading) * 2.0;
        }
        let steps = (radius * TAU / 4.0 / 1.5).ceil().max(4.0) as u32;
        for _ in 0..steps {
            let turn = TAU / 4.0 / f64::from(steps);
            middle.push(at);
            at += DVec2::from_angle(heading + 0.5 * turn) * (radius * turn);
            heading += turn;
        }
    }
    middle.push(middle[0] + (at - middle[0]) * 0.5);
    let strip = Strip { width_m: width, limit_mps: speed * 1.2 };
    let outer = site.lane("outer", shape::shifted(&middle, -0.5 * width), strip);
    let inner = site.lane("inner", shape::shifted(&middle, 0.5 * width), strip);
    site.line(LineKind::Dashed, LineColour::White, middle.clone());
    for (m, colour) in [(width - 0.1, LineColour::Yellow), (0.1 - width, LineColour::White)] {
        site.line(LineKind::Solid, colour, shape::shifted(&middle, m));
    }
    site.edge(shape::shifted(&middle, width));
    site.edge(shape::shifted(&middle, -width - 2.2));
    let reference = Polyline::new(&middle).expect("a drawn line has a length");
    site.crossing(&reference, side - 6.0, width, -width);
    let parked = Polyline::new(&shape::shifted(&middle, -width - 1.1)).expect("a drawn line has a length");
    let mut at = site.range(2.0, 10.0);
    while at < parked.length_m() {
        let size = Size { length_m: site.range(3.7, 4.8), width_m: 1.75, height_m: site.range(1.4, 1.9) };
        if site.chance(0.6) {
            site.along(AgentClass::Vehicle, size, &parked, at, 0.0);
        }
        at += size.length_m + site.range(0.8, 6.0);
    }
    site.traffic(&outer, speed, (25.0, 90.0), (START_M - 16.0, START_M + 18.0));
    let pace = speed * site.range(0.8, 1.1);
    site.traffic(&inner, pace, (20.0, 80.0), (0.0, 0.0));
    let walk = shape::shifted(&middle, width + 2.2);
    site.walkers(&walk, 5);
    (outer, speed)
}

/// Returns the scene of a seed; boulevards, country roads and squares take turns.
///
/// # Panics
/// Never: every drawn line has a length.
#[must_use]
pub fn scene(seed: u64) -> Scene {
    let digest = DigestWriter::new().text("abroad roads 2").u64(seed).finish();
    let draws = Draws::new(&digest, "roads", &[]);
    let mut site = Site { map: Map::default(), tracks: Vec::new(), draws, next: 0 };
    let (kind, (lane, speed)) = match seed % 3 {
        0 => ("boulevard", boulevard(&mut site)),
        1 => ("country", country(&mut site)),
        _ => ("square", square(&mut site)),
    };
    let station = |tick: u32| START_M + speed * f64::from(tick) * DT_SECS;
    let heading = |at: f64| smooth_direction(&lane, at).to_angle();
    let ego_log = (0..TICKS).map(|tick| {
        let at = station(tick);
        let turn = angle::turn(heading(at - 0.5 * speed * DT_SECS), heading(at + 0.5 * speed * DT_SECS));
        EgoState {
            pose: PoseSe2 { position: lane.at(at), heading_rad: heading(at) },
            velocity_mps: DVec2::new(speed, 0.0),
            yaw_rate_radps: turn / DT_SECS,
            ..EgoState::default()
        }
    });
    let id = CameraId::new("front").expect("a plain word is an id");
    let lens = Intrinsics::centred(160, 96, 70f64.to_radians());
    let mut scene = Scene {
        adversary: None,
        name: format!("abroad-{kind}-{seed}"),
        family: format!("abroad-{kind}"),
        digest,
        dt: SimTime::from_secs(DT_SECS),
        ego_log: ego_log.collect(),
        route: lane.points().to_vec(),
        map: site.map,
        vehicle: VehicleParameters::ZOE,
        tracks: site.tracks,
        cameras: vec![CameraModel::mounted(id, lens, DVec3::new(1.5, 0.0, 1.6), 0.0, 0.05)],
        prompt: format!("front camera view of a {kind} road"),
        origin: Origin {
            source: format!("dreamstream roads abroad 2, seed {seed}"),
            licence: "Apache-2.0".to_owned(),
            attribution: "The DreamStream authors".to_owned(),
        },
    };
    scene.map.structures = town::place(&scene, 0);
    scene
}

#[cfg(test)]
mod tests {
    use super::*;
    use ds_space::Tick;

    fn in_polygon(polygon: &[DVec2], p: DVec2) -> bool {
        shape::triangulate(polygon).iter().any(|[a, b, c]| {
            let sides = [(*b - *a).perp_dot(p - *a), (*c - *b).perp_dot(p - *b), (*a - *c).perp_dot(p - *c)];
            sides.iter().all(|s| *s >= -1e-9)
        })
    }

    #[test]
    fn the_ego_stays_on_the_road_and_nobody_comes_near_it() {
        for seed in 0..24 {
            let scene = scene(seed);
            assert_eq!((scene.last_tick().0, &scene), (150, &super::scene(seed)), "seed {seed}");
            for tick in (0..=150).step_by(10) {
                let world = scene.logged_world(Tick(tick));
                let place = world.ego.pose.position;
                let on_road = scene.map.drivable.iter().any(|polygon| in_polygon(polygon, place));
                assert!(on_road, "seed {seed}, tick {tick}: the ego is off the road at {place}");
                for agent in &world.agents {
                    let apart = agent.pose.position.distance(world.ego.centre(&scene.vehicle).position);
                    assert!(apart > 1.9, "seed {seed}, tick {tick}: {:?} is {apart:.2} m away", agent.class);
                }
            }
        }
    }

    #[test]
    fn seeds_draw_roads_of_their_own() {
        let lengths: std::collections::BTreeSet<u64> =
            (0..60).map(|seed| scene(seed).map.lanes[0].centre_line.last().expect("points").y.to_bits()).collect();
        assert_eq!(lengths.len(), 60);
    }
}
