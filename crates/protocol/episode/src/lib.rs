//! The closed loop as state machines: events in, actions out. Knows no bus, no clock and no async; time enters each
//! call as [`Millis`] of the caller's own monotonic clock, and bodies pass through undecoded (see [`Codec`]).
//!
//! - [`stage::Stage`]: one assignment (episode, attempt, role, epoch) of a worker; a thin service feeds it what the bus,
//!   the control plane and its maker say, and carries out what it answers.
//! - [`driver::Driver`]: one attempt at an episode, on the orchestrator's side: work orders, journal commits, faults.
//! - [`fleet::Fleet`]: who is there and who holds which role: leases, epochs, terms, over a [`fleet::Ledger`].
//! - [`due`]: which messages an order makes due, as functions of the settings and the order alone.
//!
//! # Wiring a stage
//! On `assign` make `Stage::new(assignment, timing, codec, now)`, its lease counted from when the latest heartbeat (or
//! hello) that the orchestrator had heard was sent, never from when `assign` came: it may have waited in a queue. Then
//! call `handle(now, event)` with: every push that arrives under the episode's keys ([`stage::Event::Message`]), every
//! outcome of a pull, also "nothing" (`Pulled`), every query on the own queryable (`Asked`), the maker's outcomes
//! (`Restored`, `Worked`), every `renew` (`LeaseRenewed`, with `until` = the own clock when the heartbeat it answers was
//! *sent*, plus the lease), `Drain` once, and `Now` at least every `pull_after / 2`. A restart of the control stream
//! drops all stages before the new hello.
//!
//! # Wiring a driver
//! `Driver::new` or `Driver::resume`, then `Start`. `Want` → [`fleet::Fleet::assign`] → `Assigned`, or `Unassignable`
//! where the refusal is lasting; a passing refusal needs no answer, the driver asks again. `Commit` → append the messages
//! to the journal, sync, then `Journalled`; `Lookup` → answer the query from the journal; `Observe` → score; a `Score`
//! body comes back as `Scored`. A reply to a pull of `advance[n]` may hold a later order than n; nothing else may differ
//! from the slot that was asked for. The journal refuses appends of a lower term than the ledger's.

pub mod clock;
pub mod codec;
pub mod counters;
pub mod driver;
pub mod due;
pub mod fault;
pub mod fleet;
mod pulls;
pub mod stage;
pub mod timing;

pub use clock::Millis;
pub use codec::{Codec, CodecError, Outline};
pub use counters::Counters;
pub use driver::Driver;
pub use fault::{Fault, FaultClass};
pub use fleet::Fleet;
pub use stage::Stage;
pub use timing::Timing;
