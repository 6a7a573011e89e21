//! Stopping is an argument: every `run` takes a token that SIGINT, SIGTERM and a fleet order cancel alike.

use tokio_util::sync::CancellationToken;

/// Returns a token that SIGINT and SIGTERM cancel; a second SIGINT ends the process at once.
///
/// # Errors
/// If the signals cannot be watched.
pub fn on_signals() -> anyhow::Result<CancellationToken> {
    use tokio::signal::unix::{SignalKind, signal};
    let drain = CancellationToken::new();
    let (mut interrupt, mut terminate) = (signal(SignalKind::interrupt())?, signal(SignalKind::terminate())?);
    let token = drain.clone();
    tokio::spawn(async move {
        tokio::select! {
            _ = interrupt.recv() => {}
            _ = terminate.recv() => {}
        }
        tracing::info!("draining");
        token.cancel();
        let _ = interrupt.recv().await;
        std::process::exit(130);
    });
    Ok(drain)
}
