//! Obstacles → tracks. A shape of several parts, a circle or a polygon becomes the box around it; heights are those
//! usual for the class, since the format is flat. Positions are those of the shape's origin, as the format has them.

use std::collections::BTreeMap;

use ds_scenario::{MAX_STATES, Warning};
use ds_space::{DVec2, PoseSe2, angle};
use ds_world::{AgentClass, Size, Track, TrackPoint};

use super::element::Node;
use super::{Window, note};
use crate::scenarionet::tracks::usual;
use crate::view::FieldFault;

/// The largest box of a scene, in metres.
const LARGEST_M: f64 = 60.0;

/// An obstacle of the file.
#[derive(Debug)]
pub(super) struct Obstacle {
    pub name: String,
    pub class: AgentClass,
    pub size: Size,
    /// Whether it stands where it is for good.
    pub stands: bool,
    /// The centre of its box by time step.
    pub states: BTreeMap<u32, TrackPoint>,
}

impl Obstacle {
    /// Returns the box at a time between steps; nothing where it is not seen at the steps before and after.
    pub(super) fn at(&self, step: f64) -> Option<TrackPoint> {
        const SAME: f64 = 1e-6;
        if self.stands {
            return self.states.values().next().copied();
        }
        let before = (step + SAME).floor();
        let share = step - before;
        let from = *self.states.get(&(before as u32))?;
        if share < SAME {
            return Some(from);
        }
        let to = self.states.get(&(before as u32 + 1))?;
        Some(TrackPoint {
            pose: from.pose.lerp(&to.pose, share),
            z_m: 0.0,
            velocity_mps: from.velocity_mps.lerp(to.velocity_mps, share),
        })
    }
}

/// Reads all obstacles, `dt_secs` being the time between steps.
pub(super) fn obstacles(root: &Node<'_>, dt_secs: f64, notes: &mut Vec<Warning>) -> Result<Vec<Obstacle>, FieldFault> {
    let (mut obstacles, mut left, mut still) = (Vec::new(), BTreeMap::<String, usize>::new(), 0);
    for node in root.children() {
        let stands = match node.name() {
            "staticObstacle" => true,
            "dynamicObstacle" => false,
            "obstacle" => node.need("role")?.text() == "static",
            "environmentObstacle" | "phantomObstacle" => {
                *left.entry(node.name().to_owned()).or_default() += 1;
                continue;
            }
            _ => continue,
        };
        let kind = node.need("type")?.text();
        let (Some(class), Some(shape)) = (class(kind, stands), shape(&node.need("shape")?)?) else {
            *left.entry(kind.to_owned()).or_default() += 1;
            continue;
        };
        let states = states(&node, &shape.0, dt_secs)?;
        still += usize::from(!stands && states.len() == 1);
        let size = Size { length_m: shape.1.x, width_m: shape.1.y, height_m: usual(class).height_m };
        obstacles.push(Obstacle { name: node.need_attribute("id")?.to_owned(), class, size, stands, states });
    }
    for (kind, count) in left {
        note(notes, "obstacle", format!("{count} of type {kind:?} have no place in the scene and are left out"));
    }
    if still > 0 {
        note(
            notes,
            "dynamicObstacle",
            format!("{still} have no trajectory and are seen at their first time step only"),
        );
    }
    Ok(obstacles)
}

/// Returns the class of a type; `None` for what is no road user or obstacle on the road.
fn class(kind: &str, stands: bool) -> Option<AgentClass> {
    match kind {
        "car" | "truck" | "bus" | "priorityVehicle" | "taxi" | "parkedVehicle" | "train" => Some(AgentClass::Vehicle),
        "unknown" if !stands => Some(AgentClass::Vehicle),
        "motorcycle" | "bicycle" => Some(AgentClass::Cyclist),
        "pedestrian" => Some(AgentClass::Pedestrian),
        "constructionZone" | "roadBoundary" | "pillar" | "median_strip" | "medianStrip" | "unknown" => {
            Some(AgentClass::Barrier)
        }
        _ => None,
    }
}

/// Returns the box of a shape, as its pose in the obstacle and its length and width; `None` if it is too large.
fn shape(node: &Node<'_>) -> Result<Option<(PoseSe2, DVec2)>, FieldFault> {
    let parts: Vec<Node<'_>> = node.children().collect();
    let boxed = match parts.as_slice() {
        [only] if only.name() == "rectangle" => rectangle(only)?,
        _ => {
            let mut corners = Vec::new();
            for part in &parts {
                corners.extend(outline(part)?);
            }
            around(&corners).ok_or_else(|| node.fault("holds no rectangle, circle or polygon"))?
        }
    };
    if boxed.1.min_element() <= 0.0 {
        return Err(node.fault(format!("is {} m long and {} m wide", boxed.1.x, boxed.1.y)));
    }
    Ok((boxed.1.max_element() <= LARGEST_M).then_some(boxed))
}

fn rectangle(node: &Node<'_>) -> Result<(PoseSe2, DVec2), FieldFault> {
    let position = node.get("center").map(|centre| centre.place()).transpose()?.unwrap_or_default();
    let heading_rad = node.get("orientation").map(|turn| turn.number()).transpose()?.unwrap_or(0.0);
    let size = DVec2::new(node.need("length")?.number()?, node.need("width")?.number()?);
    Ok((PoseSe2 { position, heading_rad: angle::wrap(heading_rad) }, size))
}

fn outline(node: &Node<'_>) -> Result<Vec<DVec2>, FieldFault> {
    match node.name() {
        "rectangle" => {
            let (pose, size) = rectangle(node)?;
            Ok(ds_world::agent::corners(&pose, size.x, size.y).to_vec())
        }
        "circle" => {
            let centre = node.get("center").map(|centre| centre.place()).transpose()?.unwrap_or_default();
            let radius = node.need("radius")?.number()?;
            Ok(vec![centre - radius, centre + radius])
        }
        "polygon" => node.all("point").map(|point| point.place()).collect(),
        other => Err(node.fault(format!("is a {other:?}, no rectangle, circle or polygon"))),
    }
}

/// Returns the middle and the size of the upright box around some points.
fn around(points: &[DVec2]) -> Option<(PoseSe2, DVec2)> {
    let low = points.iter().copied().reduce(DVec2::min)?;
    let high = points.iter().copied().reduce(DVec2::max)?;
    Some((PoseSe2 { position: low.midpoint(high), heading_rad: 0.0 }, high - low))
}

/// Returns where a state's position is: a point, or the middle of an area that it lies in.
pub(super) fn position(state: &Node<'_>) -> Result<DVec2, FieldFault> {
    let node = state.need("position")?;
    if let Some(point) = node.get("point") {
        return point.place();
    }
    let mut corners = Vec::new();
    for part in node.children() {
        corners.extend(outline(&part)?);
    }
    let middle = around(&corners).ok_or_else(|| node.fault("has no point and no area"))?;
    Ok(middle.0.position)
}

/// Returns the states of an obstacle by time step; `local` is the pose of its box in it.
fn states(node: &Node<'_>, local: &PoseSe2, dt_secs: f64) -> Result<BTreeMap<u32, TrackPoint>, FieldFault> {
    let (mut states, mut unsaid) = (BTreeMap::new(), Vec::new());
    let later = node.get("trajectory").into_iter().flat_map(|trajectory| trajectory.all("state"));
    for state in std::iter::once(node.need("initialState")?).chain(later) {
        let time = state.get("time").map(|time| time.step()).transpose()?.unwrap_or(0);
        let heading_rad = angle::wrap(state.need("orientation")?.value()?);
        let pose = PoseSe2 { position: position(&state)?, heading_rad }.compose(local);
        let speed = state.get("velocity").map(|velocity| velocity.value()).transpose()?;
        unsaid.extend(speed.is_none().then_some(time));
        let velocity_mps = DVec2::from_angle(heading_rad) * speed.unwrap_or(0.0);
        if states.insert(time, TrackPoint { pose, z_m: 0.0, velocity_mps }).is_some() {
            return Err(state.fault(format!("is of time step {time}, as one before it")));
        }
    }
    for time in unsaid {
        let near = [time.checked_sub(1), Some(time), Some(time + 1)].into_iter().flatten();
        let near: Vec<(u32, DVec2)> = near.filter_map(|time| Some((time, states.get(&time)?.pose.position))).collect();
        let [(first, from), .., (last, to)] = near.as_slice() else { continue };
        let velocity_mps = (*to - *from) / (f64::from(last - first) * dt_secs);
        states.entry(time).and_modify(|point| point.velocity_mps = velocity_mps);
    }
    Ok(states)
}

/// Returns the tracks of the obstacles other than the ego over the ticks of a scene.
pub(super) fn tracks(obstacles: &[Obstacle], ego: Option<&str>, window: &Window) -> Result<Vec<Track>, FieldFault> {
    if obstacles.len().saturating_mul(window.count) > MAX_STATES {
        let problem = format!("are {} over {} ticks, over {MAX_STATES} states", obstacles.len(), window.count);
        return Err(FieldFault { at: "obstacle".to_owned(), problem });
    }
    let moved = |mut point: TrackPoint| {
        point.pose.position -= window.origin;
        point
    };
    let track = |obstacle: &Obstacle| {
        let points: Vec<_> = window.steps().map(|step| obstacle.at(step).map(moved)).collect();
        let seen = points.iter().any(Option::is_some);
        seen.then(|| Track { name: obstacle.name.clone(), class: obstacle.class, size: obstacle.size, points })
    };
    Ok(obstacles.iter().filter(|obstacle| Some(obstacle.name.as_str()) != ego).filter_map(track).collect())
}
