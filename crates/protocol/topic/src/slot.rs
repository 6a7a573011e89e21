//! The place of a message within an episode: topic, index and camera. Two messages of one slot must be equal.

use std::fmt;

/// The topics of an episode, in the order in which data goes round.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Topic {
    /// The resolved episode; index 0.
    Scene,
    /// The work order; index = iteration.
    Advance,
    /// True state of the world; index = tick.
    World,
    /// What the car knows of itself; index = tick.
    Ego,
    /// Condition image; index = tick, one per camera.
    Layout,
    /// Camera image; index = tick, one per camera.
    Frame,
    /// What a successor of the video worker needs; index = chunk, one per camera.
    Cache,
    /// The policy's answer; index = iteration.
    Plan,
    /// Sub-metrics so far; index = tick.
    Score,
    /// Start, end, fault, retry; index = sequence.
    Event,
    /// Running gap diagnosis; index = tick at which its window ends.
    Diagnosis,
}

impl Topic {
    /// All topics.
    pub const ALL: [Self; 11] = [
        Self::Scene,
        Self::Advance,
        Self::World,
        Self::Ego,
        Self::Layout,
        Self::Frame,
        Self::Cache,
        Self::Plan,
        Self::Score,
        Self::Event,
        Self::Diagnosis,
    ];

    /// Returns the topic's name in keys, files and spans.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Scene => "scene",
            Self::Advance => "advance",
            Self::World => "world",
            Self::Ego => "ego",
            Self::Layout => "layout",
            Self::Frame => "frame",
            Self::Cache => "cache",
            Self::Plan => "plan",
            Self::Score => "score",
            Self::Event => "event",
            Self::Diagnosis => "diagnosis",
        }
    }

    /// Returns the topic of a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|topic| topic.name() == name)
    }

    /// Says whether there is one message per camera.
    #[must_use]
    pub fn per_camera(self) -> bool {
        matches!(self, Self::Layout | Self::Frame | Self::Cache)
    }
}

/// The identity of a message within one attempt at an episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Slot {
    /// The topic.
    pub topic: Topic,
    /// Tick, iteration, chunk or sequence, as the topic says.
    pub index: u32,
    /// The index of the camera in the episode's list; 0 for topics without cameras.
    pub camera: u16,
}

impl Slot {
    /// Makes the slot of a topic without cameras.
    #[must_use]
    pub fn new(topic: Topic, index: u32) -> Self {
        Self { topic, index, camera: 0 }
    }

    /// Makes the slot of a camera's message.
    #[must_use]
    pub fn of_camera(topic: Topic, index: u32, camera: u16) -> Self {
        Self { topic, index, camera }
    }
}

impl fmt::Display for Slot {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.topic.per_camera() {
            write!(f, "{}[{}].{}", self.topic.name(), self.index, self.camera)
        } else {
            write!(f, "{}[{}]", self.topic.name(), self.index)
        }
    }
}
