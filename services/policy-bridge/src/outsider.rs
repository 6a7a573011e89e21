//! A policy in another process, asked like one inside: each observation in a session of its own.
//!
//! So an answer can depend on nothing that was shown before, and several sessions at once ask several observations at once.

use std::sync::Arc;

use ds_nn::Array;
use ds_policy::{Context, EgoView, Observation, Policy, PolicyAnswer, PolicyError, PrivilegedView, Restart};
use ds_process::maker::Fault;
use ds_raster::RgbImage;
use ds_space::{CameraModel, DVec2, Draws, PoseSe2, SimTime};
use ds_wire::policy::SessionHello;
use ds_world::{EgoState, RouteCommand};

use crate::guest::{External, OutsideBus};

/// How far a plan should reach that is asked for its context alone, in ticks of 0.1 s.
const HORIZON_TICKS: u32 = 80;

/// The policy that may connect to an outside bus.
#[derive(Debug, Clone)]
pub struct Outsider {
    outside: Arc<OutsideBus>,
    together: bool,
}

impl Outsider {
    /// Asks whoever connects; `together`: it holds several sessions at a time.
    #[must_use]
    pub fn new(outside: Arc<OutsideBus>, together: bool) -> Self {
        Self { outside, together }
    }

    fn ask(&self, observation: &Observation) -> Result<PolicyAnswer, PolicyError> {
        observation.check()?;
        let hello = SessionHello {
            cameras: observation.cameras.clone(),
            history: u32::try_from(observation.stamps.len()).unwrap_or(u32::MAX),
            horizon: SimTime(observation.dt.0 * i64::from(observation.horizon_ticks)),
            step: observation.dt,
            deadline_millis: self.outside.deadline_millis(),
        };
        let failed = |fault: Fault| PolicyError::Outside { fault: fault.name, detail: fault.detail };
        let mut session = External::begin(Arc::clone(&self.outside), hello).map_err(failed)?;
        let plan = session
            .plan(observation, &states(observation), observation.stamps.last().copied().unwrap_or_default())
            .map_err(failed)?;
        Ok(PolicyAnswer {
            trajectory: plan.trajectory,
            proposals: plan.proposals,
            context: plan.context.map(|told| {
                let sides: Vec<usize> = told.shape.iter().map(|side| *side as usize).collect();
                Context { tokens: Array::new(&sides, told.values), grid: None }
            }),
        })
    }
}

/// Returns the car's states at the stamps: where it was, and all the time as fast as it is now.
fn states(observation: &Observation) -> Vec<EgoState> {
    let ego = &observation.ego;
    let state = |pose| EgoState {
        pose,
        velocity_mps: DVec2::new(ego.speed_mps, 0.0),
        yaw_rate_radps: ego.yaw_rate_radps,
        acceleration_mps2: ego.acceleration_mps2,
        steering_rad: ego.steering_rad,
        ..EgoState::default()
    };
    ego.history.iter().copied().map(state).collect()
}

impl Policy for Outsider {
    fn name(&self) -> &str {
        self.outside.policy()
    }

    fn privileged(&self) -> bool {
        false
    }

    fn plan(&mut self, observation: &Observation, _: Option<&PrivilegedView>) -> Result<PolicyAnswer, PolicyError> {
        self.ask(observation)
    }

    fn plan_together(&mut self, observations: &[&Observation]) -> Result<Option<Vec<PolicyAnswer>>, PolicyError> {
        if !self.together {
            return Ok(None);
        }
        std::thread::scope(|scope| {
            let asked: Vec<_> = observations.iter().map(|seen| scope.spawn(|| self.ask(seen))).collect();
            let answers =
                asked.into_iter().map(|thread| thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)));
            answers.collect::<Result<Vec<_>, _>>().map(Some)
        })
    }

    /// What the policy tells with its answer, asked for a car that stands still.
    fn context(&mut self, cameras: &[CameraModel], frames: &[RgbImage]) -> Result<Option<Context>, PolicyError> {
        let standing = Observation {
            frames: frames.iter().map(|frame| vec![frame.clone()]).collect(),
            cameras: cameras.to_vec(),
            ego: EgoView { history: vec![PoseSe2::default()], ..EgoView::default() },
            command: RouteCommand::Straight,
            stamps: vec![SimTime(0)],
            horizon_ticks: HORIZON_TICKS,
            dt: SimTime::from_secs(0.1),
            draw: Draws::from_seed(0, "context"),
        };
        Ok(self.ask(&standing)?.context)
    }

    fn restart(&self) -> Restart {
        Restart::Stateless
    }
}
