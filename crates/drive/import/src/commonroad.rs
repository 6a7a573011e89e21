//! Scenes of CommonRoad files (XML, formats 2018b and 2020a): lanelets, obstacles, planning problems.
//!
//! Metres, radians and metres per second in the file's own plane (moved only beyond 100 km). A tick is 0.1 s; where a
//! time step is not, places between steps are interpolated. Positions are centres of shapes. A file holds recorded road
//! users and a task, but no drive that solves it: the ego is a recorded vehicle with its drive, or a planning problem,
//! whose log is drawn.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Read;
use std::path::Path;

use ds_scenario::{MAX_TICKS, Warning, warnings};
use ds_space::{DVec2, Digest, SimTime, Tick};
use ds_world::scene::EGO_MARK;
use ds_world::{AgentClass, EgoState, Origin, Scene, Size, VehicleParameters};

use crate::error::ImportError;
use crate::scenarionet::ego::{RECENTRE_BEYOND_M, Recording, sized};
use crate::scenarionet::route::route;
use crate::scene::{checked, safe_name, usual_camera};
use crate::view::FieldFault;
use element::{Element, Node};
use obstacles::Obstacle;
use problem::Problem;

mod element;
mod lanelets;
mod obstacles;
mod problem;
mod signals;

const ROOT: &str = "commonRoad";
const VERSIONS: [&str; 2] = ["2018b", "2020a"];
/// The shortest recording of a vehicle that [`recorded`] names, in seconds.
const LEAST_SECS: f64 = 3.0;
/// The body of a planning problem's ego, which the format leaves to the planner: its vehicle 2, a BMW 320i.
const BODY: Size = Size { length_m: 4.508, width_m: 1.61, height_m: 1.42 };

/// Seconds between ticks of a scene, whatever those between the time steps of its file.
const TICK_SECS: f64 = 0.1;

/// How a file is laid on the ticks of a scene: what to subtract from positions, which time steps to take.
#[derive(Debug, Clone, Copy)]
struct Window {
    origin: DVec2,
    first: u32,
    /// Time steps in a tick.
    stride: f64,
    count: usize,
}

impl Window {
    /// Returns the time step of each tick, which may lie between two.
    fn steps(self) -> impl Iterator<Item = f64> {
        (0..self.count).map(move |tick| f64::from(self.first) + tick as f64 * self.stride)
    }
}

/// Says whether a file is named and begins as one of CommonRoad.
pub(super) fn is_log(path: &Path) -> bool {
    let named = path.extension().is_some_and(|extension| extension == "xml");
    let begins = || {
        let mut start = Vec::new();
        std::fs::File::open(path).and_then(|file| file.take(4096).read_to_end(&mut start)).ok()?;
        Some(String::from_utf8_lossy(&start).contains("<commonRoad"))
    };
    named && begins().unwrap_or(false)
}

/// Reads the scene of a file; `path` is only for its name and for messages.
///
/// `ego` is the id of a planning problem or of a recorded vehicle; by default it is the first planning problem, in a
/// file without one the vehicle that is recorded longest.
///
/// # Errors
/// [`ImportError`] names the file, the element and what is wrong with it.
pub fn scene(bytes: &[u8], path: &Path, ego: Option<&str>) -> Result<(Scene, Vec<Warning>), ImportError> {
    let mut notes = Vec::new();
    let scene = document(bytes)
        .and_then(|root| convert(&Node::root(&root), path, ego, &mut notes))
        .map_err(|fault| ImportError::field(path, fault))?;
    let scene = checked(&scene, path)?;
    notes.extend(met(&scene));
    notes.extend(warnings(&scene));
    Ok((scene, notes))
}

/// Says whom the ego's log touches: a drawn one is blind to others, and boxes of recorded ones may overlap.
fn met(scene: &Scene) -> Option<Warning> {
    let mut met: BTreeMap<&str, u32> = BTreeMap::new();
    for tick in Tick(0).to(scene.last_tick()) {
        let ego = scene.vehicle.size.footprint(&scene.logged_ego(tick).centre(&scene.vehicle));
        for track in &scene.tracks {
            if track.at(tick).is_some_and(|point| track.size.footprint(&point.pose).touches(&ego)) {
                met.entry(&track.name).or_insert(tick.0);
            }
        }
    }
    let (name, tick) = met.iter().min_by_key(|(_, tick)| **tick)?;
    let message = format!("touches {} of the tracks, first {name:?} at tick {tick}", met.len());
    Some(Warning { at: "ego_log".to_owned(), message })
}

/// Returns the ids of the vehicles that are recorded for 3 s or more without a gap, in file order.
///
/// # Errors
/// [`ImportError`] as for [`scene`], and if there is none.
pub fn recorded(bytes: &[u8], path: &Path) -> Result<Vec<String>, ImportError> {
    let names = || {
        let root = document(bytes)?;
        let root = Node::root(&root);
        let dt_secs = interval(&root)?;
        let long = |obstacle: &Obstacle| {
            let secs = (obstacle.states.len() - 1) as f64 * dt_secs;
            span(obstacle) + 1 == obstacle.states.len() && secs + 1e-9 >= LEAST_SECS && drives(obstacle)
        };
        let obstacles = obstacles::obstacles(&root, dt_secs, &mut Vec::new())?;
        let names: Vec<String> = obstacles.into_iter().filter(long).map(|obstacle| obstacle.name).collect();
        let none = || root.fault(format!("has no vehicle that is recorded for {LEAST_SECS} s or more"));
        if names.is_empty() { Err(none()) } else { Ok(names) }
    };
    names().map_err(|fault| ImportError::field(path, fault))
}

/// Reads the document and checks that it is CommonRoad's, of a version that is known.
fn document(bytes: &[u8]) -> Result<Element, FieldFault> {
    let document = element::read(bytes)?;
    let root = Node::root(&document);
    if root.name() != ROOT {
        return Err(root.fault(format!("is no {ROOT:?}")));
    }
    let version = root.need_attribute("commonRoadVersion")?;
    if VERSIONS.contains(&version) {
        return Ok(document);
    }
    Err(root.fault(format!("has commonRoadVersion {version:?}; {} are read", VERSIONS.join(" and "))))
}

fn interval(root: &Node<'_>) -> Result<f64, FieldFault> {
    let text = root.need_attribute("timeStepSize")?;
    let secs = text.parse().ok().filter(|secs| (0.001..=1.0).contains(secs));
    secs.ok_or_else(|| root.fault(format!("has timeStepSize {text:?}, no number of seconds from 0.001 to 1")))
}

/// Returns how many steps lie between the first and the last state.
fn span(obstacle: &Obstacle) -> usize {
    let ends = obstacle.states.first_key_value().zip(obstacle.states.last_key_value());
    ends.map_or(0, |((first, _), (last, _))| (last - first) as usize)
}

fn drives(obstacle: &Obstacle) -> bool {
    obstacle.class == AgentClass::Vehicle && !obstacle.stands && obstacle.states.len() > 1
}

/// Who is driven.
enum Ego<'a> {
    Problem(Problem),
    Recorded(&'a Obstacle),
}

impl<'a> Ego<'a> {
    fn chosen(root: &Node<'_>, obstacles: &'a [Obstacle], wanted: Option<&str>) -> Result<Self, FieldFault> {
        let problems: Vec<Node<'_>> = root.all("planningProblem").collect();
        let problem = match wanted {
            Some(id) => problems.iter().find(|problem| problem.attribute("id") == Some(id)),
            None => problems.first(),
        };
        if let Some(problem) = problem {
            return Ok(Self::Problem(Problem::of(problem)?));
        }
        let candidates = || obstacles.iter().filter(|obstacle| drives(obstacle));
        let longest = || candidates().rev().max_by_key(|obstacle| span(obstacle));
        let recorded = match wanted {
            Some(id) => candidates().find(|obstacle| obstacle.name == id),
            None => longest(),
        };
        let none = || match wanted {
            Some(id) => format!("has no planning problem and no recorded vehicle {id:?} to be the ego"),
            None => "has no planning problem and no recorded vehicle to be the ego".to_owned(),
        };
        recorded.map(Self::Recorded).ok_or_else(|| root.fault(none()))
    }

    /// Returns the first step, how many steps follow, and where the drive begins.
    fn span(&self) -> (u32, usize, DVec2) {
        match self {
            Self::Problem(problem) => {
                (problem.steps.0, (problem.steps.1 - problem.steps.0) as usize, problem.start.position)
            }
            Self::Recorded(obstacle) => {
                let first = obstacle.states.first_key_value();
                let (step, at) = first.map_or((0, DVec2::ZERO), |(step, point)| (*step, point.pose.position));
                (step, span(obstacle), at)
            }
        }
    }
}

fn convert(root: &Node<'_>, path: &Path, wanted: Option<&str>, notes: &mut Vec<Warning>) -> Result<Scene, FieldFault> {
    let dt_secs = interval(root)?;
    let obstacles = obstacles::obstacles(root, dt_secs, notes)?;
    let ego = Ego::chosen(root, &obstacles, wanted)?;
    let (first, steps, start) = ego.span();
    let stride = TICK_SECS / dt_secs;
    let ticks = (steps as f64 / stride + 1e-6).floor() as usize;
    if ticks == 0 || ticks >= MAX_TICKS {
        let problem = format!("has a drive of {ticks} ticks of {TICK_SECS} s, 1 to {} are read", MAX_TICKS - 1);
        return Err(root.fault(problem));
    }
    if (stride - 1.0).abs() > 1e-9 {
        let message = format!("is {dt_secs} s; ticks are {TICK_SECS} s apart, places between steps interpolated");
        note(notes, "timeStepSize", message);
    }
    let far = start.abs().max_element() > RECENTRE_BEYOND_M;
    let origin = if far { start.round() } else { DVec2::ZERO };
    if far {
        note(notes, ROOT, format!("all positions are moved by -{origin}"));
    }
    let window = Window { origin, first, stride, count: ticks + 1 };
    let mut map = lanelets::map(root, origin, notes)?;
    signals::add(&mut map, root, &window, notes)?;
    let mut name = root.attribute("benchmarkID").filter(|id| !id.is_empty()).map_or_else(
        || path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default(),
        str::to_owned,
    );
    if let Some(id) = wanted {
        name = format!("{}{EGO_MARK}{id}", name.chars().take(60).collect::<String>());
    }
    let (vehicle, ego_log, drive) = log(&ego, &map, &window, notes);
    let taken = if let Ego::Recorded(obstacle) = &ego { Some(obstacle.name.as_str()) } else { None };
    Ok(Scene {
        adversary: None,
        name: safe_name(&name),
        family: String::new(),
        digest: Digest::default(),
        dt: SimTime::from_secs(TICK_SECS),
        route: route(&ego_log, &map),
        map,
        vehicle,
        ego_log,
        tracks: obstacles::tracks(&obstacles, taken, &window)?,
        cameras: vec![usual_camera()],
        prompt: prompt(root),
        origin: source(root, &drive),
    })
}

/// Returns the ego's vehicle, its log, and in words whose it is.
fn log(
    ego: &Ego<'_>,
    map: &ds_world::Map,
    window: &Window,
    notes: &mut Vec<Warning>,
) -> (VehicleParameters, Vec<EgoState>, String) {
    let (vehicle, poses, gaps, drive) = match ego {
        Ego::Problem(problem) => {
            let poses = problem.drawn(map, window.origin, window.count, TICK_SECS);
            let drive = format!("the drive of planning problem {} is drawn, not recorded", problem.name);
            let message =
                format!("{drive}: `log-replay` and scores that compare with the log tell nothing of a driver");
            note(notes, "planningProblem", message);
            let gaps = vec![false; poses.len()];
            (sized(VehicleParameters::FUSION, BODY), poses, gaps, drive)
        }
        Ego::Recorded(obstacle) => {
            let mut poses = Vec::with_capacity(window.count);
            let mut gaps = Vec::with_capacity(window.count);
            for step in window.steps() {
                let seen = obstacle.at(step).map(|point| {
                    let mut pose = point.pose;
                    pose.position -= window.origin;
                    pose
                });
                gaps.push(seen.is_none());
                let held = poses.last().copied();
                poses.extend(seen.or(held));
            }
            let unseen = gaps.iter().filter(|gap| **gap).count();
            if unseen > 0 {
                let message = format!("vehicle {} is not seen at {unseen} ticks, filled between", obstacle.name);
                note(notes, "dynamicObstacle", message);
            }
            let drive = format!("the drive of recorded vehicle {}", obstacle.name);
            (sized(VehicleParameters::FUSION, obstacle.size), poses, gaps, drive)
        }
    };
    let (points, headings) = poses.iter().map(|pose| (pose.position, pose.heading_rad)).unzip();
    let ego_log = Recording { points, headings, gaps, dt_secs: TICK_SECS }.centred(&vehicle);
    (vehicle, ego_log, drive)
}

/// Returns the words for the video model, by the tags of the file.
fn prompt(root: &Node<'_>) -> String {
    let named: BTreeSet<&str> = root.attribute("tags").unwrap_or_default().split_whitespace().collect();
    let inside: BTreeSet<&str> =
        root.get("scenarioTags").iter().flat_map(|tags| tags.children()).map(|tag| tag.name()).collect();
    let is = |tag: &str| named.contains(tag) || inside.contains(tag);
    let place = if is("highway") || is("interstate") {
        "a motorway"
    } else if is("urban") {
        "a city street"
    } else if is("rural") {
        "a country road"
    } else {
        "a road"
    };
    format!("front camera view of {place}")
}

/// Returns the origin; the format has no field for a licence.
fn source(root: &Node<'_>, drive: &str) -> Origin {
    let said = |name: &str| root.attribute(name).unwrap_or_default().trim();
    let short = |text: String| text.chars().take(400).collect();
    Origin {
        source: short(format!("CommonRoad {} ({}), {drive}", said("benchmarkID"), said("source"))),
        licence: "LicenseRef-unknown".to_owned(),
        attribution: short(format!("{}, {}", said("author"), said("affiliation"))),
    }
}

/// Returns the ids that elements of a name refer to.
fn references(node: &Node<'_>, name: &str) -> Result<Vec<String>, FieldFault> {
    let all = node.children().filter(|child| child.name() == name);
    all.map(|child| child.need_attribute("ref").map(str::to_owned)).collect()
}

fn note(notes: &mut Vec<Warning>, at: &str, message: String) {
    notes.push(Warning { at: at.to_owned(), message });
}

#[cfg(test)]
mod tests;
