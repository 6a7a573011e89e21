//! The wire: protobuf messages of the topics and services, and checked conversions to and from the values of
//! `ds-topic`.
//!
//! A message is its [`Header`](ds_topic::Header) as field 1 and then the body's fields: [`encode`] and [`split`] move
//! bodies undecoded, [`Body`] turns them into values once, where they are used. What comes from outside is bounded
//! before it is decoded and checked while it is converted; an error names message, field and value. The generated code
//! is committed and compared with `proto/` by a test. No transport here.

pub mod advance;
mod adversary;
pub mod body;
pub mod cache;
pub mod codec;
pub mod control;
pub mod diagnosis;
pub mod ego;
pub mod envelope;
pub mod error;
pub mod event;
mod field;
pub mod geometry;
pub mod image;
mod map;
pub mod plan;
pub mod policy;
pub mod scene;
pub mod score;
mod spec;
mod status;
mod tally;
pub mod world;

pub use body::{Body, verify};
pub use codec::WireCodec;
pub use envelope::{encode, message_name, split};
pub use error::WireError;
pub use status::{Refusal, status};

/// Messages and services of `dreamstream.v1`, generated from `proto/`.
pub mod v1 {
    #![expect(
        missing_docs,
        clippy::too_many_lines,
        reason = "what the generator adds of its own is neither short nor commented"
    )]
    include!("generated/dreamstream.v1.rs");
}

/// Messages of `dreamstream_policy.v1`, the outside contract, generated from `proto/`.
pub mod policy_v1 {
    #![expect(missing_docs, reason = "what the generator adds of its own has no comment in the protos")]
    include!("generated/dreamstream_policy.v1.rs");
}

/// The encoded `FileDescriptorSet` of all packages, for recordings and for gRPC reflection.
pub const DESCRIPTOR_SET: &[u8] = include_bytes!("generated/dreamstream.binpb");
