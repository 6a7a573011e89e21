//! What every topic carries, as checked values: the vocabulary that the protocol and the wire share.
//!
//! An episode is wholly described by its topics. A message is a [`Header`] and a body; the protocol moves bodies as
//! opaque bytes ([`Envelope`]) and compares them by their content digest, the stages decode them to the values here.

pub mod body;
pub mod diagnosis;
pub mod envelope;
pub mod order;
pub mod slot;
pub mod spec;

pub use body::{
    Answered, Cache, Ego, Event, EventKind, Frame, Layout, LayoutGeometry, Plan, SceneMessage, Score, Verdict, World,
};
pub use diagnosis::{DiagnosedEffect, Diagnosis, GapCell};
pub use envelope::{Envelope, Header, SCHEMA_VERSION};
pub use order::{Advance, Motion, Owner, Role};
pub use slot::{Slot, Topic};
pub use spec::{
    EpisodeSpec, MAX_LAYOUT_MEMORY_TICKS, ObservationSource, ProposalScorer, ReplanAlignment, ScoreProfile,
    SwitchedEffect,
};
