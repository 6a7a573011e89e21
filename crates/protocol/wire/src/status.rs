//! The one table from domain errors to gRPC codes.

use tonic::{Code, Status};

use crate::error::WireError;

/// Why a service refuses a request; the text names what and carries the value.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// The request itself is wrong.
    #[error("{0}")]
    Invalid(String),
    /// What was named does not exist.
    #[error("{0}")]
    NotFound(String),
    /// The same name came with another content.
    #[error("{0}")]
    Conflict(String),
    /// The state does not allow it now.
    #[error("{0}")]
    WrongState(String),
    /// A limit is reached: slots, queue, devices.
    #[error("{0}")]
    Exhausted(String),
    /// The caller may not do this.
    #[error("{0}")]
    Denied(String),
    /// The caller did not say who it is.
    #[error("{0}")]
    Unknown(String),
    /// The service is starting, draining or has lost what it needs; ask again later.
    #[error("{0}")]
    Unavailable(String),
    /// It took too long.
    #[error("{0}")]
    Late(String),
    /// It was cancelled.
    #[error("{0}")]
    Cancelled(String),
    /// The service itself is at fault.
    #[error("{0}")]
    Internal(String),
}

impl From<WireError> for Refusal {
    fn from(error: WireError) -> Self {
        Self::Invalid(error.to_string())
    }
}

/// Returns the gRPC status of a refusal.
#[must_use]
pub fn status(error: impl Into<Refusal>) -> Status {
    let refusal = error.into();
    let code = match &refusal {
        Refusal::Invalid(_) => Code::InvalidArgument,
        Refusal::NotFound(_) => Code::NotFound,
        Refusal::Conflict(_) => Code::AlreadyExists,
        Refusal::WrongState(_) => Code::FailedPrecondition,
        Refusal::Exhausted(_) => Code::ResourceExhausted,
        Refusal::Denied(_) => Code::PermissionDenied,
        Refusal::Unknown(_) => Code::Unauthenticated,
        Refusal::Unavailable(_) => Code::Unavailable,
        Refusal::Late(_) => Code::DeadlineExceeded,
        Refusal::Cancelled(_) => Code::Cancelled,
        Refusal::Internal(_) => Code::Internal,
    };
    Status::new(code, refusal.to_string())
}
