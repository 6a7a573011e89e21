//! `health`: asks the orchestrator whether it, or a member of its fleet, is well.

use std::time::Duration;

use anyhow::{Context, Result, ensure};
use ds_process::terminal::answer;
use ds_wire::control as pb;

use crate::cli::HealthArgs;

/// Asks; succeeds if all is well.
///
/// # Errors
/// If the orchestrator does not answer within 3 s or the instance is not a member.
pub(crate) async fn run(args: &HealthArgs) -> Result<()> {
    let limit = Duration::from_secs(3);
    let channel = args.control.dial()?.connect(limit).await;
    let channel = channel.with_context(|| format!("orchestrator does not answer: {}", args.control.orchestrator))?;
    let mut fleet = pb::fleet_client::FleetClient::new(channel);
    let asked = tokio::time::timeout(limit, fleet.list(pb::ListInstancesRequest {})).await;
    let members = asked.context("orchestrator is silent")?.context("orchestrator")?.into_inner().instances;
    let Some(wanted) = &args.instance else {
        answer(&format!("orchestrator is well, {} members", members.len()));
        return Ok(());
    };
    let found = members.iter().find(|member| member.hello.as_ref().is_some_and(|hello| hello.instance == *wanted));
    let member = found.with_context(|| format!("{wanted:?} is not a member"))?;
    ensure!(member.connected, "{wanted:?} is not connected, silent for {} ms", member.silent_millis);
    ensure!(!member.cordoned, "{wanted:?} is cordoned");
    answer(&format!("{wanted} is well, silent for {} ms, holds {}", member.silent_millis, member.holds.len()));
    Ok(())
}
