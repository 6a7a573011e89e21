//! Recordings: topics → MCAP file, MCAP file → topics, digests, pictures, and what the process `viewer` is handed.
//!
//! A recording is the journal of one attempt. It grows as `….mcap.partial`, closed and synced at every commit, and is
//! renamed when its completeness record is written. A damaged or incomplete file is refused, or read up to its last commit
//! by who asks for that; it says where it breaks and what is missing.
//! Times are simulation time; the wall clock never enters. Transport and scores are not made here.

pub mod channel;
mod checksum;
pub mod completeness;
pub mod digests;
pub mod error;
mod linear;
mod message;
pub mod pictures;
pub mod recorder;
pub mod recording;
pub mod scan;
mod schema;
pub mod vehicle_log;
pub mod viewing;

pub use channel::ChannelKey;
pub use completeness::{Completeness, Missing};
pub use digests::{Digests, StreamDigests};
pub use error::RecordError;
pub use message::Body;
pub use pictures::{Moment, Reel};
pub use recorder::{Outcome, Recorder, Resumed, damage, partial_path, thin};
pub use recording::{Recording, Tail};
