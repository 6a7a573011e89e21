//! Topic `event`: what happened to an attempt, and why.

use ds_topic::{Event, EventKind};

use crate::error::FieldError;
use crate::field::{choice, enumeration, text};
use crate::v1;

/// The longest reason, in bytes.
pub const MAX_REASON_BYTES: usize = 4_096;

enumeration!(v1::EventKind, EventKind, {
    Started = Started, Completed = Completed, Failed = Failed, Aborted = Aborted, Fault = Fault,
    Reassigned = Reassigned,
});

impl From<&Event> for v1::Event {
    fn from(value: &Event) -> Self {
        Self { header: None, kind: v1::EventKind::from(value.kind).into(), reason: value.reason.clone() }
    }
}

impl TryFrom<v1::Event> for Event {
    type Error = FieldError;
    fn try_from(message: v1::Event) -> Result<Self, FieldError> {
        Ok(Self {
            kind: choice::<v1::EventKind, _>("kind", message.kind)?,
            reason: text("reason", message.reason, MAX_REASON_BYTES)?,
        })
    }
}
