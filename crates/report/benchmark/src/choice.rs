//! Choices of a drive as files name them: an enumeration in memory, its name in JSON. A name that is none is refused.

use ds_world::{AgentMode, TrackerKind};
use serde::de::{Deserialize, Deserializer, Error};

/// Returns the choice of a name.
fn of_name<E: Error, T>(what: &str, name: &str, from_name: fn(&str) -> Option<T>) -> Result<T, E> {
    from_name(name).ok_or_else(|| E::custom(format_args!("there is no {what} {name:?}")))
}

/// Which agents react.
pub(crate) mod agents {
    use super::{AgentMode, Deserialize, Deserializer, of_name};
    use serde::Serializer;

    pub(crate) fn serialize<S: Serializer>(mode: &AgentMode, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_str(mode.name())
    }

    pub(crate) fn deserialize<'a, D: Deserializer<'a>>(from: D) -> Result<AgentMode, D::Error> {
        of_name("agent mode", &String::deserialize(from)?, AgentMode::from_name)
    }
}

/// The same, several.
pub(crate) mod all_agents {
    use super::{AgentMode, Deserialize, Deserializer, of_name};
    use serde::Serializer;

    pub(crate) fn serialize<S: Serializer>(modes: &[AgentMode], to: S) -> Result<S::Ok, S::Error> {
        to.collect_seq(modes.iter().map(|mode| mode.name()))
    }

    pub(crate) fn deserialize<'a, D: Deserializer<'a>>(from: D) -> Result<Vec<AgentMode>, D::Error> {
        let names = Vec::<String>::deserialize(from)?;
        names.iter().map(|name| of_name("agent mode", name, AgentMode::from_name)).collect()
    }
}

/// What follows the plan.
pub(crate) mod tracker {
    use super::{Deserialize, Deserializer, TrackerKind, of_name};
    use serde::Serializer;

    pub(crate) fn serialize<S: Serializer>(kind: &TrackerKind, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_str(kind.name())
    }

    pub(crate) fn deserialize<'a, D: Deserializer<'a>>(from: D) -> Result<TrackerKind, D::Error> {
        of_name("tracker", &String::deserialize(from)?, TrackerKind::from_name)
    }
}
