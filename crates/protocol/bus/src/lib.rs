//! The bus: Zenoh keys, pushes, pulls and liveliness of an episode's messages; and the outside bus of the policies.
//!
//! A push may be lost and nothing waits for it; a pull asks one holder for one slot and waits for a stated time.
//! Callbacks only enqueue, queues are bounded and count what they drop. Every handle gives up what it declared when it
//! is dropped. Bodies are never decoded here. Liveliness speeds up suspicion; it proves nothing.

pub mod access;
pub mod alive;
pub mod counters;
pub mod error;
pub mod keys;
mod payload;
pub mod policy_bus;
mod ports;
pub mod pulls;
mod queue;
pub mod session;
pub mod settings;
pub mod subscription;

pub use access::{STATIONS, TlsFiles};
pub use alive::{AliveToken, AliveWatch};
pub use counters::Counters;
pub use error::BusError;
pub use keys::{Holder, Key, KeyError};
pub use policy_bus::{FromBridge, FromPolicy, PolicyBus, PolicyBusSettings, PolicyGuest, PolicySession};
pub use ports::free_port;
pub use pulls::{Ask, Asks};
pub use session::BusSession;
pub use settings::{BusSettings, Mode};
pub use subscription::{Subscription, topics_of};
