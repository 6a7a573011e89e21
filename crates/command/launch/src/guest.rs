//! A policy in another process, asked by this one without a fleet.

use std::sync::Arc;
use std::time::Duration;

use anyhow::Result;
use policy_bridge::{OutsideBus, Outsider};
use tokio::runtime::Runtime;

/// An external policy has so long for each answer.
const ANSWER_WITHIN: Duration = Duration::from_secs(60);

/// Opens a bus on an endpoint for the policy of a name; it may connect later.
///
/// # Errors
/// If the name is not one or the endpoint cannot be listened on.
pub fn open(runtime: &Runtime, name: &str, listen: &str) -> Result<Arc<OutsideBus>> {
    Ok(Arc::new(runtime.block_on(OutsideBus::open(name, listen, None, ANSWER_WITHIN))?))
}

/// Returns the policy of a name that connects to an endpoint.
///
/// # Errors
/// As of [`open`].
pub fn connecting(runtime: &Runtime, name: &str, listen: &str) -> Result<Outsider> {
    Ok(Outsider::new(open(runtime, name, listen)?, false))
}
