//! Stopping is an argument: every `run` takes a token that SIGINT, SIGTERM and a fleet order cancel alike.

use tokio_util::sync::CancellationToken;

/// Exit code after SIGINT or SIGTERM, as shells have it.
pub const EXIT_INTERRUPTED: u8 = 130;

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
        std::process::exit(i32::from(EXIT_INTERRUPTED));
    });
    Ok(drain)
}
