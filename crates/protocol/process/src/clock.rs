//! The process's own monotonic clock, in milliseconds since its start, and the calendar. Never part of an episode's data.

use std::sync::OnceLock;
use std::time::{Instant, SystemTime};

static START: OnceLock<Instant> = OnceLock::new();

/// Returns the milliseconds since the process first asked.
#[must_use]
pub fn millis() -> u64 {
    let start = *START.get_or_init(Instant::now);
    u64::try_from(start.elapsed().as_millis()).unwrap_or(u64::MAX)
}

/// Returns the calendar's time: for certificates and reports alone.
#[must_use]
#[expect(clippy::disallowed_methods, reason = "certificates hold for calendar days")]
pub fn today() -> SystemTime {
    SystemTime::now()
}
