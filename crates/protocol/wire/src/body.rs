//! The body of each topic as bytes: bounded before decoding, checked while converted, compared with its digest.

use bytes::Bytes;
use ds_space::{Digest, DigestWriter};
use ds_topic::{
    Advance, Cache, Diagnosis, Ego, Envelope, Event, Frame, Layout, Plan, SceneMessage, Score, Topic, World,
};
use prost::Message;

use crate::error::{FieldError, WireError};
use crate::map::{MAX_LANES, MAX_LIGHTS, MAX_LINES};
use crate::tally::{self, Limit};
use crate::{diagnosis, plan, scene, v1, world};

/// The body of a topic.
pub trait Body: Sized {
    /// The topic that carries it.
    const TOPIC: Topic;

    /// Returns the digest over its fields: what a header says as `content`.
    fn content(&self) -> Digest;

    /// Returns its fields in protobuf encoding, without a header.
    fn to_bytes(&self) -> Bytes;

    /// Reads a body without a header.
    ///
    /// # Errors
    /// [`WireError`] names message, field and value.
    fn from_bytes(bytes: &[u8]) -> Result<Self, WireError>;
}

/// Reads the body of a message and compares it with what its header says of it.
///
/// # Errors
/// [`WireError`] if the topic is another, the body is refused, or the digest differs.
pub fn verify<B: Body>(envelope: &Envelope) -> Result<B, WireError> {
    let slot = envelope.header.slot;
    if slot.topic != B::TOPIC {
        return Err(WireError::Topic { slot, wanted: B::TOPIC });
    }
    let body = B::from_bytes(&envelope.body)?;
    let (stated, found) = (envelope.header.content, body.content());
    if stated != found {
        return Err(WireError::Content { slot, stated, found });
    }
    Ok(body)
}

/// Returns the longest body of a topic, in bytes.
#[must_use]
pub const fn max_bytes(topic: Topic) -> usize {
    match topic {
        Topic::Ego | Topic::Event => 8 << 10,
        Topic::Score => 64 << 10,
        Topic::Diagnosis => 256 << 10,
        Topic::Advance | Topic::Plan => 4 << 20,
        Topic::World => 8 << 20,
        Topic::Layout | Topic::Frame => 32 << 20,
        Topic::Scene => 32 << 20,
        Topic::Cache => 16 << 20,
    }
}

const PLAN_LIMITS: &[Limit] = &[
    Limit { path: &[3], field: "proposals", most: plan::MAX_PROPOSALS },
    Limit { path: &[2, 1], field: "trajectory.poses", most: ds_world::trajectory::MAX_POINTS },
    Limit { path: &[3, 1, 1], field: "proposals.trajectory.poses", most: 65_536 },
];
const ADVANCE_LIMITS: &[Limit] = &[
    Limit { path: &[10], field: "owners", most: 4 },
    Limit { path: &[7, 1], field: "plan.poses", most: ds_world::trajectory::MAX_POINTS },
    Limit { path: &[11, 1], field: "choice.proposals", most: plan::MAX_PROPOSALS },
    Limit { path: &[11, 1, 1, 1], field: "choice.proposals.trajectory.poses", most: 65_536 },
];
const WORLD_LIMITS: &[Limit] = &[
    Limit { path: &[5], field: "agents", most: world::MAX_AGENTS },
    Limit { path: &[7], field: "contacts", most: world::MAX_AGENTS },
    Limit { path: &[10], field: "verdict", most: 1 },
    Limit { path: &[11], field: "readings", most: world::MAX_READINGS },
];
const SCORE_LIMITS: &[Limit] = &[Limit { path: &[2], field: "values", most: crate::score::MAX_VALUES }];
const DIAGNOSIS_LIMITS: &[Limit] = &[
    Limit { path: &[8], field: "effects", most: diagnosis::MAX_EFFECTS },
    Limit { path: &[9], field: "cells", most: diagnosis::MAX_CELLS },
    Limit { path: &[9, 2], field: "cells.bins", most: diagnosis::MAX_CELLS * diagnosis::MAX_BINS },
    Limit { path: &[10], field: "differences", most: diagnosis::MAX_DIFFERENCES },
];
const SCENE_LIMITS: &[Limit] = &[
    Limit { path: &[4], field: "first_frames", most: scene::MAX_CAMERAS },
    Limit { path: &[2, 23], field: "spec.effects", most: crate::spec::MAX_EFFECTS },
    Limit { path: &[3, 5, 1], field: "scenario.map.lanes", most: MAX_LANES },
    Limit { path: &[3, 5, 2], field: "scenario.map.junctions", most: MAX_LINES },
    Limit { path: &[3, 5, 3], field: "scenario.map.drivable", most: MAX_LINES },
    Limit { path: &[3, 5, 4], field: "scenario.map.road_edges", most: MAX_LINES },
    Limit { path: &[3, 5, 5], field: "scenario.map.line_markings", most: MAX_LINES },
    Limit { path: &[3, 5, 6], field: "scenario.map.crosswalks", most: MAX_LINES },
    Limit { path: &[3, 5, 7], field: "scenario.map.stop_lines", most: MAX_LANES },
    Limit { path: &[3, 5, 8], field: "scenario.map.traffic_lights", most: MAX_LIGHTS },
    Limit { path: &[3, 5, 9], field: "scenario.map.structures", most: MAX_LINES },
    Limit { path: &[3, 7], field: "scenario.ego_log", most: scene::MAX_TICKS },
    Limit { path: &[3, 9], field: "scenario.tracks", most: world::MAX_AGENTS },
    Limit { path: &[3, 9, 4], field: "scenario.tracks.ticks", most: 1_000_000 },
    Limit { path: &[3, 10], field: "scenario.cameras", most: scene::MAX_CAMERAS },
];

/// Reads a message after bounding its length and the length of its lists.
pub(crate) fn decode<M: Message + Default>(
    message: &'static str,
    bytes: &[u8],
    most: usize,
    limits: &[Limit],
) -> Result<M, WireError> {
    if bytes.len() > most {
        return Err(WireError::TooLong { message, bytes: bytes.len(), most });
    }
    tally::check(message, bytes, limits)?;
    M::decode(bytes).map_err(|error| WireError::Decode { message, problem: error.to_string() })
}

macro_rules! body {
    ($value:ty, $wire:ty, $topic:ident, $name:literal, $limits:expr, $content:expr) => {
        impl Body for $value {
            const TOPIC: Topic = Topic::$topic;

            fn content(&self) -> Digest {
                let content: fn(&Self) -> Digest = $content;
                content(self)
            }

            fn to_bytes(&self) -> Bytes {
                <$wire>::from(self).encode_to_vec().into()
            }

            fn from_bytes(bytes: &[u8]) -> Result<Self, WireError> {
                let message: $wire = decode($name, bytes, max_bytes(Topic::$topic), $limits)?;
                if message.header.is_some() {
                    return Err(FieldError::new("header", "stands in the body a second time").of($name));
                }
                Self::try_from(message).map_err(|error| error.of($name))
            }
        }
    };
}

macro_rules! digested {
    () => {
        |body| {
            let mut writer = DigestWriter::new();
            body.digest_into(&mut writer);
            writer.finish()
        }
    };
}

body!(SceneMessage, v1::Scene, Scene, "scene", SCENE_LIMITS, digested!());
body!(Advance, v1::Advance, Advance, "advance", ADVANCE_LIMITS, Advance::content);
body!(World, v1::World, World, "world", WORLD_LIMITS, digested!());
body!(Ego, v1::Ego, Ego, "ego", &[], digested!());
body!(Layout, v1::Layout, Layout, "layout", &[], digested!());
body!(Frame, v1::Frame, Frame, "frame", &[], digested!());
body!(Plan, v1::Plan, Plan, "plan", PLAN_LIMITS, digested!());
body!(Cache, v1::Cache, Cache, "cache", &[], digested!());
body!(Score, v1::Score, Score, "score", SCORE_LIMITS, digested!());
body!(Event, v1::Event, Event, "event", &[], digested!());
body!(Diagnosis, v1::Diagnosis, Diagnosis, "diagnosis", DIAGNOSIS_LIMITS, digested!());
