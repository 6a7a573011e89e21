//! Closed-loop drives on reference frames: to measure the policy on held-out scenarios, and to gather the states that it
//! gets into on training scenarios, labelled by the teacher.
//!
//! Route completion here is the way along the expert's route until the ego is more than 4 m off it or collides by its own
//! fault, divided by the expert's own way in the same time, at most 1. Beside it stand the ways until the ego left the
//! route, and of the whole drive whatever happens, as shares of the route to the end of the log. These figures steer training; they are no scores.

use ds_nn::Weights;
use ds_nn::team::Team;
use ds_policy::constant_velocity::ConstantVelocity;
use ds_policy::route_follower::RouteFollower;
use ds_policy::{EgoView, Learned, Observation, Policy, PolicyError, PrivilegedView};
use ds_raster::RgbImage;
use ds_sim::{SimConfig, Simulation};
use ds_space::{Draws, Tick};
use ds_world::WorldState;
use serde_json::json;

use super::PolicyTrainError;
use super::augment::softened;
use super::dataset::{Samples, ScenarioSplit, Stage};
use super::settings::PolicySettings;

/// A drive farther off the route than this has failed, in metres.
const OFF_ROUTE_M: f64 = 4.0;
/// Where the training scenarios that the policy itself drives begin, after those of the expert's samples.
const FIRST_DRIVEN: u64 = 40_000;

/// Who drove on what.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Driven {
    /// The trained policy on its own frames.
    Trained,
    /// The trained policy on its own frames at a quarter of their resolution: a stand-in for soft generated frames.
    Softened,
    /// The trained policy on frames of another scenario.
    Elsewhere,
    /// The trained policy on the first frame for ever.
    Frozen,
    /// Constant velocity.
    ConstantVelocity,
    /// The privileged teacher.
    RouteFollower,
}

impl Driven {
    const ALL: [Self; 6] =
        [Self::Trained, Self::Softened, Self::Elsewhere, Self::Frozen, Self::ConstantVelocity, Self::RouteFollower];

    /// Returns the name in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Trained => "trained",
            Self::Softened => "trained-softened",
            Self::Elsewhere => "trained-elsewhere",
            Self::Frozen => "trained-frozen",
            Self::ConstantVelocity => "constant-velocity",
            Self::RouteFollower => "route-follower",
        }
    }

    fn policy(self, student: Learned, weights: &Weights) -> Result<Box<dyn Policy>, PolicyTrainError> {
        Ok(match self {
            Self::Trained | Self::Softened | Self::Elsewhere | Self::Frozen => student.policy(weights)?,
            Self::ConstantVelocity => Box::new(ConstantVelocity),
            Self::RouteFollower => Box::new(RouteFollower::default()),
        })
    }
}

/// What came of a drive.
#[derive(Debug, Clone, PartialEq)]
pub struct DriveResult {
    /// The scenario's name.
    pub scenario: String,
    /// Who drove.
    pub driven: Driven,
    /// Way until the drive left the route or collided, as a share of the expert's way in the same time, 0 to 1.
    pub route_completion: f64,
    /// Way until the drive left the route, whatever was hit, as a share of the route to the end of the log, 0 to 1.
    pub on_route_share_of_log: f64,
    /// Way of the whole drive as a share of the route to the end of the log, 0 to 1.
    pub share_of_log: f64,
    /// Whether the ego left the route by more than 4 m.
    pub off_route: bool,
    /// Whether the ego caused a collision.
    pub at_fault: bool,
}

/// Makes the observation of a world; `frame` is what the first camera showed.
fn observation(settings: &PolicySettings, stage: &Stage, simulation: &Simulation, frame: RgbImage) -> Observation {
    let world = simulation.state();
    Observation {
        frames: vec![vec![frame]],
        cameras: vec![stage.scene.cameras[0].clone()],
        ego: EgoView::of(&[world.ego]),
        command: simulation.route_command(),
        stamps: vec![world.time],
        horizon_ticks: 80,
        dt: stage.scene.dt,
        draw: Draws::from_seed(settings.seed, "policy"),
    }
}

fn failed(stage: &Stage) -> impl Fn(PolicyError) -> PolicyTrainError {
    let name = stage.scene.name.clone();
    move |source| PolicyTrainError::Policy { name: name.clone(), source }
}

/// Drives training scenarios with the policy and returns its states with the teacher's labels.
pub(super) fn samples_of(
    settings: &PolicySettings,
    round: u64,
    scenarios: u32,
    team: &Team,
    policy: impl Fn() -> Result<Box<dyn Policy>, PolicyTrainError> + Sync,
) -> Result<Samples, PolicyTrainError> {
    let made = team.run(scenarios as usize, |index| {
        let mut stage = Stage::new(ScenarioSplit::Training, FIRST_DRIVEN + 10_000 * round + index as u64);
        let (mut policy, mut samples) = (policy()?, Vec::new());
        let start = Draws::new(&stage.scene.digest, "policy start", &[round]).below(0, 50);
        #[expect(clippy::cast_possible_truncation, reason = "below 50")]
        let mut simulation = stage.simulation(SimConfig::default(), Tick(start as u32))?;
        let last = simulation.state().tick.plus(settings.drive_ticks).min(Tick(110));
        while simulation.state().tick < last && !is_over(&stage, simulation.state()) {
            let world = simulation.state().clone();
            let frame = stage.frame(&world)?;
            samples.push(stage.sample(&world, &frame, simulation.route_command()));
            let seen = observation(settings, &stage, &simulation, frame);
            let answer = policy.plan(&seen, None).map_err(failed(&stage))?;
            simulation.begin_plan(&answer.trajectory);
            for _ in 0..settings.replan_ticks {
                simulation.step();
            }
        }
        Ok(samples)
    });
    Samples::joined(made)
}

fn is_over(stage: &Stage, world: &WorldState) -> bool {
    let off_m = stage.driver.route().project_pose(&world.ego.pose).left_m.abs();
    off_m > OFF_ROUTE_M || world.contacts.iter().any(|contact| contact.at_fault)
}

/// Drives all held-out scenarios with everyone.
pub(super) fn evaluate(
    student: Learned,
    settings: &PolicySettings,
    weights: &Weights,
    listener: &mut dyn FnMut(&str),
) -> Result<Vec<DriveResult>, PolicyTrainError> {
    let mut results = Vec::new();
    for index in 0..u64::from(settings.driven_scenarios) {
        let stage = Stage::new(ScenarioSplit::HeldOut, index);
        // Another family and another seed, so that neither the road nor the traffic agrees.
        let elsewhere = Stage::new(ScenarioSplit::HeldOut, index + 11);
        for driven in Driven::ALL {
            let mut policy = driven.policy(student, weights)?;
            let result = drive(settings, &stage, &elsewhere, driven, &mut *policy)?;
            listener(&line(&result).to_string());
            results.push(result);
        }
    }
    for driven in Driven::ALL {
        let of: Vec<&DriveResult> = results.iter().filter(|result| result.driven == driven).collect();
        let count = of.len().max(1) as f64;
        let share = |is: fn(&DriveResult) -> bool| of.iter().filter(|result| is(result)).count() as f64 / count;
        let mean = of.iter().map(|result| result.route_completion).sum::<f64>() / count;
        let line = json!({
            "driven": driven.name(), "drives": of.len(), "mean_route_completion": mean,
            "mean_on_route_share_of_log": of.iter().map(|result| result.on_route_share_of_log).sum::<f64>() / count,
            "mean_share_of_log": of.iter().map(|result| result.share_of_log).sum::<f64>() / count,
            "off_route": share(|result| result.off_route), "at_fault": share(|result| result.at_fault),
        });
        listener(&line.to_string());
    }
    Ok(results)
}

fn line(result: &DriveResult) -> serde_json::Value {
    json!({
        "scenario": result.scenario, "driven": result.driven.name(), "route_completion": result.route_completion,
        "on_route_share_of_log": result.on_route_share_of_log, "share_of_log": result.share_of_log, "off_route": result.off_route, "at_fault": result.at_fault,
    })
}

fn drive(
    settings: &PolicySettings,
    stage: &Stage,
    elsewhere: &Stage,
    driven: Driven,
    policy: &mut dyn Policy,
) -> Result<DriveResult, PolicyTrainError> {
    let route = stage.driver.route();
    let mut simulation = stage.simulation(SimConfig::default(), Tick(0))?;
    let start_m = route.project_pose(&simulation.state().ego.pose).along_m;
    let (mut along_m, mut sound_m, mut on_route_m) = (start_m, start_m, start_m);
    let (mut off_route, mut at_fault) = (false, false);
    while simulation.state().tick < Tick(settings.drive_ticks) {
        let frame = shown(stage, elsewhere, driven, simulation.state())?;
        let seen = observation(settings, stage, &simulation, frame);
        let world = simulation.state();
        let view = PrivilegedView { scene: stage.scene.clone(), tick: world.tick, ego: world.ego, live: None };
        let answer = policy.plan(&seen, policy.privileged().then_some(&view)).map_err(failed(stage))?;
        simulation.begin_plan(&answer.trajectory);
        for _ in 0..settings.replan_ticks {
            let world = simulation.step();
            let at = route.project_within(world.ego.pose.position, along_m - 15.0, along_m + 30.0);
            along_m = at.along_m;
            off_route |= at.left_m.abs() > OFF_ROUTE_M;
            at_fault |= world.contacts.iter().any(|contact| contact.at_fault);
            if !off_route {
                on_route_m = f64::max(on_route_m, along_m);
            }
            if !off_route && !at_fault {
                sound_m = f64::max(sound_m, along_m);
            }
        }
    }
    let expert_m = |tick| (route.project_pose(&stage.scene.logged_ego(tick).pose).along_m - start_m).max(1.0);
    Ok(DriveResult {
        scenario: stage.scene.name.clone(),
        driven,
        route_completion: ((sound_m - start_m) / expert_m(Tick(settings.drive_ticks))).clamp(0.0, 1.0),
        on_route_share_of_log: ((on_route_m - start_m) / expert_m(stage.scene.last_tick())).clamp(0.0, 1.0),
        share_of_log: ((along_m - start_m) / expert_m(stage.scene.last_tick())).clamp(0.0, 1.0),
        off_route,
        at_fault,
    })
}

/// Returns what the first camera is said to show.
fn shown(stage: &Stage, elsewhere: &Stage, driven: Driven, world: &WorldState) -> Result<RgbImage, PolicyTrainError> {
    Ok(match driven {
        Driven::Trained => stage.frame(world)?,
        Driven::Softened => softened(&stage.frame(world)?),
        Driven::Frozen => {
            let config = SimConfig { agents: None, ..SimConfig::default() };
            stage.frame(stage.simulation(config, Tick(0))?.state())?
        }
        Driven::Elsewhere => {
            let config = SimConfig { agents: None, ..SimConfig::default() };
            elsewhere.frame(elsewhere.simulation(config, world.tick)?.state())?
        }
        Driven::ConstantVelocity | Driven::RouteFollower => RgbImage::filled(1, 1, [0; 3]),
    })
}
