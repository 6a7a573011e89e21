//! Parsers of choices by name, for the arguments of whatever drives.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use ds_topic::ProposalScorer;
use ds_video::Backend;
use ds_world::AgentMode;

/// Parses which agents react.
pub fn agents() -> impl TypedValueParser<Value = AgentMode> {
    let told = AgentMode::ALL.map(|mode| {
        PossibleValue::new(mode.name()).help(match mode {
            AgentMode::LogReplay => "All follow their log",
            AgentMode::IdmBehindEgo => "Those behind the ego drive by IDM",
            AgentMode::IdmAll => "All with a route drive by IDM",
            AgentMode::Interactive => {
                "The same; they change lanes, yield by right of way, and people on foot walk by themselves"
            }
        })
    });
    named(told, AgentMode::from_name)
}

/// Parses a choice by its name.
pub fn named<T: Clone + Send + Sync + 'static>(
    names: impl Into<PossibleValuesParser>,
    from_name: fn(&str) -> Option<T>,
) -> impl TypedValueParser<Value = T> {
    names.into().map(move |name| from_name(&name).expect("a possible value"))
}

/// Parses one of some back ends of the video model by its name.
pub fn backend(some: &[Backend]) -> impl TypedValueParser<Value = Backend> {
    named(some.iter().map(|backend| backend.name()).collect::<Vec<_>>(), |name| name.parse().ok())
}

/// Returns the oracle that rolls out in the named way.
pub(crate) fn oracle(way: &str) -> Option<ProposalScorer> {
    match way {
        "reacting" => Some(ProposalScorer::Oracle),
        "navsim" => Some(ProposalScorer::OracleNavsim),
        _ => None,
    }
}
