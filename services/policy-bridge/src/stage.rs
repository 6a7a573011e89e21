//! The policy stage: builds the observation of an iteration and asks the guest for a plan.

use std::path::PathBuf;
use std::sync::Arc;

use ds_adverse::Expert;
use ds_policy::builtin::is_builtin;
use ds_policy::{Builtin, EgoView, Learned, Live, Observation, Own, Policy, PolicyAnswer, PolicyError, PrivilegedView};
use ds_process::maker::{Abilities, Fault, Inputs, Maker, MakerFactory, Output, bad, chain, output};
use ds_sim::SimConfig;
use ds_space::{Digest, DigestWriter, Draws, SimTime, Tick};
use ds_topic::body::Tensor;
use ds_topic::{Advance, Ego, Frame, Plan, Role, SceneMessage, Slot, Topic, World};
use ds_wire::plan::MAX_CONTEXT;
use ds_world::{Anchor, EgoState};

use crate::guest::{External, OutsideBus};

/// Opens a guest for each episode that the instance is given.
#[derive(Debug)]
pub struct PolicyStage {
    weights: PathBuf,
    own: Vec<Own>,
    outside: Option<Arc<OutsideBus>>,
}

impl PolicyStage {
    /// Names the weights of the camera policy and the bus on which external policies live, if there is one.
    #[must_use]
    pub fn new(weights: PathBuf, outside: Option<Arc<OutsideBus>>) -> Self {
        Self { weights, own: Vec::new(), outside }
    }

    /// Adds policies of one's own, by their manifests.
    ///
    /// # Errors
    /// If a manifest or a network is refused, or two policies have one name.
    pub fn with_own(mut self, manifests: &[PathBuf]) -> Result<Self, PolicyError> {
        for manifest in manifests {
            let own = Own::read(manifest)?;
            if self.own.iter().any(|other| other.name() == own.name()) {
                return Err(PolicyError::Taken { name: own.name().to_owned(), by: "the policy of another manifest" });
            }
            self.own.push(own);
        }
        Ok(self)
    }
}

impl MakerFactory for PolicyStage {
    fn role(&self) -> Role {
        Role::Policy
    }

    fn compute_class(&self) -> String {
        format!("policy {}", self.abilities().policy_model)
    }

    fn abilities(&self) -> Abilities {
        let mut models = DigestWriter::new();
        for learned in Learned::ALL {
            let file = learned.weights_file(&self.weights);
            models.digest(&std::fs::read(file).map_or(Digest::default(), |bytes| Digest::of(&bytes)));
        }
        for own in &self.own {
            models.digest(own.digest());
        }
        Abilities { policy_model: models.finish(), ..Abilities::default() }
    }

    fn open(&self, scene: Arc<SceneMessage>) -> Result<Box<dyn Maker>, Fault> {
        let name = scene.spec.policy.as_str();
        let guest = if Anchor::from_name(name) == Some(Anchor::Expert) {
            let config = SimConfig::of_episode(&scene.spec).map_err(|error| bad("bad_settings", &error))?;
            Guest::Inside(Box::new(Expert::new(config)))
        } else if let Some(own) = self.own.iter().find(|own| own.name() == name) {
            Guest::Inside(Box::new(own.clone()))
        } else if is_builtin(name) {
            let needs = Builtin { weights: Some(self.weights.clone()) };
            Guest::Inside(ds_policy::builtin(name, &needs).map_err(|error| bad("no_policy", &error))?)
        } else {
            let outside = self.outside.as_ref().ok_or_else(|| {
                Fault::policy("policy_unknown", format!("{name:?} is not built in and no policy bus is open"))
            })?;
            Guest::External(Box::new(External::attach(Arc::clone(outside), &scene)?))
        };
        if scene.spec.wall_clock && matches!(guest, Guest::Inside(_)) {
            let detail =
                format!("{name:?} runs inside: only a policy that connects is given the time of the wall clock");
            return Err(Fault::deterministic("bad_settings", detail));
        }
        Ok(Box::new(Hosting { scene, guest, told: None }))
    }
}

enum Guest {
    Inside(Box<dyn Policy>),
    External(Box<External>),
}

struct Hosting {
    scene: Arc<SceneMessage>,
    guest: Guest,
    /// The shape of the context of the first answer, empty if it had none.
    told: Option<Vec<u32>>,
}

impl Hosting {
    fn observation(&self, last: Tick, inputs: &Inputs) -> Result<(Observation, Vec<EgoState>), Fault> {
        let spec = &self.scene.spec;
        let (first, shown) = spec.seen_at(last);
        let cameras = self.scene.scene.cameras.clone();
        let mut frames = Vec::new();
        for (index, _) in (0u16..).zip(&cameras) {
            let mut seen = Vec::new();
            for tick in first.to(shown) {
                seen.push(inputs.decode::<Frame>(Slot::of_camera(Topic::Frame, tick.0, index))?.image);
            }
            frames.push(seen);
        }
        let mut egos = Vec::new();
        for tick in first.to(last) {
            egos.push(inputs.decode::<Ego>(Slot::new(Topic::Ego, tick.0))?);
        }
        let now = egos.last().cloned().ok_or_else(|| Fault::deterministic("missing_input", "no ego state is due"))?;
        // Odometry is not delayed with the frames: as many states as frames, up to now.
        let states: Vec<_> = egos.iter().map(|ego| ego.estimate).skip((last.0 - shown.0) as usize).collect();
        let observation = Observation {
            frames,
            cameras,
            ego: EgoView::of(&states),
            command: now.command,
            stamps: first.to(shown).map(|tick| SimTime::at(tick, self.scene.scene.dt)).collect(),
            horizon_ticks: spec.horizon,
            dt: self.scene.scene.dt,
            draw: Draws::new(&spec.draw_key(), "policy", &[u64::from(last.0)]),
        };
        Ok((observation, states))
    }

    /// Refuses an answer whose context has another size than the first one's: features of one drive are compared.
    fn steady(&mut self, answer: &Plan) -> Result<(), Fault> {
        let shape = answer.context.as_ref().map_or(Vec::new(), |context| context.shape.clone());
        let first = self.told.get_or_insert_with(|| shape.clone());
        if *first == shape {
            return Ok(());
        }
        let says = |shape: &[u32]| if shape.is_empty() { "absent".to_owned() } else { format!("{shape:?}") };
        let detail = format!("plan.context is {}, in the first answer {}", says(&shape), says(first));
        Err(Fault::policy(Fault::PLAN_REFUSED, detail))
    }

    /// Returns the world as a policy sees it that sees it live.
    fn live(&self, now: Tick, inputs: &Inputs) -> Result<Option<Live>, Fault> {
        let Some((first, last)) = self.scene.spec.witnessed_at(now) else { return Ok(None) };
        let mut live = Live::default();
        for tick in first.to(last) {
            let world: World = inputs.decode(Slot::new(Topic::World, tick.0))?;
            live.snapshot = world.snapshot.unwrap_or_default();
            live.states.push(world.state);
        }
        Ok(Some(live))
    }
}

impl Maker for Hosting {
    fn restore(&mut self, _order: &Advance, _inputs: &Inputs) -> Result<(), Fault> {
        Ok(())
    }

    fn work(&mut self, order: &Advance, inputs: &Inputs) -> Result<Vec<Output>, Fault> {
        if !order.plan_due {
            return Ok(Vec::new());
        }
        let (observation, states) = self.observation(order.last, inputs)?;
        let live = self.live(order.last, inputs)?;
        let answer = match &mut self.guest {
            Guest::Inside(policy) => {
                let ego = states.last().copied().unwrap_or_default();
                let view = PrivilegedView { scene: Arc::clone(&self.scene.scene), tick: order.last, ego, live };
                let privileged = policy.privileged().then_some(&view);
                let answer = policy.plan(&observation, privileged);
                answer.map(to_plan).map_err(|error| Fault::policy("policy_error", chain(&error)))?
            }
            Guest::External(policy) => {
                policy.plan(&observation, &states, SimTime::at(order.last, self.scene.scene.dt))?
            }
        };
        self.steady(&answer)?;
        let plan = Plan { observed: answer.observed.or(observation.stamps.last().copied()), ..answer };
        Ok(vec![output(Slot::new(Topic::Plan, order.iteration), order.last, &plan)])
    }
}

/// A context that is larger than a plan may carry stays behind.
fn to_plan(answer: PolicyAnswer) -> Plan {
    let PolicyAnswer { trajectory, proposals, context } = answer;
    let tokens = context.map(|context| context.tokens).filter(|tokens| tokens.values().len() <= MAX_CONTEXT);
    #[expect(clippy::cast_possible_truncation, reason = "sides of at most so many numbers")]
    let context = tokens.map(|tokens| Tensor {
        shape: tokens.shape().iter().map(|side| *side as u32).collect(),
        values: tokens.into_values(),
    });
    Plan { trajectory, proposals, observed: None, answered: None, context }
}
