//! The simulation of one episode: a scene, a configuration, and the world state that steps from tick to tick.

use std::sync::Arc;

use ds_effect::Port;
use ds_effect::plant::{Clock, Plant, Sensors};
use ds_space::plane::Polyline;
use ds_space::{DVec2, Digest, SimTime, Tick};
use ds_vehicle::{Tracker, nominal};
use ds_world::{EgoState, Reading, RouteCommand, Scene, Trajectory, WorldState};

use crate::dynamics::{Body, Chassis};
use crate::error::{SimError, SnapshotError};
use crate::participant::Obstructing;
use crate::readings::Sensing;
use crate::settings::{SimConfig, check_vehicle};
use crate::snapshot::{self, Content};
use crate::traffic::Traffic;
use crate::{contact, route, signal};

/// No snapshot is taken later than this many ticks after the log.
const MAX_TICKS_AFTER_LOG: u32 = 1_000_000;

/// A running simulation. It follows the log until a plan is begun.
#[derive(Clone)]
pub struct Simulation {
    scene: Arc<Scene>,
    config: SimConfig,
    plant: Arc<Plant>,
    /// Whether sensors or clocks show something else than the truth.
    distorted: bool,
    chassis: Chassis,
    route: Option<Polyline>,
    traffic: Traffic,
    /// The plan that is followed; `None`: the log.
    tracker: Option<Tracker>,
    body: Body,
    state: WorldState,
}

impl std::fmt::Debug for Simulation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Simulation").field("config", &self.config).field("state", &self.state).finish_non_exhaustive()
    }
}

impl Simulation {
    /// Starts at a tick of the log, following the log.
    ///
    /// # Errors
    /// [`SimError`] if the scene has no ego log, the tick lies after it, or a number is out of range.
    pub fn new(scene: Arc<Scene>, config: SimConfig, start: Tick) -> Result<Self, SimError> {
        let last = scene.last_tick();
        let mut simulation = Self::prepare(scene, config)?;
        if start > last {
            return Err(SimError::StartBeyondLog { start: start.0, last: last.0 });
        }
        let logged = simulation.chassis.take_over(simulation.scene.logged_ego(start));
        simulation.body.ego = logged.ego;
        simulation.chassis.follow(&mut simulation.body, logged);
        simulation.show(start);
        Ok(simulation)
    }

    fn prepare(scene: Arc<Scene>, config: SimConfig) -> Result<Self, SimError> {
        config.check()?;
        check_vehicle(&scene.vehicle)?;
        if scene.ego_log.is_empty() {
            return Err(SimError::EmptyLog { scene: scene.name.clone() });
        }
        if let Some(index) = scene.ego_log.iter().position(|ego| !usable(ego)) {
            return Err(SimError::Field {
                field: "ego_log",
                value: index as f64,
                need: "finite numbers up to 1e8 at this tick",
            });
        }
        let dt_secs = scene.dt.secs();
        if !(0.001..=1.0).contains(&dt_secs) {
            return Err(SimError::TimeStep { dt_secs });
        }
        let tracks = scene.tracks.len();
        let state = WorldState {
            tick: Tick(0),
            time: SimTime(0),
            ego: EgoState::default(),
            agents: Vec::with_capacity(tracks),
            lights: Vec::with_capacity(scene.map.traffic_lights.len()),
            contacts: Vec::new(),
        };
        let mut plant = nominal(&scene.vehicle, &config.idm);
        config.manners.apply(&mut plant);
        config.effects.iter().for_each(|setting| setting.apply(&mut plant));
        let plant = Arc::new(plant);
        let of_sensors = plant.laws.iter().any(|law| matches!(law.port(), Port::Sensor(_)));
        let distorted = of_sensors || plant.sensors != Sensors::default() || plant.clock != Clock::default();
        let remembers = distorted || config.vehicle_log;
        let steps = (config.substeps, dt_secs);
        Ok(Self {
            chassis: Chassis::new(scene.vehicle, config.dynamics, steps.0, steps.1, Arc::clone(&plant), remembers),
            route: Polyline::new(&scene.route),
            traffic: Traffic::new(&scene, &config, &plant),
            tracker: None,
            body: Body::default(),
            plant,
            distorted,
            scene,
            config,
            state,
        })
    }

    /// Returns the world at the current tick.
    #[must_use]
    pub fn state(&self) -> &WorldState {
        &self.state
    }

    /// Returns the scene.
    #[must_use]
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// Follows a plan from now on. Its poses are in the rig at the current tick. Past its end the car stops.
    pub fn begin_plan(&mut self, plan: &Trajectory) {
        self.tracker = Some(self.tracker(plan.clone(), (self.state.tick, self.state.ego.pose)));
    }

    /// Returns a copy for a rollout, in which all agents within 50 m of the ego react (none where the log is replayed).
    #[must_use]
    pub fn rollout(&self) -> Self {
        let mut copy = self.clone();
        copy.traffic.react_nearby();
        copy
    }

    fn tracker(&self, plan: Trajectory, border: (Tick, ds_space::PoseSe2)) -> Tracker {
        Tracker::new(plan, border, self.scene.dt, self.config.tracker)
    }

    /// Puts the ego on the log from the next step on, without dynamics; a steering angle that the log lacks is filled in
    /// from its yaw rate.
    pub fn begin_log(&mut self) {
        self.tracker = None;
    }

    /// Moves the world one tick on.
    pub fn step(&mut self) -> &WorldState {
        let next = self.state.tick.plus(1);
        let vehicle = &self.scene.vehicle;
        let ego = &self.state.ego;
        let centre = ego.centre(vehicle);
        let velocity = ego.velocity_mps + DVec2::new(0.0, ego.yaw_rate_radps * vehicle.rear_axle_to_centre_m);
        let velocity_mps = centre.forward() * velocity.x + centre.left() * velocity.y;
        if self.tracker.is_some() {
            self.traffic.engage(&self.state);
        }
        let obstructing = Obstructing { centre, velocity_mps, size: vehicle.size };
        self.traffic.advance(&self.state, obstructing, self.scene.dt.secs());
        match &self.tracker {
            None => {
                let logged = self.chassis.take_over(self.scene.logged_ego(next));
                self.chassis.follow(&mut self.body, logged);
            }
            Some(tracker) => {
                let ego = self.chassis.known(&self.body);
                let wheel_base_m = self.chassis.wheel_base_m(ego.speed_mps());
                let command = tracker.command(&ego, self.state.tick, wheel_base_m);
                self.chassis.step(&mut self.body, command);
            }
        }
        self.show(next);
        &self.state
    }

    /// Fills in the world at a tick from the body and the motions of all agents.
    fn show(&mut self, tick: Tick) {
        let state = &mut self.state;
        state.tick = tick;
        state.time = SimTime::at(tick, self.scene.dt);
        state.ego = self.body.ego;
        signal::show(&self.scene.map.traffic_lights, tick, &mut state.lights);
        self.traffic.show(&self.scene, tick, &mut state.agents);
        contact::find(&state.ego, &self.scene.vehicle, &state.agents, &mut state.contacts);
    }

    /// Returns what the car knows of its own state: the truth, as far as no effect distorts its sensors and clocks.
    #[must_use]
    pub fn ego_estimate(&self) -> EgoState {
        let ego = self.state.ego;
        let steering_rad = self.body.sensed_rad;
        if !self.distorted {
            return EgoState { steering_rad, ..ego };
        }
        let view = self.sensing().view(self.state.time.secs());
        let heading_rad = ds_space::angle::wrap(view.pose.heading_rad);
        let centre = ds_space::PoseSe2::new(view.at_m[0], view.at_m[1], heading_rad);
        EgoState {
            pose: ds_space::PoseSe2 {
                position: centre.position - centre.forward() * self.plant.vehicle.rear_arm_m,
                heading_rad,
            },
            velocity_mps: DVec2::new(view.wheel_mps, ego.velocity_mps.y),
            yaw_rate_radps: view.yaw_rate_radps,
            acceleration_mps2: DVec2::from(view.force_mps2),
            steering_rad: view.steering_rad,
            ..ego
        }
    }

    /// Returns what the car recorded of itself during the last tick, with noise drawn by `key`; nothing at the first
    /// tick, and nothing unless the configuration asks for a vehicle log.
    #[must_use]
    pub fn readings(&self, key: &Digest) -> Vec<Reading> {
        if !self.config.vehicle_log || self.state.tick.0 == 0 {
            return Vec::new();
        }
        self.sensing().readings(key, self.state.tick.0, self.scene.dt.secs())
    }

    fn sensing(&self) -> Sensing<'_> {
        let step_secs = self.scene.dt.secs() / f64::from(self.config.substeps);
        let past = &self.body.past;
        let of_sensors = self.plant.laws.iter().any(|law| matches!(law.port(), Port::Sensor(_)));
        let whole = past.sent.len() as u32;
        let known = if of_sensors { past.realise(&self.plant, step_secs, whole).known } else { Vec::new() };
        Sensing { plant: &self.plant, past, known, now_secs: self.state.time.secs(), step_secs }
    }

    /// Returns what the car's navigation says about the next manoeuvre.
    #[must_use]
    pub fn route_command(&self) -> RouteCommand {
        route::command(self.route.as_ref(), self.state.ego.pose.position)
    }

    /// Returns bytes from which [`Simulation::restore`] continues to the bit.
    #[must_use]
    pub fn snapshot(&self) -> Vec<u8> {
        let content = Content {
            tick: self.state.tick,
            body: self.body.clone(),
            plan: self.tracker.as_ref().map(|tracker| {
                let (plan, tick, anchor) = tracker.origin();
                (plan.clone(), tick, anchor)
            }),
            motions: self.traffic.motions().to_vec(),
            wishes: self.traffic.wishes().to_vec(),
            weaves: self.traffic.weaves(),
            hunter: self.traffic.hunter(),
        };
        snapshot::write(&content, &self.scene.digest, &self.config.digest())
    }

    /// Continues from a snapshot of the same scene under the same configuration.
    ///
    /// # Errors
    /// [`SimError`] if the bytes are not such a snapshot, or as for [`Simulation::new`].
    pub fn restore(scene: Arc<Scene>, config: SimConfig, bytes: &[u8]) -> Result<Self, SimError> {
        let digests = (scene.digest, config.digest());
        let mut simulation = Self::prepare(scene, config)?;
        let hunted = simulation.traffic.hunter().is_some();
        let content = snapshot::read(bytes, &digests.0, &digests.1, hunted)?;
        if content.tick > simulation.scene.last_tick().plus(MAX_TICKS_AFTER_LOG) {
            return Err(SnapshotError::Field { field: "tick", value: f64::from(content.tick.0) }.into());
        }
        simulation
            .traffic
            .set_motions(content.motions, content.wishes, &content.weaves, content.hunter.as_ref())
            .map_err(|(field, value)| SnapshotError::Field { field, value })?;
        simulation.tracker = content.plan.map(|(plan, tick, anchor)| simulation.tracker(plan, (tick, anchor)));
        simulation.body = content.body;
        simulation.show(content.tick);
        Ok(simulation)
    }
}

fn usable(ego: &EgoState) -> bool {
    let pose = ego.pose.position.abs().max_element().max(ego.pose.heading_rad.abs());
    let rates = ego.velocity_mps.abs().max_element().max(ego.acceleration_mps2.abs().max_element());
    ego.is_finite() && pose.max(rates).max(ego.yaw_rate_radps.abs()) <= snapshot::LARGEST
}
