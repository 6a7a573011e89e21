//! The one declaration of the bus's keys: made by `Display`, read by `parse`, widened by the functions below.
//!
//! - push: `dreamstream/v1/{episode}/{topic}` and `…/{topic}/{camera}`
//! - pull: `dreamstream/v1/{episode}/pull/{instance}/{topic}/{index}/{camera}`, `@journal` standing for the journal
//! - liveliness: `dreamstream/v1/@alive/{instance}`
//! - policies, outside: `dreamstream-policy/v1/{policy}/{session}/{leaf}`

use std::fmt;

use ds_space::{EpisodeId, InstanceId};
use ds_topic::{Slot, Topic};

const ROOT: &str = "dreamstream/v1";
const POLICY_ROOT: &str = "dreamstream-policy/v1";
// A chunk with '@' is matched by no wildcard and can be no id.
const JOURNAL: &str = "@journal";
const ALIVE: &str = "@alive";
const PULL: &str = "pull";

/// Whom a pull asks.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub enum Holder {
    /// The instance that published.
    Instance(InstanceId),
    /// The orchestrator's journal.
    Journal,
}

impl fmt::Display for Holder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Instance(instance) => instance.fmt(f),
            Self::Journal => f.write_str(JOURNAL),
        }
    }
}

/// What travels between bridge and policy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Leaf {
    /// Bridge to policy: a session begins.
    Hello,
    /// Bridge to policy: what it sees.
    Observation,
    /// Bridge to policy: the session is over.
    Goodbye,
    /// Policy to bridge: it is there.
    Ready,
    /// Policy to bridge: its answer.
    Plan,
    /// Policy to bridge: it ends the session.
    Leave,
}

impl Leaf {
    /// What the bridge puts.
    pub const FROM_BRIDGE: [Self; 3] = [Self::Hello, Self::Observation, Self::Goodbye];
    /// What the policy puts.
    pub const FROM_POLICY: [Self; 3] = [Self::Ready, Self::Plan, Self::Leave];

    /// Returns the last part of the key.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Hello => "hello",
            Self::Observation => "observation",
            Self::Goodbye => "goodbye",
            Self::Ready => "ready",
            Self::Plan => "plan",
            Self::Leave => "leave",
        }
    }

    fn from_name(name: &str) -> Option<Self> {
        Self::FROM_BRIDGE.into_iter().chain(Self::FROM_POLICY).find(|leaf| leaf.name() == name)
    }
}

/// A key of the bus.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Key {
    /// Where a message is pushed.
    Push {
        /// The episode.
        episode: EpisodeId,
        /// The topic.
        topic: Topic,
        /// The camera; 0 for topics without.
        camera: u16,
    },
    /// Where a message is asked for.
    Pull {
        /// The episode.
        episode: EpisodeId,
        /// Whom.
        holder: Holder,
        /// Which message.
        slot: Slot,
    },
    /// Where an instance shows that it lives.
    Alive {
        /// The instance.
        instance: InstanceId,
    },
    /// Where bridge and policy meet. Both names hold the alphabet of ids.
    Policy {
        /// The policy.
        policy: InstanceId,
        /// The session, random.
        session: InstanceId,
        /// What travels.
        leaf: Leaf,
    },
}

/// A text is no key of the bus.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{key:?} is no key of the bus: {problem}")]
pub struct KeyError {
    /// The text.
    pub key: String,
    /// What is wrong with it.
    pub problem: String,
}

impl fmt::Display for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Push { episode, topic, camera } if topic.per_camera() => {
                write!(f, "{ROOT}/{episode}/{}/{camera}", topic.name())
            }
            Self::Push { episode, topic, .. } => write!(f, "{ROOT}/{episode}/{}", topic.name()),
            Self::Pull { episode, holder, slot } => {
                let Slot { topic, index, camera } = slot;
                write!(f, "{ROOT}/{episode}/{PULL}/{holder}/{}/{index}/{camera}", topic.name())
            }
            Self::Alive { instance } => write!(f, "{ROOT}/{ALIVE}/{instance}"),
            Self::Policy { policy, session, leaf } => write!(f, "{POLICY_ROOT}/{policy}/{session}/{}", leaf.name()),
        }
    }
}

impl Key {
    /// Returns the key under which a message is pushed.
    #[must_use]
    pub fn push(episode: &EpisodeId, slot: Slot) -> Self {
        Self::Push { episode: episode.clone(), topic: slot.topic, camera: slot.camera }
    }

    /// Reads a key.
    ///
    /// # Errors
    /// [`KeyError`] says what is wrong.
    pub fn parse(key: &str) -> Result<Self, KeyError> {
        let refuse = |problem: &str| KeyError { key: key.to_owned(), problem: problem.to_owned() };
        let parts: Vec<&str> = key.split('/').collect();
        match parts.as_slice() {
            ["dreamstream", "v1", ALIVE, instance] => Ok(Self::Alive { instance: id(key, instance)? }),
            ["dreamstream", "v1", episode, PULL, holder, topic, index, camera] => {
                let holder = if *holder == JOURNAL { Holder::Journal } else { Holder::Instance(id(key, holder)?) };
                let topic = topic_of(key, topic)?;
                let index = index.parse().map_err(|_| refuse("the index is no number"))?;
                let camera = camera_of(key, topic, camera)?;
                Ok(Self::Pull { episode: episode_of(key, episode)?, holder, slot: Slot { topic, index, camera } })
            }
            ["dreamstream", "v1", episode, topic] => {
                let topic = topic_of(key, topic)?;
                if topic.per_camera() {
                    return Err(refuse("the camera is missing"));
                }
                Ok(Self::Push { episode: episode_of(key, episode)?, topic, camera: 0 })
            }
            ["dreamstream", "v1", episode, topic, camera] => {
                let topic = topic_of(key, topic)?;
                if !topic.per_camera() {
                    return Err(refuse("the topic has no cameras"));
                }
                Ok(Self::Push { episode: episode_of(key, episode)?, topic, camera: camera_of(key, topic, camera)? })
            }
            ["dreamstream-policy", "v1", policy, session, leaf] => {
                let leaf = Leaf::from_name(leaf).ok_or_else(|| refuse("the last part is not known"))?;
                Ok(Self::Policy { policy: id(key, policy)?, session: id(key, session)?, leaf })
            }
            _ => Err(refuse("it has no known form")),
        }
    }
}

fn id(key: &str, text: &str) -> Result<InstanceId, KeyError> {
    InstanceId::new(text).map_err(|error| KeyError { key: key.to_owned(), problem: error.to_string() })
}

fn episode_of(key: &str, text: &str) -> Result<EpisodeId, KeyError> {
    EpisodeId::new(text).map_err(|error| KeyError { key: key.to_owned(), problem: error.to_string() })
}

fn topic_of(key: &str, text: &str) -> Result<Topic, KeyError> {
    Topic::from_name(text)
        .ok_or_else(|| KeyError { key: key.to_owned(), problem: format!("no topic is named {text:?}") })
}

fn camera_of(key: &str, topic: Topic, text: &str) -> Result<u16, KeyError> {
    let refuse = || KeyError { key: key.to_owned(), problem: format!("{text:?} is no camera of {}", topic.name()) };
    let camera = text.parse().map_err(|_| refuse())?;
    if camera > 0 && !topic.per_camera() {
        return Err(refuse());
    }
    Ok(camera)
}

fn pushes(episode: &str, topic: Topic) -> String {
    let cameras = if topic.per_camera() { "/*" } else { "" };
    format!("{ROOT}/{episode}/{}{cameras}", topic.name())
}

/// Returns the expression of all pushes of a topic.
#[must_use]
pub fn pushes_of(episode: &EpisodeId, topic: Topic) -> String {
    pushes(episode.as_str(), topic)
}

/// Returns the expression of all pulls that ask a holder.
#[must_use]
pub fn pulls_at(episode: &EpisodeId, holder: &Holder) -> String {
    format!("{ROOT}/{episode}/{PULL}/{holder}/**")
}

/// Returns the expression of all pushes of a topic in all episodes.
#[must_use]
pub fn all_pushes(topic: Topic) -> String {
    pushes("*", topic)
}

/// Returns the expression of all pulls that ask an instance.
#[must_use]
pub fn all_pulls() -> String {
    format!("{ROOT}/*/{PULL}/*/**")
}

/// Returns the expression of all pulls that ask a journal.
#[must_use]
pub fn all_journal_pulls() -> String {
    format!("{ROOT}/*/{PULL}/{JOURNAL}/**")
}

/// Returns the expression of all liveliness tokens.
#[must_use]
pub fn all_alive() -> String {
    format!("{ROOT}/{ALIVE}/*")
}

/// Returns the expression of what travels in every session of a policy.
#[must_use]
pub fn sessions_of(policy: &InstanceId, leaf: Leaf) -> String {
    format!("{POLICY_ROOT}/{policy}/*/{}", leaf.name())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn name() -> impl Strategy<Value = String> {
        "[A-Za-z0-9_-][A-Za-z0-9_.-]{0,30}"
    }

    fn slot() -> impl Strategy<Value = Slot> {
        (prop::sample::select(Topic::ALL.to_vec()), any::<u32>(), any::<u16>()).prop_map(|(topic, index, camera)| {
            Slot { topic, index, camera: if topic.per_camera() { camera } else { 0 } }
        })
    }

    fn key() -> impl Strategy<Value = Key> {
        let leaf = prop::sample::select([Leaf::FROM_BRIDGE, Leaf::FROM_POLICY].concat());
        (name(), name(), slot(), 0..5, leaf).prop_map(|(first, second, slot, kind, leaf)| {
            let episode = EpisodeId::new(&first).expect("an id");
            let instance = InstanceId::new(&second).expect("an id");
            match kind {
                0 => Key::push(&episode, slot),
                1 => Key::Pull { episode, holder: Holder::Instance(instance), slot },
                2 => Key::Pull { episode, holder: Holder::Journal, slot },
                3 => Key::Alive { instance },
                _ => Key::Policy { policy: InstanceId::new(&first).expect("an id"), session: instance, leaf },
            }
        })
    }

    proptest! {
        #[test]
        fn a_key_is_read_as_it_was_made(key in key()) {
            let text = key.to_string();
            prop_assert_eq!(Key::parse(&text), Ok(key));
            prop_assert!(zenoh::key_expr::KeyExpr::try_from(text).is_ok());
        }

        #[test]
        fn any_text_is_read_or_refused(text in "\\PC{0,60}") {
            if let Ok(key) = Key::parse(&text) {
                prop_assert_eq!(Key::parse(&key.to_string()), Ok(key));
            }
        }
    }

    #[test]
    fn a_wide_expression_covers_its_keys_and_no_other() {
        let episode = EpisodeId::new("e1").expect("an id");
        let wide = |text: String| zenoh::key_expr::KeyExpr::try_from(text).expect("an expression");
        let frames = wide(pushes_of(&episode, Topic::Frame));
        assert!(frames.includes(&wide(Key::push(&episode, Slot::of_camera(Topic::Frame, 3, 2)).to_string())));
        assert!(!frames.intersects(&wide(Key::push(&episode, Slot::of_camera(Topic::Layout, 3, 2)).to_string())));
        let journal = wide(pulls_at(&episode, &Holder::Journal));
        let slot = Slot::new(Topic::Plan, 4);
        assert!(
            journal.includes(&wide(Key::Pull { episode: episode.clone(), holder: Holder::Journal, slot }.to_string()))
        );
        let instance = Holder::Instance(InstanceId::new("journal").expect("an id"));
        assert!(!journal.intersects(&wide(Key::Pull { episode, holder: instance, slot }.to_string())));
    }

    #[test]
    fn foreign_texts_are_refused() {
        for text in [
            "",
            "dreamstream/v1/e/world/0",
            "dreamstream/v1/e/frame",
            "dreamstream/v1/e/frame/70000",
            "dreamstream/v1/e/pull/a/world/-1/0",
            "dreamstream/v1/e/pull/a/world/1/1",
            "dreamstream/v2/e/world",
            "dreamstream/v1/*/world",
            "dreamstream-policy/v1/p/s/world",
        ] {
            assert!(Key::parse(text).is_err(), "{text:?} was read");
        }
    }
}
