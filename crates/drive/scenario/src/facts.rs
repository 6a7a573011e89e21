//! Facts about a drive that its prompt is written from: the road ahead, who is on it, how the ego moves.
//!
//! Taken from map and world at the first frame and from the ego's motion up to the last one; distances in metres ahead
//! of the rig. Nothing is read from pixels.

use ds_space::plane::Polyline;
use ds_space::{DVec2, PoseSe2, angle};
use ds_world::{AgentClass, LaneKind, LightState, Map, Scene, WorldState};
use serde::{Deserialize, Serialize};

/// How far ahead things are told of.
const AHEAD_M: f64 = 60.0;
/// Wider than this per metre ahead is out of the picture.
const SPREAD: f64 = 0.8;

/// The shape of the road ahead.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Geometry {
    /// No bend worth telling.
    Straight,
    /// A bend to the left.
    CurveLeft,
    /// A bend to the right.
    CurveRight,
    /// A junction.
    Intersection,
    /// A roundabout.
    Roundabout,
}

/// What the ego does over the drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EgoMotion {
    /// It stands.
    Standing,
    /// It gets slower.
    Braking,
    /// It gets faster.
    Accelerating,
    /// It keeps its speed.
    Cruising,
}

/// Road users of one kind in the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Ahead {
    /// Those that move.
    pub moving: u32,
    /// Those that stand.
    pub standing: u32,
}

impl Ahead {
    /// Returns how many there are.
    #[must_use]
    pub fn all(&self) -> u32 {
        self.moving + self.standing
    }
}

/// Everything that a prompt may tell.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Facts {
    /// What the drive looks like, in words.
    pub appearance: String,
    /// The shape of the road.
    pub road: Geometry,
    /// Lanes in the ego's direction.
    pub lanes: u32,
    /// The nearest traffic light for the ego within 80 m: `red`, `yellow`, `green` or `unknown`.
    pub traffic_light: Option<String>,
    /// A crosswalk lies ahead.
    pub crosswalk: bool,
    /// Cars, trucks and buses.
    pub vehicles: Ahead,
    /// Vehicles that come towards the ego.
    pub oncoming: u32,
    /// Distance to a vehicle in the ego's way, in metres.
    pub leader_m: Option<f64>,
    /// That vehicle is clearly slower than the ego.
    pub leader_slower: bool,
    /// People on foot.
    pub pedestrians: Ahead,
    /// People on bicycles.
    pub cyclists: Ahead,
    /// Cones and barriers.
    pub obstacles: u32,
    /// What the ego does.
    pub ego: EgoMotion,
    /// The ego's speed at the first frame, in metres per second.
    pub ego_speed_mps: f64,
    /// Change of heading over the drive, left positive, in radians.
    pub ego_turn_rad: f64,
}

impl Facts {
    /// Gathers the facts of a drive from its first and last state; `appearance` says what it looks like.
    #[must_use]
    pub fn of(scene: &Scene, first: &WorldState, last: &WorldState, appearance: String) -> Self {
        let mut facts = Self::at(scene, first, appearance);
        let (before, after) = (first.ego.speed_mps(), last.ego.speed_mps());
        facts.ego = match (before.max(after), after - before) {
            (fastest, _) if fastest < 0.5 => EgoMotion::Standing,
            (_, change) if change < -1.0 => EgoMotion::Braking,
            (_, change) if change > 1.0 => EgoMotion::Accelerating,
            _ => EgoMotion::Cruising,
        };
        facts.ego_turn_rad = angle::turn(first.ego.pose.heading_rad, last.ego.pose.heading_rad);
        facts
    }

    /// Gathers what one state tells; the ego then cruises or stands.
    fn at(scene: &Scene, world: &WorldState, appearance: String) -> Self {
        let ego = world.ego.pose;
        let speed = world.ego.speed_mps();
        let mut facts = Self {
            appearance,
            road: geometry(scene, &ego),
            lanes: lanes(&scene.map, &ego),
            traffic_light: light(&scene.map, world),
            crosswalk: scene
                .map
                .crosswalks
                .iter()
                .any(|crosswalk| crosswalk.polygon.iter().any(|corner| is_ahead(ego.to_local(*corner), AHEAD_M))),
            vehicles: Ahead::default(),
            oncoming: 0,
            leader_m: None,
            leader_slower: false,
            pedestrians: Ahead::default(),
            cyclists: Ahead::default(),
            obstacles: 0,
            ego: if speed < 0.5 { EgoMotion::Standing } else { EgoMotion::Cruising },
            ego_speed_mps: speed,
            ego_turn_rad: 0.0,
        };
        facts.see_agents(scene, world);
        facts
    }

    fn see_agents(&mut self, scene: &Scene, world: &WorldState) {
        let ego = world.ego.pose;
        let way = Polyline::new(&scene.route);
        for agent in &world.agents {
            let local = ego.to_local(agent.pose.position);
            if !is_ahead(local, AHEAD_M) {
                continue;
            }
            let moves = agent.velocity_mps.length() > 0.3;
            let count = |ahead: &mut Ahead| *(if moves { &mut ahead.moving } else { &mut ahead.standing }) += 1;
            match agent.class {
                AgentClass::Vehicle => count(&mut self.vehicles),
                AgentClass::Pedestrian => count(&mut self.pedestrians),
                AgentClass::Cyclist => count(&mut self.cyclists),
                AgentClass::Cone | AgentClass::Barrier => self.obstacles += 1,
            }
            if agent.class != AgentClass::Vehicle {
                continue;
            }
            let turned = angle::turn(ego.heading_rad, agent.pose.heading_rad).abs();
            if moves && turned > 2.2 {
                self.oncoming += 1;
            }
            let aside = way.as_ref().map_or(local.y, |way| way.project(agent.pose.position).lateral_m);
            if turned < 0.8 && aside.abs() < 1.6 && self.leader_m.is_none_or(|nearest| local.x < nearest) {
                self.leader_m = Some(local.x);
                self.leader_slower = agent.velocity_mps.dot(ego.forward()) < world.ego.speed_mps() - 1.0;
            }
        }
    }
}

fn is_ahead(local: DVec2, reach_m: f64) -> bool {
    local.x > 2.0 && local.x < reach_m && local.y.abs() < 4.0 + SPREAD * local.x
}

fn geometry(scene: &Scene, ego: &PoseSe2) -> Geometry {
    let near = |point: &DVec2| is_ahead(ego.to_local(*point), 50.0) && ego.to_local(*point).y.abs() < 15.0;
    let ring = |name: &str| name.starts_with("ring");
    let lanes = || scene.map.lanes.iter().filter(|lane| lane.centre_line.iter().any(near));
    if lanes().any(|lane| ring(&lane.name)) {
        return Geometry::Roundabout;
    }
    let junction = scene.map.junctions.iter().any(|area| area.iter().any(near));
    if junction || lanes().any(|lane| lane.kind == LaneKind::Connector) {
        return Geometry::Intersection;
    }
    let Some(way) = Polyline::new(&scene.route) else { return Geometry::Straight };
    let here = way.project(ego.position).along_m;
    let direction = |along_m: f64| way.direction_at(along_m).to_angle();
    let bends: Vec<f64> =
        (1..=4).map(|i| angle::turn(direction(here), direction(here + 10.0 * f64::from(i)))).collect();
    let most = bends.iter().copied().max_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(0.0);
    match most {
        bend if bend > 0.15 => Geometry::CurveLeft,
        bend if bend < -0.15 => Geometry::CurveRight,
        _ => Geometry::Straight,
    }
}

/// Counts the lanes beside the one the ego is on, in its direction.
fn lanes(map: &Map, ego: &PoseSe2) -> u32 {
    let place = |points: &[DVec2]| {
        let line = Polyline::new(points)?;
        let at = line.project(ego.position);
        let along = line.direction_at(at.along_m);
        (at.distance_m < 2.5 && along.dot(ego.forward()) > 0.5).then_some(at.distance_m)
    };
    let mine =
        map.lanes.iter().filter_map(|lane| Some((place(&lane.centre_line)?, lane))).min_by(|a, b| a.0.total_cmp(&b.0));
    let Some((_, mine)) = mine else { return 1 };
    let mut count = 1;
    for side in [|lane: &ds_world::Lane| lane.left, |lane: &ds_world::Lane| lane.right] {
        let mut next = side(mine);
        while let Some(lane) = next.and_then(|id| map.lane(id)).filter(|_| count < 8) {
            count += 1;
            next = side(lane);
        }
    }
    count
}

/// Returns the nearest light ahead that faces the ego.
fn light(map: &Map, world: &WorldState) -> Option<String> {
    let ego = world.ego.pose;
    let seen = map.traffic_lights.iter().enumerate().filter_map(|(i, light)| {
        let local = ego.to_local(light.position.truncate());
        let faces = angle::turn(ego.heading_rad + std::f64::consts::PI, light.facing_rad).abs() < 0.8;
        (is_ahead(local, 80.0) && faces).then_some((local.x, i))
    });
    let (_, i) = seen.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let name = match world.lights.get(i).copied().unwrap_or(LightState::Unknown) {
        LightState::Red => "red",
        LightState::Yellow => "yellow",
        LightState::Green => "green",
        LightState::Unknown => "unknown",
    };
    Some(name.to_owned())
}
