//! The control plane's messages as services use them: the generated types and the names of their enumerations.

pub use crate::v1::*;

/// Returns the role of a wire value, if it names one.
#[must_use]
pub fn role_of(value: i32) -> Option<ds_topic::Role> {
    crate::v1::Role::try_from(value).ok().and_then(|role| ds_topic::Role::try_from(role).ok())
}

/// Returns the wire value of a role.
#[must_use]
pub fn role(role: ds_topic::Role) -> i32 {
    crate::v1::Role::from(role).into()
}

/// Returns the observation source of a wire value, if it names one.
#[must_use]
pub fn observation_of(value: i32) -> Option<ds_topic::ObservationSource> {
    crate::v1::ObservationSource::try_from(value)
        .ok()
        .and_then(|source| ds_topic::ObservationSource::try_from(source).ok())
}

/// Returns the agent mode of a wire value, if it names one.
#[must_use]
pub fn agents_of(value: i32) -> Option<ds_world::AgentMode> {
    crate::v1::AgentMode::try_from(value).ok().and_then(|mode| ds_world::AgentMode::try_from(mode).ok())
}

/// Returns the name of a status in results.
#[must_use]
pub fn status_name(value: i32) -> &'static str {
    match Status::try_from(value) {
        Ok(Status::Queued) => "queued",
        Ok(Status::Running) => "running",
        Ok(Status::Completed) => "completed",
        Ok(Status::Failed) => "failed",
        Ok(Status::Aborted) => "aborted",
        Ok(Status::Unspecified) | Err(_) => "unknown",
    }
}

/// A member without a heartbeat for longer is called silent: twice the longest pause of one that is well.
const SILENT_MILLIS: u64 = 2_500;

/// What members are up to, the worst first.
pub const MEMBER_STATES: [&str; 6] = ["lost its line", "silent", "cordoned", "draining", "idle", "works"];

/// Returns what a member is up to, one of [`MEMBER_STATES`].
#[must_use]
pub fn member_state(member: &Instance) -> &'static str {
    let [lost, silent, cordoned, draining, idle, works] = MEMBER_STATES;
    match member {
        Instance { connected: false, .. } => lost,
        Instance { silent_millis, .. } if *silent_millis > SILENT_MILLIS => silent,
        Instance { cordoned: true, .. } => cordoned,
        Instance { draining: true, .. } => draining,
        Instance { holds, .. } if holds.is_empty() => idle,
        Instance { .. } => works,
    }
}

/// Says whether an episode or run with this status has ended.
#[must_use]
pub fn has_ended(value: i32) -> bool {
    matches!(Status::try_from(value), Ok(Status::Completed | Status::Failed | Status::Aborted))
}

/// Encodes a message of the control plane for storage.
#[must_use]
pub fn encode_message(message: &impl prost::Message) -> Vec<u8> {
    message.encode_to_vec()
}

/// Decodes a stored message of the control plane.
///
/// # Errors
/// If the bytes are not such a message.
pub fn decode_message<M: prost::Message + Default>(bytes: &[u8]) -> Result<M, prost::DecodeError> {
    M::decode(bytes)
}
