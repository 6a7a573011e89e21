//! What a service's own code looks like to the protocol: a maker turns the inputs of a work order into its outputs.
//!
//! Makers run on threads of their own, one per episode; they know no bus, no lease and no clock.

use std::collections::BTreeMap;
use std::sync::Arc;

pub use ds_episode::Fault;
pub use ds_episode::stage::Output;
use ds_space::{Digest, Tick};
use ds_topic::{Advance, Envelope, Role, SceneMessage, Slot};
use ds_wire::Body;

/// The work of one role in one episode.
pub trait Maker: Send {
    /// Makes the state as it was before `order`, from the scene and the restore inputs alone.
    ///
    /// # Errors
    /// A named fault, such as `recovery_mismatch`.
    fn restore(&mut self, order: &Advance, inputs: &Inputs) -> Result<(), Fault>;

    /// Makes all outputs due.
    ///
    /// # Errors
    /// A named fault; the state counts as lost then.
    fn work(&mut self, order: &Advance, inputs: &Inputs) -> Result<Vec<Output>, Fault>;
}

/// Opens a maker for each episode that an instance is given.
pub trait MakerFactory: Send + Sync + 'static {
    /// Returns the role that the makers fill.
    fn role(&self) -> Role;

    /// Returns what decides the bits of the results: back end, weights, threads. The binary's own version is added.
    fn compute_class(&self) -> String;

    /// Returns what the orchestrator must know to give out work, such as the video model's digest.
    fn abilities(&self) -> Abilities {
        Abilities::default()
    }

    /// Prepares an episode.
    ///
    /// # Errors
    /// A named fault.
    fn open(&self, scene: Arc<SceneMessage>) -> Result<Box<dyn Maker>, Fault>;
}

/// What an instance can do besides filling its role.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Abilities {
    /// Digest of the video model; zero without one.
    pub video_model: Digest,
    /// Digests of the models of the other sources that it generates frames for, by the source's name.
    pub source_models: Vec<(&'static str, Digest)>,
    /// Ticks per chunk of the video model; 0 without one.
    pub chunk_ticks: u32,
    /// Ticks before the last committed one whose layouts the video model remembers.
    pub layout_memory_ticks: u32,
    /// Whether the video model goes on from the geometry of layouts.
    pub layout_geometry: bool,
    /// Width and height of the video model's frames, in pixels; 0 without one.
    pub frame_px: [u32; 2],
    /// Digest of the camera policy; zero without one.
    pub policy_model: Digest,
    /// Devices that it sees.
    pub devices: Vec<String>,
    /// Whether it takes a device that another instance holds.
    pub shares_device: bool,
}

/// The messages that an order made due.
#[derive(Debug, Clone, Default)]
pub struct Inputs(pub BTreeMap<Slot, Envelope>);

impl Inputs {
    /// Decodes and checks the message of a slot.
    ///
    /// # Errors
    /// `missing_input` or `bad_message`.
    pub fn decode<B: Body>(&self, slot: Slot) -> Result<B, Fault> {
        let envelope = self.envelope(slot)?;
        let body = B::from_bytes(&envelope.body).map_err(|error| bad(Fault::BAD_MESSAGE, &error))?;
        let found = body.content();
        if found != envelope.header.content {
            let stated = envelope.header.content;
            return Err(Fault::deterministic(Fault::BAD_MESSAGE, format!("{slot} says {stated:?}, holds {found:?}")));
        }
        Ok(body)
    }

    /// Returns the content digest of a slot's message.
    ///
    /// # Errors
    /// `missing_input`.
    pub fn content(&self, slot: Slot) -> Result<Digest, Fault> {
        self.envelope(slot).map(|envelope| envelope.header.content)
    }

    fn envelope(&self, slot: Slot) -> Result<&Envelope, Fault> {
        self.0.get(&slot).ok_or_else(|| Fault::deterministic("missing_input", slot))
    }
}

/// Encodes a body as the output of a slot.
#[must_use]
pub fn output<B: Body>(slot: Slot, tick: Tick, body: &B) -> Output {
    Output { slot, tick, content: body.content(), body: body.to_bytes() }
}

/// Makes a deterministic fault of an error and its sources.
#[must_use]
pub fn bad(name: &str, error: &dyn std::error::Error) -> Fault {
    Fault::deterministic(name, chain(error))
}

/// Returns the text of an error and of all its sources, outermost first.
#[must_use]
pub fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(inner) = source {
        text.push_str(": ");
        text.push_str(&inner.to_string());
        source = inner.source();
    }
    text
}
