//! The plain data of a closed-loop drive: what is fixed, and one state of it. World frame, SI units.

use ds_space::{DVec2, PoseSe2};
use ds_world::Polygon;

use crate::error::{ScoreError, finite, sized};
use crate::footprint::Footprint;
use crate::motion::VehicleState;
use crate::scene::ObjectClass;

/// A lane of the map.
#[derive(Debug, Clone, PartialEq)]
pub struct LoopLane {
    /// Its centre line in driving direction, in metres.
    pub line: Vec<DVec2>,
    /// Its surface, in metres.
    pub outline: Polygon,
    /// Whether it leads through a junction.
    pub connector: bool,
    /// Whether the route goes along it.
    pub on_route: bool,
}

/// What does not change during a drive.
#[derive(Debug, Clone, PartialEq)]
pub struct LoopScene {
    /// Time between states, in seconds.
    pub dt_s: f64,
    /// The ego's own rectangle.
    pub footprint: Footprint,
    /// The lanes.
    pub lanes: Vec<LoopLane>,
    /// Surfaces on which driving is allowed, in metres.
    pub drivable: Vec<Polygon>,
    /// Junction areas, in metres.
    pub junctions: Vec<Polygon>,
    /// Whether any traffic light is known.
    pub has_lights: bool,
    /// The expert's recorded path, in metres.
    pub expert_path: Vec<DVec2>,
    /// The expert's share of its path inside the scored window, if that is not the whole recording.
    pub window_share: Option<f64>,
}

/// Returns the share of a recorded path that lies between two states, `end` excluded; `None` if the path has no length.
///
/// BS `core/base_evaluator.py:1922-1945`.
#[must_use]
pub fn window_share(positions: &[DVec2], start: usize, end: usize) -> Option<f64> {
    let length_m = |positions: &[DVec2]| positions.windows(2).map(|pair| (pair[1] - pair[0]).length()).sum::<f64>();
    let end = end.min(positions.len());
    let whole_m = length_m(positions);
    (whole_m > 0.0).then(|| length_m(&positions[start.min(end)..end]) / whole_m)
}

/// The ego in one state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoopEgo {
    /// The centre of its box.
    pub centre: PoseSe2,
    /// The velocity of the centre in the world, in metres per second.
    pub velocity_mps: DVec2,
    /// The state of the rear axle, if known; comfort of the profile `strict` needs it.
    pub state: Option<VehicleState>,
}

/// Another road user or thing in one state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoopObject {
    /// Who it is, the same in all states.
    pub id: u32,
    /// Whether it can be expected to move.
    pub class: ObjectClass,
    /// Its centre and heading.
    pub pose: PoseSe2,
    /// Length along its heading, in metres.
    pub length_m: f64,
    /// Width across its heading, in metres.
    pub width_m: f64,
    /// Its velocity in the world, in metres per second.
    pub velocity_mps: DVec2,
}

/// One state of a drive.
#[derive(Debug, Clone, PartialEq)]
pub struct LoopState {
    /// Its number.
    pub tick: u32,
    /// The ego.
    pub ego: LoopEgo,
    /// Everything else.
    pub objects: Vec<LoopObject>,
    /// Indices of the lanes that show red.
    pub red_lanes: Vec<usize>,
}

impl LoopState {
    /// Checks all numbers.
    pub(crate) fn check(&self, lanes: usize) -> Result<(), ScoreError> {
        let numbers = |pose: &PoseSe2, velocity: DVec2| {
            let values = [pose.position.x, pose.position.y, pose.heading_rad, velocity.x, velocity.y];
            ["x", "y", "heading", "vx", "vy"].into_iter().zip(values)
        };
        let tick = self.tick;
        for (name, value) in numbers(&self.ego.centre, self.ego.velocity_mps) {
            finite(value, || format!("states[{tick}].ego.{name}"))?;
        }
        if let Some((name, value)) = self.ego.state.as_ref().and_then(VehicleState::not_finite) {
            return Err(ScoreError::NotFinite { field: format!("states[{tick}].ego.{name}"), value });
        }
        for (index, object) in self.objects.iter().enumerate() {
            sized(object.length_m, object.width_m, || format!("states[{tick}].objects[{index}]"))?;
            for (name, value) in numbers(&object.pose, object.velocity_mps) {
                finite(value, || format!("states[{tick}].objects[{index}].{name}"))?;
            }
        }
        match self.red_lanes.iter().find(|lane| **lane >= lanes) {
            Some(index) => {
                Err(ScoreError::NoSuchIndex { field: format!("states[{tick}].red_lanes"), index: *index, count: lanes })
            }
            None => Ok(()),
        }
    }
}
