//! From the simulator's scene and states to the plain states of the score, live or from a recording.
//!
//! Both feed the same states to the same functions, so that a re-score equals the live score bit for bit.

use ds_space::plane::Line;
use ds_space::{DVec2, Tick};
use ds_world::{EgoState, Lane, LaneKind, LightState, Polygon, Scene, VehicleParameters, WorldState};

use super::profile::{FirstStateRule, LightTick, Profile};
use super::tick::{LoopEgo, LoopLane, LoopObject, LoopScene, LoopState, window_share};
use super::{ClosedLoop, Ending};
use crate::driving_score::{DrivingScore, LoopScore};
use crate::error::ScoreError;
use crate::footprint::Footprint;
use crate::motion::VehicleState;
use crate::scene::GovernedLanes;
use crate::scene::{expert_path, lies_along, route_line, surface_of};

/// The part of a recording that is scored, if not all of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// The tick at which the policy takes over.
    pub start: Tick,
    /// How many ticks it may drive.
    pub ticks: u32,
}

/// Turns states of one scene into states.
#[derive(Debug, Clone)]
pub struct LoopAdapter {
    vehicle: VehicleParameters,
    governed: GovernedLanes,
}

impl LoopAdapter {
    /// Prepares for a scene.
    #[must_use]
    pub fn new(scene: &Scene) -> Self {
        Self { vehicle: scene.vehicle, governed: GovernedLanes::of(scene) }
    }

    /// Returns the state of a state, judged by the given lights (in map order).
    #[must_use]
    pub fn state(&self, world: &WorldState, lights: &[LightState]) -> LoopState {
        let object = |agent: &ds_world::AgentState| LoopObject {
            id: agent.id.0,
            class: agent.class.into(),
            pose: agent.pose,
            length_m: agent.size.length_m,
            width_m: agent.size.width_m,
            velocity_mps: agent.velocity_mps,
        };
        LoopState {
            tick: world.tick.0,
            ego: loop_ego(&world.ego, &self.vehicle),
            objects: world.agents.iter().map(object).collect(),
            red_lanes: self.governed.red(lights),
        }
    }
}

/// The velocity of the centre of a turning body is not that of its rear axle.
fn loop_ego(ego: &EgoState, vehicle: &VehicleParameters) -> LoopEgo {
    let sideways_mps = ego.yaw_rate_radps * vehicle.rear_axle_to_centre_m;
    let velocity = ego.velocity_mps + DVec2::new(0.0, sideways_mps);
    LoopEgo {
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
    pub fn observe(&mut self, world: &WorldState) -> Result<Option<LoopScore>, ScoreError> {
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
        let score = self.scorer.observe(&self.adapter.state(world, lights))?;
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::closed_loop::closed_loop;
    use crate::driving_score::Term;
    use crate::road::world;

    /// The expert's drive, swaying a little so that every term has something to do.
    fn states(scene: &Scene) -> Vec<WorldState> {
        (0..=120)
            .map(|tick| {
                let mut state = scene.logged_world(Tick(tick));
                state.ego.pose.position.y = 0.9 * (0.31 * f64::from(tick)).sin();
                state.ego.acceleration_mps2.x = 1.3 * (0.53 * f64::from(tick)).cos();
                state
            })
            .collect()
    }

    fn live(scene: &Scene, profile: Profile, states: &[WorldState]) -> (Vec<LoopScore>, DrivingScore) {
        let mut scorer = LiveScorer::new(scene, profile, None).expect("a sound scene");
        let scores = states.iter().filter_map(|state| scorer.observe(state).expect("a sound state")).collect();
        (scores, scorer.finish().expect("a drive"))
    }

    #[test]
    fn a_second_pass_gives_the_same_bits_and_so_do_plain_states() {
        let scene = world();
        let states = states(&scene);
        for profile in [Profile::bridgesim(), Profile::strict()] {
            let once = live(&scene, profile, &states);
            let bits = |drive: &(Vec<LoopScore>, DrivingScore)| format!("{drive:?}");
            assert_eq!(bits(&once), bits(&live(&scene, profile, &states)));
            let adapter = LoopAdapter::new(&scene);
            let first = usize::from(profile.first_state == FirstStateRule::Skipped);
            let lights = |tick: usize| match profile.light_tick {
                LightTick::Before => &states[tick - 1].lights,
                LightTick::Same => &states[tick].lights,
            };
            let frozen: Vec<LoopState> =
                (first..first + once.0.len()).map(|tick| adapter.state(&states[tick], lights(tick))).collect();
            let plain = closed_loop(&loop_scene(&scene, None), profile, &frozen).expect("a sound drive");
            assert_eq!(bits(&once), bits(&plain));
        }
    }

    #[test]
    fn the_expert_arrives_and_nothing_is_scored_after() {
        let scene = world();
        let states: Vec<WorldState> = (0..=120).map(|tick| scene.logged_world(Tick(tick))).collect();
        // 95 % of 120 m are passed at tick 115; bridgesim counts from the state after the first step.
        let (scores, drive) = live(&scene, Profile::bridgesim(), &states);
        assert_eq!((scores[0].tick, scores.len(), drive.ended), (1, 115, Some((115, Ending::Arrived))));
        assert!((drive.route_completion.expect("it applies") - 114.0 / 120.0).abs() < 1e-9);
        let (scores, drive) = live(&scene, Profile::strict(), &states);
        assert_eq!((scores[0].tick, scores.len(), drive.route_completion), (0, 116, Some(1.0)));
        assert_eq!(scores[20].term(Term::TrafficLight), Some(1.0));
    }

    #[test]
    fn lights_are_those_of_the_profile_s_tick() {
        let scene = world();
        // Standing on in the connector: red from tick 20 to 39.
        let states: Vec<WorldState> = (0..=60)
            .map(|tick| {
                let mut state = scene.logged_world(Tick(tick));
                state.ego.pose.position.x = 65.0 + 0.02 * f64::from(tick);
                state
            })
            .collect();
        let red = |profile| {
            let lost = |score: &&LoopScore| score.term(Term::TrafficLight) == Some(0.0);
            let (scores, _) = live(&scene, profile, &states);
            (scores.iter().find(lost).map(|score| score.tick), scores.iter().rfind(lost).map(|score| score.tick))
        };
        assert_eq!(red(Profile::strict()), (Some(20), Some(39)));
        // The connector is 12 m long, so bridgesim minds the last 5 m before its end only; a short lane counts at once.
        let near_end = Profile { lights: crate::closed_loop::LightRule::NearEnd, ..Profile::strict() };
        assert_eq!(red(near_end), (None, None));
        let late = Profile { light_tick: LightTick::Before, ..Profile::strict() };
        assert_eq!(red(late), (Some(21), Some(40)));
        assert_eq!(late.label(), "custom");
    }

    #[test]
    fn a_window_scales_the_completion() {
        let scene = world();
        let states: Vec<WorldState> = (0..=60).map(|tick| scene.logged_world(Tick(tick))).collect();
        let window = Window { start: Tick(0), ticks: 60 };
        let mut scorer = LiveScorer::new(&scene, Profile::bridgesim(), Some(window)).expect("a sound scene");
        for state in &states {
            scorer.observe(state).expect("a sound state");
        }
        // 59 m from the first scored state on, as the expert's 59 m of 120 m inside the window.
        assert_eq!(scorer.finish().expect("a drive").route_completion, Some(1.0));
        assert_eq!(scorer.ended(), None);
    }
}
