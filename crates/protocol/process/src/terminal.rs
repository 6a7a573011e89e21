//! How commands speak to people: answers on stdout, progress and errors on stderr, and the flag that Ctrl-C raises.

mod plain;

use std::io::{ErrorKind, IsTerminal, Write};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

pub use crate::logging::complain;
use crate::service::{EXIT_STORAGE, EXIT_USAGE, exit_code};

/// Raised when whoever read the answer has left.
static UNREAD: AtomicBool = AtomicBool::new(false);

/// Prints a line of the answer on stdout; logs and progress go to stderr.
///
/// A reader may leave, as `head` does: the work goes on, and its exit code is the usual one. An answer that is lost for any other
/// reason, such as a full disk, ends the process with [`EXIT_STORAGE`].
pub fn answer(line: &str) {
    match writeln!(std::io::stdout(), "{line}") {
        Ok(()) => {}
        Err(error) if error.kind() == ErrorKind::BrokenPipe => UNREAD.store(true, Ordering::Relaxed),
        Err(error) => {
            complain(&anyhow::Error::new(error).context("the answer cannot be written to stdout"));
            std::process::exit(EXIT_STORAGE.into());
        }
    }
}

/// Says something beside the answer, on stderr.
pub fn note(line: &str) {
    let _closed_pipe = writeln!(std::io::stderr(), "{line}");
}

/// Says whether whoever read the answer has left, so that what only answers, again and again, may end.
#[must_use]
pub fn unread() -> bool {
    UNREAD.load(Ordering::Relaxed)
}

/// Returns a progress bar with an estimate of the time left; a line every half minute where stderr is no terminal.
#[must_use]
pub fn bar(length: u64, unit: &'static str) -> ProgressBar {
    let terminal = std::io::stderr().is_terminal();
    let front = if terminal { "{bar:32}" } else { plain::MARK };
    let style = ProgressStyle::with_template(&format!(
        "{front} {{pos}}/{{len}} {{msg}} [{{elapsed_precise}} < {{eta_precise}}]"
    ))
    .unwrap_or_else(|_| ProgressStyle::default_bar());
    let bar = ProgressBar::new(length);
    if !terminal {
        bar.set_draw_target(ProgressDrawTarget::term_like(Box::new(plain::Lines::new(std::io::stderr()))));
    }
    bar.with_style(style).with_message(unit)
}

/// Returns the arguments of a process, or, once help or what is wrong with them is printed, its exit code.
///
/// # Errors
/// The exit code: 0 for help, [`EXIT_USAGE`] for wrong arguments.
pub fn parsed<C>(arguments: Result<C, clap::Error>) -> Result<C, ExitCode> {
    arguments.map_err(|error| {
        let code = if error.use_stderr() { EXIT_USAGE } else { 0 };
        let _closed_pipe = error.print();
        ExitCode::from(code)
    })
}

/// Returns the exit code of a command that ended, and says why it failed.
#[must_use]
pub fn ended(result: anyhow::Result<()>) -> ExitCode {
    result.map_or_else(
        |error| {
            complain(&error);
            ExitCode::from(exit_code(&error))
        },
        |()| ExitCode::SUCCESS,
    )
}

/// Returns a flag that SIGINT raises.
///
/// # Errors
/// If the signal cannot be listened to.
pub fn stop_flag() -> anyhow::Result<Arc<AtomicBool>> {
    let flag = Arc::new(AtomicBool::new(false));
    let raised = Arc::clone(&flag);
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    std::thread::Builder::new().name("signals".to_owned()).spawn(move || {
        if runtime.block_on(tokio::signal::ctrl_c()).is_ok() {
            raised.store(true, Ordering::Relaxed);
        }
    })?;
    Ok(flag)
}
