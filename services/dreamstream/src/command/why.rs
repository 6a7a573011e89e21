//! `why`: says what drives under way wait for.

use std::time::Duration;

use anyhow::{Context, Result, ensure};
use ds_process::onlooker::under_way;
use ds_process::terminal::answer;
use ds_wire::control as pb;
use pb::runs_client::RunsClient;

use crate::cli::WhyArgs;

/// Prints one line per drive under way: ticks, and which message or holder is awaited, from whom, since when.
///
/// # Errors
/// If the orchestrator does not answer or no such drive is under way.
pub(crate) async fn run(args: &WhyArgs) -> Result<()> {
    let channel = args.control.dial()?.connect(Duration::from_secs(5)).await;
    let channel = channel.with_context(|| format!("orchestrator does not answer: {}", args.control.orchestrator))?;
    let mut runs = RunsClient::new(channel);
    let wanted = args.episode.as_deref().unwrap_or_default();
    let driven = under_way(&mut runs).await?;
    let found: Vec<&pb::EpisodeResult> = driven.iter().filter(|episode| episode.episode.contains(wanted)).collect();
    ensure!(!found.is_empty(), "no drive whose name holds {wanted:?} is under way, of {} in all", driven.len());
    for episode in found {
        let awaits = if episode.awaits.is_empty() { "nothing late" } else { &episode.awaits };
        let pb::EpisodeResult { episode: name, attempts, ticks, ticks_due, .. } = episode;
        answer(&format!("{name}: attempt {attempts}, tick {ticks} of {ticks_due}, awaits {awaits}"));
    }
    Ok(())
}
