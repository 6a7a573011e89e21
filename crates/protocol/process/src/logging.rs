//! Logs go to stderr; stdout belongs to the command line's answer.

use std::io::{IsTerminal, Write};

use tracing_subscriber::EnvFilter;

/// Starts logging with a filter such as `info` or `ds_bus=trace`; a second start changes nothing.
///
/// # Errors
/// If the filter cannot be parsed.
pub fn start(filter: &str) -> anyhow::Result<()> {
    let filter = EnvFilter::try_new(filter).map_err(|error| anyhow::anyhow!("log filter {filter:?}: {error}"))?;
    let subscriber = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_ansi(std::io::stderr().is_terminal())
        .with_writer(std::io::stderr)
        // It would tell of a closed stderr on stderr, and panic.
        .log_internal_errors(false)
        .finish();
    if tracing::subscriber::set_global_default(subscriber).is_err() {
        tracing::debug!("logging was started before");
    }
    Ok(())
}

/// Prints an error and its causes on stderr, whether or not logging has started.
pub fn complain(error: &anyhow::Error) {
    let _closed_pipe = writeln!(std::io::stderr(), "error: {error:#}");
}
