//! frame, ego → plan: shows the policy under test its observation and carries its answer back.
//!
//! Built-in policies and networks of others with a manifest run inside; external ones connect to a second Zenoh session
//! that knows no episode, scenario or seed (`dreamstream-policy/v1/{policy}/{session}/…`). A policy that is late, dies or
//! answers nonsense ends its episode by a named rule, never the service.

pub mod guest;
pub mod outsider;
pub mod settings;
pub mod stage;

pub use guest::OutsideBus;
pub use outsider::Outsider;
pub use settings::Settings;
pub use stage::PolicyStage;

use std::sync::Arc;
use std::time::Duration;

use ds_process::Drain;
use ds_process::service::{StageSections, run_stage};

/// Runs the process until `drain`.
///
/// # Errors
/// If a bus or the orchestrator's address is bad.
pub async fn run(settings: Settings, drain: Drain) -> anyhow::Result<()> {
    let deadline = Duration::from_millis(settings.policy.deadline_millis);
    let outside = match settings.policy.listen.as_str() {
        "" => None,
        listen => {
            let security = &settings.security;
            security.check_endpoint("policy.listen", listen)?;
            Some(Arc::new(OutsideBus::open(&settings.policy.name, listen, security.files(), deadline).await?))
        }
    };
    let stage = PolicyStage::new(settings.policy.weights.clone(), outside).with_own(&settings.policy.manifests)?;
    let factory = Arc::new(stage);
    let Settings { process, control, security, bus, metrics, .. } = &settings;
    let sections = StageSections { process, control, security, bus, metrics };
    run_stage("policy-bridge", sections, factory, drain).await
}
