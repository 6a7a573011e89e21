//! The outside bus, where policies are guests: a session of its own that no stage shares.
//!
//! The bridge begins a session under a random name, puts what the policy may see and takes what it answers. Access is
//! denied by default: a guest may subscribe to what bridges put for its policy and put answers, nothing else; it cannot
//! subscribe to `**`, query, or put on foreign keys. Longer messages than the contract allows are filtered by the link.

use std::io::Read;
use std::sync::Arc;

use bytes::Bytes;
use ds_space::InstanceId;
use ds_wire::WireError;
use ds_wire::policy::{
    MAX_ANSWER_BYTES, MAX_OBSERVATION_BYTES, Observation, PolicyGoodbye, PolicyHello, PolicyMessage, PolicyPlan,
    SessionGoodbye, SessionHello,
};
use zenoh::bytes::ZBytes;
use zenoh::pubsub::Subscriber;
use zenoh::qos::CongestionControl;

use crate::access::TlsFiles;
use crate::counters::{Counters, count};
use crate::error::{BusError, zenoh};
use crate::keys::{Key, Leaf, sessions_of};
use crate::payload::bytes_of;
use crate::queue::Queue;
use crate::settings::{BusSettings, Mode};

/// Messages from one policy that wait to be read.
const QUEUE: usize = 16;

/// How a bridge opens its outside.
#[derive(Debug, Clone, PartialEq)]
pub struct PolicyBusSettings {
    /// The policy that may connect; its guests subscribe under this name.
    pub policy: InstanceId,
    /// Endpoints to listen on; TCP port 0 takes a free one.
    pub listen: Vec<String>,
    /// Routers to connect to, where access is enforced there; usually none.
    pub connect: Vec<String>,
    /// Files for `tls/…` endpoints: guests then need a certificate whose common name is the policy's.
    pub tls: Option<TlsFiles>,
}

/// The outside of a bridge.
#[derive(Clone)]
pub struct PolicyBus {
    zenoh: zenoh::Session,
    settings: Arc<PolicyBusSettings>,
    counters: Arc<Counters>,
}

impl std::fmt::Debug for PolicyBus {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PolicyBus").field("settings", &self.settings).finish_non_exhaustive()
    }
}

/// What a policy says to the bridge.
#[derive(Debug, Clone, PartialEq)]
pub enum FromPolicy {
    /// It is there.
    Ready(PolicyHello),
    /// Its answer.
    Plan(PolicyPlan),
    /// It ends the session.
    Leave(PolicyGoodbye),
}

/// What the bridge says to a policy.
#[derive(Debug, Clone, PartialEq)]
pub enum FromBridge {
    /// A session begins.
    Hello(SessionHello),
    /// What it sees.
    Observation(Box<Observation>),
    /// The session is over.
    Goodbye(SessionGoodbye),
}

impl FromPolicy {
    fn parts(&self) -> (Leaf, Bytes) {
        match self {
            Self::Ready(message) => (Leaf::Ready, message.to_bytes()),
            Self::Plan(message) => (Leaf::Plan, message.to_bytes()),
            Self::Leave(message) => (Leaf::Leave, message.to_bytes()),
        }
    }

    fn read(leaf: Leaf, bytes: &[u8]) -> Option<Result<Self, WireError>> {
        match leaf {
            Leaf::Ready => Some(PolicyHello::from_bytes(bytes).map(Self::Ready)),
            Leaf::Plan => Some(PolicyPlan::from_bytes(bytes).map(Self::Plan)),
            Leaf::Leave => Some(PolicyGoodbye::from_bytes(bytes).map(Self::Leave)),
            Leaf::Hello | Leaf::Observation | Leaf::Goodbye => None,
        }
    }
}

impl FromBridge {
    fn parts(&self) -> (Leaf, Bytes) {
        match self {
            Self::Hello(message) => (Leaf::Hello, message.to_bytes()),
            Self::Observation(message) => (Leaf::Observation, message.to_bytes()),
            Self::Goodbye(message) => (Leaf::Goodbye, message.to_bytes()),
        }
    }

    fn read(leaf: Leaf, bytes: &[u8]) -> Option<Result<Self, WireError>> {
        match leaf {
            Leaf::Hello => Some(SessionHello::from_bytes(bytes).map(Self::Hello)),
            Leaf::Observation => Some(Observation::from_bytes(bytes).map(|seen| Self::Observation(Box::new(seen)))),
            Leaf::Goodbye => Some(SessionGoodbye::from_bytes(bytes).map(Self::Goodbye)),
            Leaf::Ready | Leaf::Plan | Leaf::Leave => None,
        }
    }
}

impl PolicyBus {
    /// Opens the outside of a bridge: a router that lets in guests of one policy.
    ///
    /// # Errors
    /// If a setting is refused or an endpoint cannot be opened.
    pub async fn open(settings: &PolicyBusSettings) -> Result<Self, BusError> {
        let mode = if settings.listen.is_empty() && settings.connect.is_empty() { Mode::Peer } else { Mode::Router };
        let (listen, connect) = (settings.listen.clone(), settings.connect.clone());
        let tls = settings.tls.clone();
        let bus = BusSettings { mode, listen, connect, tls, ..BusSettings::default() }.resolved()?;
        let mut config = bus.config()?;
        for (key, value) in
            [("access_control", access(&settings.policy, settings.tls.is_some())), ("low_pass_filter", size_limit())]
        {
            config.insert_json5(key, &value.to_string()).map_err(zenoh("restrict access"))?;
        }
        let session = zenoh::open(config).await.map_err(zenoh("open the policies' session"))?;
        let settings = Arc::new(PolicyBusSettings { listen: bus.listen, ..settings.clone() });
        Ok(Self { zenoh: session, settings, counters: Arc::new(Counters::default()) })
    }

    /// Returns the endpoints that it listens on, ports filled in.
    #[must_use]
    pub fn listens(&self) -> &[String] {
        &self.settings.listen
    }

    /// Returns what it has done and lost.
    #[must_use]
    pub fn counters(&self) -> &Counters {
        &self.counters
    }

    /// Begins a session under a random name.
    ///
    /// # Errors
    /// If the system gives no random bytes or the bus is closed.
    pub async fn begin(&self) -> Result<PolicySession, BusError> {
        let session = random_name()?;
        let queue = Queue::new(Leaf::FROM_POLICY.len(), QUEUE);
        let mut subscribers = Vec::new();
        for (lane, leaf) in Leaf::FROM_POLICY.into_iter().enumerate() {
            let policy = self.settings.policy.clone();
            let key = Key::Policy { policy, session: session.clone(), leaf }.to_string();
            let (offered, counters) = (queue.clone(), Arc::clone(&self.counters));
            let enqueue = move |sample: zenoh::sample::Sample| {
                count(&counters.received);
                if !offered.offer(lane, (leaf, sample.payload().clone())) {
                    count(&counters.dropped);
                }
            };
            subscribers
                .push(self.zenoh.declare_subscriber(key).callback(enqueue).await.map_err(zenoh("begin a session"))?);
        }
        Ok(PolicySession { bus: self.clone(), session, queue, _subscribers: subscribers })
    }

    /// Closes the outside.
    ///
    /// # Errors
    /// If Zenoh does not close in order.
    pub async fn close(&self) -> Result<(), BusError> {
        self.zenoh.close().await.map_err(zenoh("close the policies' session"))
    }
}

/// A bridge's session with one policy; ends its subscriptions when dropped.
pub struct PolicySession {
    bus: PolicyBus,
    session: InstanceId,
    queue: Queue<(Leaf, ZBytes)>,
    _subscribers: Vec<Subscriber<()>>,
}

impl std::fmt::Debug for PolicySession {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PolicySession").field("session", &self.session).finish_non_exhaustive()
    }
}

impl PolicySession {
    /// Returns the session's random name.
    #[must_use]
    pub fn name(&self) -> &InstanceId {
        &self.session
    }

    /// Says something to the policy. Success says nothing about arrival: repeat it until it is answered.
    ///
    /// # Errors
    /// If the bus is closed.
    pub async fn put(&self, message: &FromBridge) -> Result<(), BusError> {
        let (leaf, bytes) = message.parts();
        let (policy, session) = (self.bus.settings.policy.clone(), self.session.clone());
        count(&self.bus.counters.pushes);
        put(&self.bus.zenoh, &Key::Policy { policy, session, leaf }, bytes).await
    }

    /// Waits for what the policy says; what it says wrongly comes as the error that names the field.
    ///
    /// # Errors
    /// [`WireError`] where a message of the policy is refused.
    pub async fn recv(&mut self) -> Result<FromPolicy, WireError> {
        loop {
            let (leaf, payload) = self.queue.wait().await;
            if let Some(read) = read_bounded(leaf, payload, MAX_ANSWER_BYTES, FromPolicy::read) {
                return read;
            }
        }
    }
}

/// A policy's end of the outside bus, as another process would have it.
pub struct PolicyGuest {
    zenoh: zenoh::Session,
    policy: InstanceId,
    queue: Queue<(InstanceId, Leaf, ZBytes)>,
    _subscribers: Vec<Subscriber<()>>,
}

impl std::fmt::Debug for PolicyGuest {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PolicyGuest").field("policy", &self.policy).finish_non_exhaustive()
    }
}

impl PolicyGuest {
    /// Connects to a bridge as a policy of some name.
    ///
    /// # Errors
    /// If the endpoint cannot be reached.
    pub async fn connect(policy: &InstanceId, endpoint: &str, tls: Option<TlsFiles>) -> Result<Self, BusError> {
        let connect = vec![endpoint.to_owned()];
        let settings = BusSettings { mode: Mode::Client, connect, tls, ..BusSettings::default() }.resolved()?;
        let session = zenoh::open(settings.config()?).await.map_err(zenoh("reach the bridge"))?;
        let queue = Queue::new(Leaf::FROM_BRIDGE.len(), QUEUE);
        let mut subscribers = Vec::new();
        for (lane, leaf) in Leaf::FROM_BRIDGE.into_iter().enumerate() {
            let offered = queue.clone();
            let enqueue = move |sample: zenoh::sample::Sample| {
                if let Ok(Key::Policy { session, .. }) = Key::parse(sample.key_expr().as_str()) {
                    offered.offer(lane, (session, leaf, sample.payload().clone()));
                }
            };
            let declared = session.declare_subscriber(sessions_of(policy, leaf)).callback(enqueue);
            subscribers.push(declared.await.map_err(zenoh("listen to the bridge"))?);
        }
        Ok(Self { zenoh: session, policy: policy.clone(), queue, _subscribers: subscribers })
    }

    /// Waits for what a bridge says, in whichever session.
    ///
    /// # Errors
    /// [`WireError`] where a message of the bridge is refused.
    pub async fn recv(&mut self) -> Result<(InstanceId, FromBridge), WireError> {
        loop {
            let (session, leaf, payload) = self.queue.wait().await;
            if let Some(read) = read_bounded(leaf, payload, MAX_OBSERVATION_BYTES, FromBridge::read) {
                return read.map(|message| (session, message));
            }
        }
    }

    /// Says something to the bridge of a session.
    ///
    /// # Errors
    /// If the connection is closed.
    pub async fn put(&self, session: &InstanceId, message: &FromPolicy) -> Result<(), BusError> {
        let (leaf, bytes) = message.parts();
        put(&self.zenoh, &Key::Policy { policy: self.policy.clone(), session: session.clone(), leaf }, bytes).await
    }
}

/// Reads what a leaf holds; `None` for leaves of the other side.
type Reader<T> = fn(Leaf, &[u8]) -> Option<Result<T, WireError>>;

/// Reads a payload that is not longer than allowed; a longer one is refused before it is copied together.
fn read_bounded<T>(leaf: Leaf, payload: ZBytes, most: usize, read: Reader<T>) -> Option<Result<T, WireError>> {
    if payload.len() > most {
        return Some(Err(WireError::TooLong { message: leaf.name(), bytes: payload.len(), most }));
    }
    read(leaf, &bytes_of(payload))
}

async fn put(session: &zenoh::Session, key: &Key, bytes: Bytes) -> Result<(), BusError> {
    let put = session.put(key.to_string(), bytes).congestion_control(CongestionControl::Drop).express(true);
    put.await.map_err(zenoh("talk to the other side"))
}

/// Returns 128 random bits as a name that cannot be guessed.
fn random_name() -> Result<InstanceId, BusError> {
    let failed = |source| BusError::System { doing: "draw a random session name", source };
    let mut bits = [0_u8; 16];
    std::fs::File::open("/dev/urandom").and_then(|mut file| file.read_exact(&mut bits)).map_err(failed)?;
    let text: String = bits.iter().map(|byte| format!("{byte:02x}")).collect();
    Ok(InstanceId::new(&text).expect("hexadecimal digits are an id"))
}

/// What a guest may do: listen to the bridge and answer it.
fn access(policy: &InstanceId, certified: bool) -> serde_json::Value {
    let guests = match certified {
        true => serde_json::json!({"id": "guests", "cert_common_names": [policy.to_string()]}),
        false => serde_json::json!({"id": "guests"}),
    };
    let keys = |leaves: [Leaf; 3]| leaves.map(|leaf| sessions_of(policy, leaf)).to_vec();
    let rule = |id: &str, messages: [&str; 1], flow: &str, leaves| {
        serde_json::json!({
            "id": id, "permission": "allow", "messages": messages, "flows": [flow], "key_exprs": keys(leaves),
        })
    };
    serde_json::json!({
        "enabled": true,
        "default_permission": "deny",
        "rules": [
            rule("listen", ["declare_subscriber"], "ingress", Leaf::FROM_BRIDGE),
            rule("tell", ["put"], "egress", Leaf::FROM_BRIDGE),
            rule("answer", ["put"], "ingress", Leaf::FROM_POLICY),
            rule("await", ["declare_subscriber"], "egress", Leaf::FROM_POLICY),
        ],
        "subjects": [guests],
        "policies": [{"rules": ["listen", "tell", "answer", "await"], "subjects": ["guests"]}],
    })
}

/// Longer answers are dropped by the link.
fn size_limit() -> serde_json::Value {
    serde_json::json!([
        {"id": "answers", "messages": ["put"], "flows": ["ingress"], "key_exprs": ["**"], "size_limit": MAX_ANSWER_BYTES},
    ])
}
