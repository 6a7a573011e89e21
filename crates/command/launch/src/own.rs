//! Policies of one's own on the command line: `--policy FILE.toml` names a manifest instead of a policy.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use ds_policy::Own;
use ds_process::service::UsageError;

use crate::run_plan::RunPlan;

/// Reads manifest and network.
///
/// # Errors
/// If either is refused, or another policy has the name.
pub fn read(manifest: &Path) -> Result<Own> {
    Ok(Own::read(manifest).map_err(|error| UsageError(format!("{:#}", anyhow::Error::from(error))))?)
}

/// Returns the name of a policy that is named by itself or by its manifest.
///
/// # Errors
/// If the manifest is refused.
pub fn name(policy: &str) -> Result<String> {
    Ok(Own::named(policy).map_or_else(|| Ok(policy.to_owned()), |manifest| Own::name_in(&manifest))?)
}

/// Reads manifest and network of a policy that is shown so many frames.
///
/// # Errors
/// If either is refused, or it sees more frames.
pub fn seeing(manifest: &Path, shown: u32) -> Result<Own> {
    let own = read(manifest).with_context(|| format!("--policy {}", manifest.display()))?;
    let says = format!("{} sees {} frames, --history is {shown}", manifest.display(), own.history());
    ensure!(own.history() <= shown, UsageError(says));
    Ok(own)
}

/// Reads the policy that a run asks for, if it is named by a manifest.
///
/// # Errors
/// If it is refused, sees more frames than it is shown, or is to connect from outside.
pub fn asked(args: &RunPlan) -> Result<Option<Own>> {
    let Some(manifest) = Own::named(&args.policy) else { return Ok(None) };
    let inside = args.policy_listen.is_none();
    ensure!(inside, UsageError("--policy-listen is for external policies: a manifest needs none".to_owned()));
    seeing(&manifest, args.history).map(Some)
}
