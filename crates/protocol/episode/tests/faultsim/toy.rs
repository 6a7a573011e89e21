//! Toy stages whose work is a hash chain: any lost, repeated, swapped or wrongly restored input changes every later
//! digest. Bodies are the chain states; orders and outlines travel as indices into a table.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Mutex;

use bytes::Bytes;
use ds_episode::stage::Output;
use ds_episode::{Codec, CodecError, Fault, Outline, due};
use ds_space::{Digest, DigestWriter, PoseSe2, SimTime, Tick};
use ds_topic::{Advance, Envelope, Event, Motion, Plan, Role, Slot, Topic};
use ds_world::{Trajectory, TrajectoryPoint};

/// The body of the toy scene.
pub(crate) const SCENE: &[u8] = b"scene";
/// What a plan that tells of the wall clock ends with.
pub(crate) const LATE: &[u8] = b"late";

/// Keeps outline and orders in memory; bodies are indices.
pub(crate) struct ToyCodec {
    pub outline: Outline,
    orders: Mutex<Vec<Advance>>,
}

impl ToyCodec {
    pub(crate) fn new(outline: Outline) -> Self {
        Self { outline, orders: Mutex::new(Vec::new()) }
    }
}

fn body_digest(body: &Bytes) -> Result<Digest, CodecError> {
    let bytes: [u8; 32] =
        body.as_ref().try_into().map_err(|_| CodecError(format!("body has {} bytes instead of 32", body.len())))?;
    Ok(Digest(bytes))
}

impl Codec for ToyCodec {
    fn outline(&self, scene: &Bytes) -> Result<Outline, CodecError> {
        if scene == SCENE { Ok(self.outline.clone()) } else { Err(CodecError(format!("scene is {scene:?}"))) }
    }

    fn encode_advance(&self, advance: &Advance) -> Bytes {
        let mut orders = self.orders.lock().expect("no test thread panics while holding it");
        orders.push(advance.clone());
        Bytes::copy_from_slice(&(orders.len() as u64 - 1).to_le_bytes())
    }

    fn decode_advance(&self, body: &Bytes) -> Result<Advance, CodecError> {
        let index: [u8; 8] = body.as_ref().try_into().map_err(|_| CodecError(format!("order is {body:?}")))?;
        let orders = self.orders.lock().expect("no test thread panics while holding it");
        let index = u64::from_le_bytes(index) as usize;
        orders.get(index).cloned().ok_or_else(|| CodecError(format!("order {index} is unknown")))
    }

    fn decode_plan(&self, body: &Bytes) -> Result<Plan, CodecError> {
        // A body with a tail tells of the wall clock.
        let answered = body.ends_with(LATE).then(Default::default);
        let digest = body_digest(&body.slice(..body.len() - answered.as_ref().map_or(0, |_| LATE.len())))?;
        let x = u32::from_le_bytes([digest.0[0], digest.0[1], digest.0[2], digest.0[3]]);
        let mut pose = PoseSe2::default();
        pose.position.x = f64::from(x) * 1e-7;
        let trajectory = Trajectory::new(vec![TrajectoryPoint { after: SimTime(1), pose }])
            .map_err(|error| CodecError(error.to_string()))?;
        Ok(Plan { trajectory, proposals: Vec::new(), observed: None, answered, context: None })
    }

    fn encode_event(&self, event: &Event) -> Bytes {
        Bytes::copy_from_slice(event.reason.as_bytes())
    }
}

/// Hashes a purpose and digests.
pub(crate) fn hash(purpose: &str, parts: &[Digest], numbers: &[u32]) -> Digest {
    let mut writer = DigestWriter::new();
    writer.text(purpose);
    for part in parts {
        writer.digest(part);
    }
    for number in numbers {
        writer.u32(*number);
    }
    writer.finish()
}

/// The state of one camera's toy video model.
#[derive(Debug, Clone, Default)]
struct Chain {
    state: Digest,
    pending: Vec<Digest>,
}

/// A maker of any role.
#[derive(Debug, Clone)]
pub(crate) struct ToyMaker {
    role: Role,
    outline: Outline,
    /// sim-server: the state after the last tick.
    world: Digest,
    /// vdm-worker: one chain per camera.
    chains: Vec<Chain>,
}

impl ToyMaker {
    pub(crate) fn new(role: Role, outline: Outline) -> Self {
        let chains = vec![Chain::default(); usize::from(outline.cameras)];
        Self { role, outline, world: hash("initial", &[], &[]), chains }
    }

    /// Makes the state before an order from the journal alone.
    pub(crate) fn restore(&mut self, inputs: &BTreeMap<Slot, Envelope>, advance: &Advance) -> Result<(), Fault> {
        *self = Self::new(self.role, self.outline.clone());
        if advance.iteration == 0 {
            return Ok(());
        }
        let before = advance.first.0 - 1;
        if self.role == Role::Sim {
            let world = inputs.get(&Slot::new(Topic::World, before)).expect("the stage gathered it");
            self.world = body_digest(&world.body).map_err(|error| Fault::deterministic("snapshot", error))?;
        }
        if self.role != Role::Video || self.outline.spec.chunk_ticks == 0 {
            return Ok(());
        }
        for camera in 0..self.outline.cameras {
            let chain = &mut self.chains[usize::from(camera)];
            let chunks = self.outline.spec.chunks_of(advance.iteration).start;
            for chunk in 0..chunks {
                let entry = inputs.get(&Slot::of_camera(Topic::Cache, chunk, camera)).expect("the stage gathered it");
                let (previous, next) = entry.body.split_at(32);
                if previous != chain.state.0 {
                    return Err(Fault::deterministic(Fault::RECOVERY_MISMATCH, entry.header.slot));
                }
                chain.state = Digest(next.try_into().expect("an entry has 64 bytes"));
            }
            let committed = (chunks - 1) * self.outline.spec.chunk_ticks;
            for tick in committed + 1..=before {
                let layout = inputs.get(&Slot::of_camera(Topic::Layout, tick, camera)).expect("the stage gathered it");
                chain.pending.push(layout.header.content);
            }
        }
        Ok(())
    }

    /// Makes what an order makes due.
    pub(crate) fn work(&mut self, advance: &Advance, inputs: &BTreeMap<Slot, Envelope>) -> Vec<Output> {
        match self.role {
            Role::Sim => self.step(advance),
            Role::Layout => due::outputs(&self.outline, Role::Layout, advance)
                .into_iter()
                .map(|slot| {
                    let world = inputs[&Slot::new(Topic::World, slot.index)].header.content;
                    output(slot, Tick(slot.index), hash("layout", &[world], &[u32::from(slot.camera)]))
                })
                .collect(),
            Role::Video => self.generate(advance, inputs),
            Role::Policy if advance.plan_due => {
                let seen: Vec<Digest> = inputs.values().map(|message| message.header.content).collect();
                let slot = Slot::new(Topic::Plan, advance.iteration);
                vec![output(slot, advance.last, hash("plan", &seen, &[]))]
            }
            Role::Policy => Vec::new(),
        }
    }

    fn step(&mut self, advance: &Advance) -> Vec<Output> {
        let mut outputs = Vec::new();
        for tick in advance.first.to(advance.last) {
            let by = match &advance.motion {
                Motion::Initial => 0.0,
                Motion::Log => 1.0,
                Motion::Plan(plan) => 2.0 + plan.points()[0].pose.position.x,
                Motion::Choice(proposals) => 3.0 + proposals.len() as f64,
            };
            let command = DigestWriter::new().f64(by).finish();
            self.world = hash("step", &[self.world, command], &[tick.0]);
            let world = Output {
                slot: Slot::new(Topic::World, tick.0),
                tick,
                content: hash("world", &[self.world], &[]),
                body: Bytes::copy_from_slice(&self.world.0),
            };
            outputs.push(world);
            outputs.push(output(Slot::new(Topic::Ego, tick.0), tick, hash("ego", &[self.world], &[])));
        }
        outputs
    }

    fn generate(&mut self, advance: &Advance, inputs: &BTreeMap<Slot, Envelope>) -> Vec<Output> {
        let spec = &self.outline.spec;
        let mut outputs = VecDeque::new();
        for tick in advance.first.to(advance.last) {
            for camera in 0..self.outline.cameras {
                let chain = &mut self.chains[usize::from(camera)];
                chain.pending.push(inputs[&Slot::of_camera(Topic::Layout, tick.0, camera)].header.content);
                let mut parts = vec![chain.state];
                parts.extend(&chain.pending);
                if spec.observation.needs_world() {
                    parts = vec![inputs[&Slot::new(Topic::World, tick.0)].header.content];
                }
                let frame = hash("frame", &parts, &[u32::from(camera)]);
                outputs.push_back(output(Slot::of_camera(Topic::Frame, tick.0, camera), tick, frame));
                if spec.chunk_ticks == 0 {
                    chain.pending.clear();
                } else if tick.0 % spec.chunk_ticks == 0 {
                    let previous = chain.state;
                    chain.state = hash("chunk", &parts, &[]);
                    chain.pending.clear();
                    let slot = Slot::of_camera(Topic::Cache, tick.0 / spec.chunk_ticks, camera);
                    let body = Bytes::from([previous.0, chain.state.0].concat());
                    outputs.push_back(Output { slot, tick, content: chain.state, body });
                }
            }
        }
        outputs.into()
    }
}

fn output(slot: Slot, tick: Tick, content: Digest) -> Output {
    Output { slot, tick, content, body: Bytes::copy_from_slice(&content.0) }
}
