//! The commands, one file each, and how they answer.

pub mod bench;
pub mod certs;
pub mod doctor;
pub mod health;
pub mod replay;
pub mod report;
pub mod run;
pub mod scenario;
pub mod score;
pub mod serve;
pub mod train;
pub mod view;
pub mod why;

use indicatif::{ProgressBar, ProgressStyle};

/// Prints a line of the answer on stdout; logs and progress go to stderr.
#[expect(clippy::print_stdout, reason = "stdout belongs to the command line's answer")]
pub fn answer(line: &str) {
    println!("{line}");
}

/// Returns a progress bar with an estimate of the time left.
#[must_use]
pub fn bar(length: u64, unit: &'static str) -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:32} {pos}/{len} {msg} [{elapsed_precise} < {eta_precise}]")
        .unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(length).with_style(style).with_message(unit)
}

/// Prints an error and its causes on stderr.
#[expect(clippy::print_stderr, reason = "the command line's own error")]
pub fn complain(error: &anyhow::Error) {
    eprintln!("error: {error:#}");
}
