//! An external policy as a guest of the outside bus: it is greeted, shown observations and waited for.
//!
//! Greeting and observation are repeated until they are answered; after the deadline the episode ends by a named rule.

use std::sync::Arc;
use std::time::Duration;

use anyhow::Context;
use ds_bus::{FromBridge, FromPolicy, PolicyBus, PolicyBusSettings, PolicySession, TlsFiles};
use ds_policy::Observation;
use ds_process::maker::Fault;
use ds_raster::Encoding;
use ds_space::{InstanceId, PoseSe2, SimTime};
use ds_topic::{Plan, SceneMessage};
use ds_wire::policy::{self as outside, CameraView, SessionGoodbye, SessionHello, StampedEgo, StampedImage};
use ds_world::EgoState;
use tokio::runtime::Runtime;

mod paced;

use paced::Pace;

/// How often a greeting or an observation is repeated.
const REPEAT_AFTER: Duration = Duration::from_millis(200);
/// How long a policy may take to connect at all.
const CONNECT_WITHIN: Duration = Duration::from_secs(60);

/// The bridge's outside: one external policy may connect.
#[derive(Debug)]
pub struct OutsideBus {
    bus: PolicyBus,
    policy: String,
    deadline: Duration,
}

impl OutsideBus {
    /// Listens for the policy of a name; `deadline` is its time for one plan.
    ///
    /// # Errors
    /// If the name is not one or the endpoint cannot be listened on.
    pub async fn open(policy: &str, listen: &str, tls: Option<TlsFiles>, deadline: Duration) -> anyhow::Result<Self> {
        let named = InstanceId::new(policy).context("name of the external policy")?;
        let settings = PolicyBusSettings { policy: named, listen: vec![listen.to_owned()], connect: Vec::new(), tls };
        let bus = PolicyBus::open(&settings).await.context("policy bus")?;
        tracing::info!(policy, listens = ?bus.listens(), "waiting for an external policy");
        Ok(Self { bus, policy: policy.to_owned(), deadline })
    }

    /// Returns the endpoints that it listens on, ports filled in.
    #[must_use]
    pub fn listens(&self) -> &[String] {
        self.bus.listens()
    }

    /// Returns the name of the policy that may connect.
    #[must_use]
    pub fn policy(&self) -> &str {
        &self.policy
    }

    /// Returns the time that the policy has for each answer, in milliseconds.
    #[must_use]
    pub fn deadline_millis(&self) -> u64 {
        u64::try_from(self.deadline.as_millis()).unwrap_or(u64::MAX)
    }
}

/// A session with an external policy, under a random name.
pub struct External {
    /// Its own, so that who waits here is not cut off where the command's ends first.
    runtime: Arc<Runtime>,
    outside: Arc<OutsideBus>,
    session: PolicySession,
    hello: SessionHello,
    greeted: bool,
    sequence: u64,
    /// Pose and time of the first observation: what the guest's coordinates are relative to.
    start: Option<(PoseSe2, SimTime)>,
    /// In wall-clock mode, its clock.
    pace: Option<Pace>,
}

impl Drop for External {
    fn drop(&mut self) {
        let goodbye = FromBridge::Goodbye(SessionGoodbye { reason: "the drive is over".to_owned() });
        if let Err(error) = self.runtime.block_on(self.session.put(&goodbye)) {
            tracing::debug!(%error, "goodbye was not said");
        }
    }
}

impl External {
    /// Begins a session with the policy that the episode names.
    ///
    /// # Errors
    /// If another policy may connect here, or the bus is closed.
    pub fn attach(outside: Arc<OutsideBus>, scene: &SceneMessage) -> Result<Self, Fault> {
        let spec = &scene.spec;
        if outside.policy != spec.policy {
            let detail = format!("{:?} may connect here, the episode asks for {:?}", outside.policy, spec.policy);
            return Err(Fault::policy("policy_unknown", detail));
        }
        let dt = scene.scene.dt;
        let period = Duration::from_secs_f64(dt.secs() * f64::from(spec.replan_period));
        let pace = spec.wall_clock.then(|| Pace::new(period));
        let deadline = if spec.wall_clock { period } else { outside.deadline };
        let hello = SessionHello {
            cameras: scene.scene.cameras.clone(),
            history: spec.history,
            horizon: SimTime(dt.0 * i64::from(spec.horizon)),
            step: dt,
            deadline_millis: u64::try_from(deadline.as_millis()).unwrap_or(u64::MAX),
        };
        let mut session = Self::begin(outside, hello)?;
        session.pace = pace;
        Ok(session)
    }

    /// Begins a session in which the policy is told this at first.
    ///
    /// # Errors
    /// If the bus is closed.
    pub fn begin(outside: Arc<OutsideBus>, hello: SessionHello) -> Result<Self, Fault> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build();
        let runtime = runtime.map_err(|error| Fault::infrastructure("policy_bus", error))?;
        let session = runtime.block_on(outside.bus.begin());
        let session = session.map_err(|error| Fault::infrastructure("policy_bus", error))?;
        let runtime = Arc::new(runtime);
        Ok(Self { runtime, outside, session, hello, greeted: false, sequence: 0, start: None, pace: None })
    }

    /// Shows an observation and waits for the plan that begins at `now`; in wall-clock mode no longer than real time allows.
    ///
    /// # Errors
    /// `policy_absent`, `policy_deadline`, `policy_left` or `plan_refused`; `policy_bus` if the bus is closed.
    pub fn plan(&mut self, observation: &Observation, states: &[EgoState], now: SimTime) -> Result<Plan, Fault> {
        let runtime = Arc::clone(&self.runtime);
        runtime.block_on(async {
            if !self.greeted {
                self.greet().await?;
            }
            match self.pace.take() {
                Some(mut pace) => {
                    let plan = self.ask_by_the_clock(observation, states, now, &mut pace).await;
                    self.pace = Some(pace);
                    plan
                }
                None => self.ask(observation, states).await,
            }
        })
    }

    async fn greet(&mut self) -> Result<(), Fault> {
        let hello = FromBridge::Hello(self.hello.clone());
        let detail = format!("{:?} did not answer within {} s", self.outside.policy, CONNECT_WITHIN.as_secs());
        let answered = tokio::time::timeout(
            CONNECT_WITHIN,
            self.until(&hello, |said| match said {
                FromPolicy::Ready(ready) => Some(ready.name),
                FromPolicy::Plan(_) | FromPolicy::Leave(_) => None,
            }),
        );
        let name = answered.await.map_err(|_late| Fault::policy("policy_absent", detail))??;
        tracing::info!(policy = self.outside.policy, says = name, "policy connected");
        self.greeted = true;
        Ok(())
    }

    async fn ask(&mut self, observation: &Observation, states: &[EgoState]) -> Result<Plan, Fault> {
        let deadline = self.outside.deadline;
        let (sequence, shown) = (self.sequence, self.shown(observation, states));
        self.sequence += 1;
        let shown = FromBridge::Observation(Box::new(shown));
        let answered = tokio::time::timeout(
            deadline,
            self.until(&shown, |said| match said {
                FromPolicy::Plan(plan) if plan.for_sequence == sequence => Some(plan.plan),
                FromPolicy::Plan(_) | FromPolicy::Ready(_) | FromPolicy::Leave(_) => None,
            }),
        );
        let detail = format!("no plan for observation {sequence} within {} s", deadline.as_secs_f64());
        answered.await.map_err(|_late| Fault::policy("policy_deadline", detail))?
    }

    /// Says something again and again until the wanted answer comes.
    async fn until<T>(&mut self, say: &FromBridge, wanted: impl Fn(FromPolicy) -> Option<T>) -> Result<T, Fault> {
        let mut again = tokio::time::interval(REPEAT_AFTER);
        loop {
            tokio::select! {
                _ = again.tick() => {
                    self.session.put(say).await.map_err(|error| Fault::infrastructure("policy_bus", error))?;
                }
                said = self.session.recv() => match said {
                    Ok(FromPolicy::Leave(leave)) => return Err(Fault::policy("policy_left", leave.reason)),
                    Ok(said) => {
                        if let Some(answer) = wanted(said) {
                            return Ok(answer);
                        }
                    }
                    Err(error) => return Err(Fault::policy(Fault::PLAN_REFUSED, error)),
                },
            }
        }
    }

    /// Makes what the guest sees: no absolute pose, no absolute time, no names but the cameras'.
    fn shown(&mut self, observation: &Observation, states: &[EgoState]) -> outside::Observation {
        let now = observation.stamps.last().copied().unwrap_or_default();
        let (start, began) =
            *self.start.get_or_insert_with(|| (states.last().map_or(PoseSe2::default(), |state| state.pose), now));
        let since = |time: SimTime| time - began;
        let cameras = observation.cameras.iter().zip(&observation.frames).map(|(camera, frames)| CameraView {
            camera: camera.clone(),
            images: observation
                .stamps
                .iter()
                .zip(frames)
                .map(|(time, image)| StampedImage { time: since(*time), image: image.clone() })
                .collect(),
        });
        let ego = observation.stamps.iter().zip(states).map(|(time, state)| StampedEgo {
            time: since(*time),
            state: EgoState { pose: start.relative(&state.pose), ..*state },
        });
        outside::Observation {
            sequence: self.sequence,
            time: since(now),
            cameras: cameras.collect(),
            ego: ego.collect(),
            command: observation.command,
            horizon: self.hello.horizon,
            step: self.hello.step,
            deadline_millis: self.hello.deadline_millis,
            encoding: Encoding::None,
        }
    }
}
