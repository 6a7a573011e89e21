//! From the simulator's scene and states to the plain frames of the score, live or from a recording.
//!
//! Both feed the same states to the same functions, so that a re-score equals the live score bit for bit.

use ds_space::{DVec2, Tick};
use ds_world::{EgoState, Lane, LaneKind, LightState, Polygon, Scene, VehicleParameters, WorldState};

use super::frame::{EgoFrame, Frame, LoopLane, LoopObject, LoopScene, window_share};
use super::profile::{FirstStateRule, LightTick, Profile};
use super::{ClosedLoop, Ending};
use crate::driving_score::{DrivingScore, FrameScore};
use crate::error::ScoreError;
use crate::footprint::Footprint;
use crate::geometry::Line;
use crate::motion::VehicleState;
use crate::scene::{expert_path, lies_along, route_line, surface_of};

/// The part of a recording that is scored, if not all of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// The tick at which the policy takes over.
    pub start: Tick,
    /// How many ticks it may drive.
    pub ticks: u32,
}

/// Turns states of one scene into frames.
#[derive(Debug, Clone)]
pub struct LoopAdapter {
    vehicle: VehicleParameters,
    light_lanes: Vec<Vec<usize>>,
}

impl LoopAdapter {
    /// Prepares for a scene.
    #[must_use]
    pub fn new(scene: &Scene) -> Self {
        let lanes = scene.map.lanes.len();
        let governed = |lanes_of: &[ds_world::LaneId]| {
            lanes_of.iter().map(|lane| lane.0 as usize).filter(|lane| *lane < lanes).collect()
        };
        Self {
            vehicle: scene.vehicle,
            light_lanes: scene.map.traffic_lights.iter().map(|light| governed(&light.lanes)).collect(),
        }
    }

    /// Returns the frame of a state, judged by the given lights (in map order).
    #[must_use]
    pub fn frame(&self, world: &WorldState, lights: &[LightState]) -> Frame {
        let object = |agent: &ds_world::AgentState| LoopObject {
            id: agent.id.0,
            class: agent.class.into(),
            pose: agent.pose,
            length_m: agent.size.length_m,
            width_m: agent.size.width_m,
            velocity_mps: agent.velocity_mps,
        };
        let red = lights.iter().zip(&self.light_lanes).filter(|(light, _)| **light == LightState::Red);
        let mut red_lanes: Vec<usize> = red.flat_map(|(_, lanes)| lanes.iter().copied()).collect();
        red_lanes.sort_unstable();
        red_lanes.dedup();
        Frame {
            tick: world.tick.0,
            ego: ego_frame(&world.ego, &self.vehicle),
            objects: world.agents.iter().map(object).collect(),
            red_lanes,
        }
    }
}

/// The velocity of the centre of a turning body is not that of its rear axle.
fn ego_frame(ego: &EgoState, vehicle: &VehicleParameters) -> EgoFrame {
    let sideways_mps = ego.yaw_rate_radps * vehicle.rear_axle_to_centre_m;
    let velocity = ego.velocity_mps + DVec2::new(0.0, sideways_mps);
    EgoFrame {
        centre: ego.centre(vehicle),
        velocity_mps: ego.pose.forward() * velocity.x + ego.pose.left() * velocity.y,
        state: Some(VehicleState::from(ego)),
    }
}

/// Returns the fixed part of a drive through a scene; `window` is the part that is scored, if not all.
#[must_use]
pub fn loop_scene(scene: &Scene, window: Option<Window>) -> LoopScene {
    let expert_path = expert_path(scene);
    let route = route_line(scene);
    let sound = |polygon: &&Polygon| polygon.len() >= 3;
    let share = window.and_then(|window| {
        let start = window.start.0 as usize;
        window_share(&expert_path, start, start + window.ticks as usize)
    });
    LoopScene {
        dt_s: scene.dt.secs(),
        footprint: Footprint::from(&scene.vehicle),
        lanes: scene.map.lanes.iter().map(|lane| loop_lane(lane, route.as_ref())).collect(),
        drivable: scene.map.drivable.iter().filter(sound).cloned().collect(),
        junctions: scene.map.junctions.iter().filter(sound).cloned().collect(),
        has_lights: !scene.map.traffic_lights.is_empty(),
        expert_path,
        window_share: share,
    }
}

fn loop_lane(lane: &Lane, route: Option<&Line>) -> LoopLane {
    LoopLane {
        line: lane.centre_line.clone(),
        outline: surface_of(lane),
        connector: lane.kind == LaneKind::Connector,
        on_route: route.is_some_and(|route| lies_along(&lane.centre_line, route)),
    }
}

/// Scores a drive state by state as the simulator makes them, up to its ending.
#[derive(Debug, Clone)]
pub struct LiveScorer {
    scorer: ClosedLoop,
    adapter: LoopAdapter,
    lights: Option<Vec<LightState>>,
    ended: Option<Ending>,
}

impl LiveScorer {
    /// Prepares to score a drive through a scene.
    ///
    /// # Errors
    /// As [`ClosedLoop::new`].
    pub fn new(scene: &Scene, profile: Profile, window: Option<Window>) -> Result<Self, ScoreError> {
        Ok(Self {
            scorer: ClosedLoop::new(&loop_scene(scene, window), profile)?,
            adapter: LoopAdapter::new(scene),
            lights: None,
            ended: None,
        })
    }

    /// Takes the next state. Returns `None` for a state that is not scored: the first one where the profile skips it,
    /// and all after an ending.
    ///
    /// # Errors
    /// As [`ClosedLoop::observe`].
    pub fn observe(&mut self, world: &WorldState) -> Result<Option<FrameScore>, ScoreError> {
        if self.ended.is_some() {
            return Ok(None);
        }
        let profile = *self.scorer.profile();
        let before = self.lights.replace(world.lights.clone());
        if before.is_none() && profile.first_state == FirstStateRule::Skipped {
            return Ok(None);
        }
        let lights = match profile.light_tick {
            LightTick::Before => before.as_ref().unwrap_or(&world.lights),
            LightTick::Same => &world.lights,
        };
        let score = self.scorer.observe(&self.adapter.frame(world, lights))?;
        self.ended = score.ending;
        Ok(Some(score))
    }

    /// Returns why the drive ended, if it did: nothing is scored from then on.
    #[must_use]
    pub fn ended(&self) -> Option<Ending> {
        self.ended
    }

    /// Returns the score of the drive so far.
    ///
    /// # Errors
    /// As [`ClosedLoop::finish`].
    pub fn finish(&self) -> Result<DrivingScore, ScoreError> {
        self.scorer.finish()
    }
}
